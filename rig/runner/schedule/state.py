"""Derives the state of a schedule from its journal: jobs that wait, runs that ended, and a halt."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass, field, replace
from datetime import datetime
from typing import Any, Final

from rig.runner.run_folder import Entry

JOURNAL: Final = "schedule.jsonl"


@dataclass(frozen=True)
class Job:
    """A run of a campaign that is due.

    Attributes:
        id: distinguishes the job from all others.
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
        taken: ids of the requests that were taken from the file of additions.
        halted: why no job is begun; empty if the schedule is not halted.
    """

    collected: datetime | None = None
    queue: list[Job] = field(default_factory=list)
    present: Job | None = None
    history: list[Ended] = field(default_factory=list)
    missed: dict[str, int] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)
    halted: str = ""

    def take(self, entry: Entry) -> None:
        """Update the state by the next entry of the journal.

        An entry of an unknown kind changes nothing.
        """
        details = entry.details
        match entry.kind:
            case "collected":
                self.collected = datetime.fromisoformat(details["upto"])
                self.queue += [_job(job) for job in details.get("due", ())]
                for name, count in details.get("missed", {}).items():
                    self.missed[name] = self.missed.get(name, 0) + int(count)
            case "added":
                self.taken.add(details["id"])
                self.queue.append(_job(details))
            case "begun":
                mine = next((job for job in self.queue if job.id == details["id"]), None)
                if mine is not None:
                    self.queue.remove(mine)
                    self.present = replace(mine, folder=details["folder"])
                elif self.present is not None:
                    self.present = replace(self.present, resumes=self.present.resumes + 1)
            case "ended" if self.present is not None:
                at = datetime.fromisoformat(entry.at)
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


def _job(details: Any) -> Job:
    later = details.get("not_before")
    return Job(
        id=str(details["id"]),
        entry=str(details["entry"]),
        campaign=str(details["campaign"]),
        rig=details["rig"],
        due=datetime.fromisoformat(details["due"]),
        attempt=int(details.get("attempt", 1)),
        not_before=None if later is None else datetime.fromisoformat(later),
    )


def state_of(entries: Iterable[Entry]) -> ScheduleState:
    """Return the state of a schedule after all entries of its journal."""
    state = ScheduleState()
    for entry in entries:
        state.take(entry)
    return state
