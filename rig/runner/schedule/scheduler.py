"""Runs a schedule: one campaign after another at their times.

Its state follows from its journal: jobs that wait, runs that ended, and a halt. So a restart goes
on where the schedule was.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any, Final, NamedTuple, Protocol

from rig.configuration import Entry, Missed, Schedule
from rig.runner.outcomes import EXIT_BAD_INPUT, EXIT_FAILED, EXIT_STOPPED
from rig.runner.run_folder import Entry as JournalEntry, Journal, JournalError, file_stem, new_path

from .additions import asked_of

POLL_S: Final = 5.0
"""Longest time between two looks for requests while nothing runs, s."""
LONGEST_AUTHOR: Final = 64
"""Most characters of the name of who made a request, as of a person in a command."""
MOST_RESUMES: Final = 3
"""How often a run is resumed at most after its process was killed."""
JOURNAL: Final = "schedule.jsonl"
"""Name of a schedule's journal in its folder."""


@dataclass(frozen=True)
class Job:
    """A run of a campaign that is due.

    Attributes:
        id: text by which the job differs from all others of the schedule.
        entry: name of the schedule's entry, or of the request that added the job.
        campaign: the campaign, as an argument of `rig run`.
        rig: the rig, as an argument of `rig run`; None for the campaign's own.
        due: when it was to begin; for a job that a request added, when the request was taken.
        attempt: number of the attempt, from 1; retries of a failed run count up.
        not_before: earliest time at which it may begin; None for at once.
        folder: folder of its run; None before it has begun.
        resumes: how often the run was resumed after its process had ended early.
    """

    id: str
    entry: str
    campaign: str
    rig: str | None
    due: datetime
    attempt: int = 1
    not_before: datetime | None = None
    folder: str | None = None
    resumes: int = 0


@dataclass(frozen=True)
class Ended:
    """A run that has ended.

    Attributes:
        job: the job.
        exit_code: exit code of `rig run`; negative if a signal killed it.
        at: when it ended, UTC.
    """

    job: Job
    exit_code: int
    at: datetime


class Busy(NamedTuple):
    """Why a job waits for its rig, such as a device that another program uses, and since when."""

    why: str
    since: datetime


@dataclass
class ScheduleState:
    """The state of a schedule according to its journal; `take` updates it entry by entry.

    Attributes:
        collected: time up to which all due times have been put into the queue; None before the
            first start.
        queue: jobs that wait, in the order of running, except that a job whose `not_before` has not
            come yet lets those after it pass.
        present: the job that was begun and has not ended; None if there is none.
        history: runs that have ended, oldest first.
        missed: number of due times of each entry that were not run, by the entry's name.
        busy: by the ids of jobs that wait for their rig, why and since when they do.
        taken: ids of the requests that were taken from the file of additions.
        halted: why no job is begun; empty if the schedule is not halted.
    """

    collected: datetime | None = None
    queue: list[Job] = field(default_factory=list)
    present: Job | None = None
    history: list[Ended] = field(default_factory=list)
    missed: dict[str, int] = field(default_factory=dict)
    busy: dict[str, Busy] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)
    halted: str = ""

    def take(self, entry: JournalEntry) -> None:
        """Update the state by the next entry of the journal.

        An entry of an unknown kind changes nothing.
        """
        details = entry.details
        match entry.kind:
            case "collected":
                self.collected = _time(details["upto"])
                back = timedelta(seconds=float(details.get("set_back_s", 0.0)))
                self.queue = [_earlier(job, back) for job in self.queue]
                self.queue += [_job(job) for job in details.get("due", ())]
                for name, count in details.get("missed", {}).items():
                    self.missed[name] = self.missed.get(name, 0) + int(count)
            case "added":
                self.taken.add(details["id"])
                self.queue.append(_job(details))
            case "busy":
                id_, why = str(details["id"]), str(details["why"])
                known = self.busy.get(id_)
                since = _time(entry.at) if known is None else known.since
                self.busy[id_] = Busy(why, since)
            case "put_back" if self.present is not None:
                self.queue.insert(0, replace(self.present, folder=None))
                self.present = None
            case "gave_up":
                self.busy.pop(details["id"], None)
                at = _time(entry.at)
                given_up = [job for job in self.queue if job.id == details["id"]]
                self.history += [Ended(job, int(details["exit_code"]), at) for job in given_up]
                self.queue = [job for job in self.queue if job.id != details["id"]]
                if details.get("retry"):
                    self.queue.insert(0, _job(details["retry"]))
            case "begun":
                self.busy.pop(details["id"], None)
                mine = next((job for job in self.queue if job.id == details["id"]), None)
                if mine is not None:
                    self.queue.remove(mine)
                    self.present = replace(mine, folder=_text_or_none(details["folder"]))
                elif self.present is not None:
                    self.present = replace(self.present, resumes=self.present.resumes + 1)
            case "ended" if self.present is not None:
                at = _time(entry.at)
                self.history.append(Ended(self.present, int(details["exit_code"]), at))
                self.present = None
                self.halted = str(details.get("halted") or "")
                if details.get("retry"):
                    self.queue.insert(0, _job(details["retry"]))
            case "resumed":
                self.taken.add(str(details.get("id", "")))
                self.halted = ""


