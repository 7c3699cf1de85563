"""Where a schedule stands by its journal: what waits, what ran, and whether it is halted."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from datetime import datetime
from typing import Any, Final

from rig.runner.run_folder import Entry

JOURNAL: Final = "schedule.jsonl"


@dataclass(frozen=True)
class Job:
    """A run that is due.

    Attributes:
        id: distinguishes the job from all others.
        entry: name of the schedule's entry, or of what was added.
        campaign: as `rig run` takes it.
        rig: likewise; None for the campaign's own.
        due: when it was to begin.
        attempt: from 1 on.
        not_before: when a retry may begin.
        folder: of its run, once it has begun.
        resumes: how often its run was begun again after a crash.
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
    """A run that has ended."""

    job: Job
    exit_code: int
    at: datetime


@dataclass
class ScheduleState:
    """What a schedule's journal says; `take` goes on with it entry by entry.

    Attributes:
        collected: up to when the entries' times are in the queue; None before the first start.
        queue: what waits, in its order.
        present: what was begun and has not ended.
        history: what has ended, oldest first.
        missed: how many times were missed, by the entry's name.
        taken: what was taken from the file of additions, by its id.
        halted: why nothing is begun; empty if something is.
    """

    collected: datetime | None = None
    queue: list[Job] = field(default_factory=list)
    present: Job | None = None
    history: list[Ended] = field(default_factory=list)
    missed: dict[str, int] = field(default_factory=dict)
    taken: set[str] = field(default_factory=set)
    halted: str = ""

    def take(self, entry: Entry) -> None:
        """Take the next entry of the journal."""
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
                self._begin(details)
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

    def _begin(self, details: Any) -> None:
        mine = [job for job in self.queue if job.id == details["id"]]
        if mine:
            self.queue.remove(mine[0])
            self.present = replace(mine[0], folder=details["folder"])
        elif self.present is not None:
            self.present = replace(self.present, resumes=self.present.resumes + 1)


def details_of(job: Job) -> dict[str, Any]:
    """Return a job as a journal's entry holds it."""
    return {
        "id": job.id,
        "entry": job.entry,
        "campaign": job.campaign,
        "rig": job.rig,
        "due": job.due.isoformat(),
        "attempt": job.attempt,
        "not_before": None if job.not_before is None else job.not_before.isoformat(),
    }


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
    """Return where a schedule stands by its journal."""
    state = ScheduleState()
    for entry in entries:
        state.take(entry)
    return state
