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
        id: tells it from all others.
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
    """What a schedule's journal tells; `take` goes on with it entry by entry.

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
        told = entry.told
        match entry.kind:
            case "collected":
                self.collected = datetime.fromisoformat(told["upto"])
                self.queue += [_job(job) for job in told.get("due", ())]
                for name, count in told.get("missed", {}).items():
                    self.missed[name] = self.missed.get(name, 0) + int(count)
            case "added":
                self.taken.add(told["id"])
                self.queue.append(_job(told))
            case "begun":
                self._begin(told)
            case "ended" if self.present is not None:
                at = datetime.fromisoformat(entry.at)
                self.history.append(Ended(self.present, int(told["exit_code"]), at))
                self.present = None
                self.halted = str(told.get("halted") or "")
                if told.get("retry"):
                    self.queue.insert(0, _job(told["retry"]))
            case "resumed":
                self.taken.add(str(told.get("id", "")))
                self.halted = ""

    def _begin(self, told: Any) -> None:
        mine = [job for job in self.queue if job.id == told["id"]]
        if mine:
            self.queue.remove(mine[0])
            self.present = replace(mine[0], folder=told["folder"])
        elif self.present is not None:
            self.present = replace(self.present, resumes=self.present.resumes + 1)


def told_of(job: Job) -> dict[str, Any]:
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


def _job(told: Any) -> Job:
    later = told.get("not_before")
    return Job(
        id=str(told["id"]),
        entry=str(told["entry"]),
        campaign=str(told["campaign"]),
        rig=told["rig"],
        due=datetime.fromisoformat(told["due"]),
        attempt=int(told.get("attempt", 1)),
        not_before=None if later is None else datetime.fromisoformat(later),
    )


def state_of(entries: Iterable[Entry]) -> ScheduleState:
    """Return where a schedule stands by its journal."""
    state = ScheduleState()
    for entry in entries:
        state.take(entry)
    return state