def details_of(job: Job) -> dict[str, Any]:
    """Return a job as the details of a journal's entry, JSON-able, without folder and resumes."""
    later = None if job.not_before is None else job.not_before.isoformat()
    details = asdict(job) | {"due": job.due.isoformat(), "not_before": later}
    del details["folder"], details["resumes"]
    return details


def _earlier(job: Job, back: timedelta) -> Job:
    """Return a job that waits for a time, if it does, with that time put back."""
    return job if job.not_before is None else replace(job, not_before=job.not_before - back)


def _asked_for(request: Mapping[str, Any], now: datetime) -> Job:
    """Return the job that a request adds at this time."""
    campaign, rig = str(request.get("campaign", "")), request.get("rig")
    name = str(request.get("name") or file_stem(campaign))
    return Job(str(request["id"]), name, campaign, None if rig is None else str(rig), now)


def waiting(folder: Path, state: ScheduleState, now: datetime) -> list[Job]:
    """Return the jobs that were asked for, and that the schedule of a folder has not taken yet."""
    asked = (request for request in asked_of(folder) if request["id"] not in state.taken)
    return [_asked_for(request, now) for request in asked if not request.get("resume")]


def _author_of(request: Mapping[str, Any]) -> dict[str, str]:
    """Return who made a request, as the detail `by` of a journal's entry; {} if it does not say."""
    by = " ".join(str(request.get("by") or "").split())[:LONGEST_AUTHOR]
    return {"by": by} if by else {}


def _job(details: Any) -> Job:
    later = details.get("not_before")
    return Job(
        id=str(details["id"]),
        entry=str(details["entry"]),
        campaign=str(details["campaign"]),
        rig=_text_or_none(details["rig"]),
        due=_time(details["due"]),
        attempt=int(details.get("attempt", 1)),
        not_before=None if later is None else _time(later),
    )


def _time(text: str) -> datetime:
    found = datetime.fromisoformat(text)
    if found.tzinfo is None:
        raise ValueError(f"the time {text!a} has no zone")
    return found


def _text_or_none(value: Any) -> str | None:
    if value is not None and not isinstance(value, str):
        raise TypeError(f"{value!a} is no text")
    return value


def state_of(entries: Iterable[JournalEntry]) -> ScheduleState:
    """Return the state of a schedule after all entries of its journal.

    Raises:
        JournalError: an entry is none of a schedule's journal.
    """
    state = ScheduleState()
    for entry in entries:
        try:
            state.take(entry)
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise JournalError(
                f"{JOURNAL}:{entry.number + 1}: is no entry of a schedule ({error}); put the file "
                "back from a copy, or move it away to begin the schedule anew"
            ) from None
    return state


class Hands(Protocol):
    """The actions of the scheduler, which itself only decides; tests replace them by their own."""

    def now(self) -> datetime:
        """Return the present time, UTC."""

    def sleep(self, seconds: float) -> None:
        """Wait for some seconds, or less if something new has happened."""

    def run(self, job: Job, entry: Entry | None) -> int:
        """Run a job in its folder, or resume it if it was begun there, and return its exit code.

        Args:
            job: the job, whose folder is known.
            entry: the schedule's entry that it comes from; None if the schedule has none.

        Returns:
            The exit code of `rig run`; negative if a signal killed the process.
        """

    def busy(self, job: Job) -> str:
        """Return why a job's rig cannot be used now, as another program uses it; "" if it can.

        A run of the job's own that still goes on in its folder is no other program.
        """

    def after(self, job: Job, exit_code: int) -> str:
        """Write the trend page and run the hook after a run; return what went wrong, else empty."""

    def say(self, text: str) -> None:
        """Show a line to the user."""


class Scheduler:
    """Runs a schedule, and keeps its state in a journal.

    Args:
        schedule: the schedule to run.
        journal: the journal of the schedule's folder; its context has been entered.
        hands: carries out the scheduler's actions.

    Attributes:
        state: the schedule's state by its journal.
    """

    def __init__(self, schedule: Schedule, journal: Journal, hands: Hands) -> None:
        self._schedule = schedule
        self._journal = journal
        self._hands = hands
        self._entries = {entry.name: entry for entry in schedule.entries}
        self._started = False
        self.state: ScheduleState = state_of(journal.entries)

    def run(self, stopped: Callable[[], bool], *, until_idle: bool = False) -> None:
        """Run the schedule until `stopped` returns True.

        With `until_idle` it also returns as soon as nothing can be run and no job waits in the
        queue; jobs that wait for a time or because of a halt keep it running.
        """
        while not stopped():
            wait_s = self.step(stopped)
            if wait_s is None:
                continue
            if until_idle and not self.state.queue and self.state.present is None:
                return
            self._hands.sleep(wait_s)

    def step(self, stopped: Callable[[], bool] = lambda: False) -> float | None:
        """Queue the jobs that are due or asked for, and run the next one unless halted.

        Args:
            stopped: returns whether the scheduler was asked to end. If it returns True after a run,
                no end of this run is written to the journal, so that a restart resumes it.

        Returns:
            None if a job was run, also if its process was killed; else how long to wait until the
            next call, s, at most `POLL_S`.
        """
        self._collect()
        self._take_additions()
        job = self._next()
        if job is not None:
            self._run(job, stopped)
            return None
        now = self._hands.now()
        times = [self._schedule.next_time(entry, now) for entry in self._schedule.entries]
        times += [job.not_before for job in self.state.queue]
        waits = [(time - now).total_seconds() for time in times if time is not None]
        return max(0.0, min([*waits, POLL_S]))

    def _keep(self, kind: str, **details: Any) -> None:
        self.state.take(self._journal.write(kind, **details))

    def _collect(self) -> None:
        """Put the jobs that have become due since the last call into the queue.

        The first call ever for a schedule only notes the time.
        """
        now = self._hands.now()
        first, self._started = not self._started, True
        if self.state.collected is None:
            self._keep("collected", upto=now.isoformat())
            return
        back = self.state.collected - now
        if back > timedelta(seconds=self._schedule.grace_s):
            # Without this nothing would be due until the clock is where it was, which may be years.
            was, upto = f"{self.state.collected:%Y-%m-%d %H:%M}", now.isoformat()
            self._keep("collected", upto=upto, set_back_s=back.total_seconds())
            self._hands.say(f"the clock was set back from {was} UTC; times count from now on")
            return
        due: list[dict[str, Any]] = []
        missed: dict[str, int] = {}
        found = False
        for entry in self._schedule.entries:
            times = self._schedule.times(entry, self.state.collected, now)
            found = found or bool(times)
            kept, lost = self._chosen(entry, times, now if first else None)
            for time in kept:
                id_ = f"{entry.name}@{time.isoformat()}"
                due.append(details_of(Job(id_, entry.name, entry.campaign, entry.rig, time)))
            if lost:
                missed[entry.name] = lost
                self._hands.say(f"{entry.name}: missed {lost}; policy {entry.missed}")
        if found:
            # One entry holds time and jobs: a kill between two entries would repeat or lose a job.
            self._keep("collected", upto=now.isoformat(), due=due, missed=missed)

    def _chosen(
        self, entry: Entry, times: list[datetime], restarted: datetime | None
    ) -> tuple[list[datetime], int]:
        """Return those of an entry's due times that are to be run, and how many are missed.

        With the policy `run_all` all of them are run. Otherwise only the last one is, and none if a
        job of this entry, not counting retries, waits already. With the policy `skip`, times that
        passed while the scheduler did not run are missed if they are longer ago than the
        schedule's `grace_s`.

        Args:
            entry: the schedule's entry.
            times: the entry's due times since the last call, in their order.
            restarted: the present time in the first call after a restart; None later.
        """
        if entry.missed is Missed.RUN_ALL or not times:
            return times, 0
        kept = times
        if restarted is not None and entry.missed is Missed.SKIP:
            grace = timedelta(seconds=self._schedule.grace_s)
            kept = [time for time in times if restarted - time <= grace]
        if any(job.entry == entry.name and job.attempt == 1 for job in self.state.queue):
            kept = []
        kept = kept[-1:]
        return kept, len(times) - len(kept)

    def _take_additions(self) -> None:
        now = self._hands.now()
        for request in asked_of(self._schedule.folder):
            if request["id"] in self.state.taken:
                continue
            if request.get("resume"):
                self._keep("resumed", id=request["id"], **_author_of(request))
                self._hands.say("resumed")
                continue
            self._keep("added", **details_of(_asked_for(request, now)), **_author_of(request))

    def _next(self) -> Job | None:
        """Return the job to run now; None if there is none, or while the schedule is halted.

        A job that was begun and has not ended comes before those of the queue. A job whose rig is
        busy lets those after it pass.
        """
        if self.state.halted:
            return None
        present = self.state.present
        if present is not None:
            return present if self._is_free(present) else None
        now = self._hands.now()
        for job in [*self.state.queue]:
            if job.not_before is not None and job.not_before > now:
                continue
            if self._is_free(job):
                return job
        return None

    def _is_free(self, job: Job) -> bool:
        """Return whether a job's rig can be used; if not, keep why, and give up after a time.

        The time is `wait_for_rig_s` of the job's entry. A job that was begun waits without end.
        """
        why = self._hands.busy(job)
        if not why:
            return True
        known = self.state.busy.get(job.id)
        if known is None or known.why != why:
            self._keep("busy", id=job.id, why=why)
            self._hands.say(f"{job.entry}: waits for its rig: {why}")
        entry = self._entries.get(job.entry)
        limit_s = None if entry is None else entry.wait_for_rig_s
        waited = self._hands.now() - self.state.busy[job.id].since
        if job.folder is None and limit_s is not None and waited >= timedelta(seconds=limit_s):
            self._give_up(job, f"its rig was busy for {limit_s:g} s: {why}")
        return False

    def _give_up(self, job: Job, why: str) -> None:
        """End a job that was not begun as its rig stayed busy; it is retried as a failed run is."""
        retry = self._retry(job, EXIT_FAILED)
        self._keep("gave_up", id=job.id, exit_code=EXIT_BAD_INPUT, retry=retry, why=why)
        self._hands.say(f"{job.entry}: not run, {why}")
        self._follow(job, EXIT_BAD_INPUT)

    def _follow(self, job: Job, exit_code: int) -> None:
        """Make the trend page and run the hook after a job; keep and say what went wrong."""
        problem = self._hands.after(job, exit_code)
        if problem:
            self._keep("problem", id=job.id, what=problem)
            self._hands.say(problem)

    def _run(self, job: Job, stopped: Callable[[], bool]) -> None:
        folder = job.folder or str(new_path(self._schedule.folder, job.entry, self._hands.now()))
        again = " again" if job.folder else ""
        self._hands.say(f"{job.entry}: begun{again} in {folder}")
        self._keep("begun", id=job.id, folder=folder)
        assert self.state.present is not None
        present = self.state.present
        exit_code = self._hands.run(present, self._entries.get(job.entry))
        if stopped():
            # The stop of the scheduler also ended the run, which is resumed after a restart.
            return
        if exit_code < 0 and present.resumes < MOST_RESUMES:
            self._hands.say(f"{job.entry}: killed by signal {-exit_code}; goes on")
            return
        if exit_code == EXIT_BAD_INPUT and self._hands.busy(present):
            # Another program was faster: the run has left nothing, and waits as others do.
            self._keep("put_back", id=job.id)
            return
        halted = ""
        if self._schedule.halt and (exit_code == EXIT_STOPPED or exit_code < 0):
            # It tripped, was stopped or was killed: somebody should look at the rig first.
            halted = f"{job.entry} tripped or was stopped (exit code {exit_code})"
        # One entry holds all three: a kill between two entries would lose a retry or a halt.
        retry = self._retry(job, exit_code)
        self._keep("ended", id=job.id, exit_code=exit_code, retry=retry, halted=halted)
        self._hands.say(f"{job.entry}: ended with exit code {exit_code}")
        self._follow(present, exit_code)
        if halted:
            self._hands.say(f"halted: {halted}; look at the rig, then rig schedule resume")

    def _retry(self, job: Job, exit_code: int) -> dict[str, Any] | None:
        """Return the job that repeats a failed run, as details for the journal.

        The result is None if the run did not fail, if the schedule has no entry for the job, or if
        the entry allows no further retry.
        """
        entry = self._entries.get(job.entry)
        if exit_code != EXIT_FAILED or entry is None or job.attempt > entry.retries:
            return None
        later = self._hands.now() + timedelta(seconds=entry.retry_after_s)
        id_ = f"{job.id.partition('#')[0]}#{job.attempt + 1}"
        return details_of(replace(job, id=id_, attempt=job.attempt + 1, not_before=later))
