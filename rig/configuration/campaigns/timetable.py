"""A schedule as data: which campaigns are run when, and the times that follow from it."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from itertools import islice
from pathlib import Path
from typing import Final
from zoneinfo import ZoneInfo

from cronsim import CronSim

MOST_TIMES: Final = 1000
"""Times of an entry that are looked at, at once: a schedule that slept for years is not all run."""


class Missed(StrEnum):
    """What is done about times at which the scheduler did not run."""

    SKIP = "skip"
    RUN_ONCE = "run_once"
    RUN_ALL = "run_all"


@dataclass(frozen=True)
class Entry:
    """A campaign and its times: one of `cron`, `every_s` and `at`.

    Attributes:
        name: of the entry; its runs' folders begin with it.
        campaign: path or name, as `rig run` takes it.
        rig: path or name; the campaign's own if None.
        cron: five fields, in the schedule's time zone.
        every_s: between the beginnings of two runs, from `start` on.
        at: once.
        start: nothing before it; `every_s` counts from there.
        missed: what to do about missed times.
        retries: how often a run that failed (exit code 1) is run again.
        retry_after_s: how long to wait before.
        pace: of simulated rigs, as `rig run` takes it.
    """

    name: str
    campaign: str
    rig: str | None = None
    cron: str | None = None
    every_s: float | None = None
    at: datetime | None = None
    start: datetime | None = None
    missed: Missed = Missed.RUN_ONCE
    retries: int = 0
    retry_after_s: float = 60.0
    pace: str | None = None


@dataclass(frozen=True)
class Schedule:
    """Campaigns and their times, on one rig at a time.

    Attributes:
        path: of its file; relative campaigns and rigs count from its folder.
        folder: where its runs and its journal are.
        zone: time zone of its times.
        hook: command that is run after each run, with `{run}` and so on in it; empty for none.
        grace_s: how late a time may be seen and still counts as kept.
        halt: whether a run that tripped or was stopped halts the schedule.
    """

    name: str
    path: Path
    folder: Path
    zone: ZoneInfo
    entries: tuple[Entry, ...]
    hook: tuple[str, ...] = ()
    grace_s: float = 300.0
    halt: bool = True

    def times(self, entry: Entry, after: datetime, upto: datetime) -> list[datetime]:
        """Return an entry's times later than `after` and up to `upto`, UTC; the newest, if many."""
        found: list[datetime] = []
        for time in self._times_from(entry, after):
            if time > upto:
                break
            found.append(time)
            if len(found) > MOST_TIMES:
                found.pop(0)
        return found

    def next_time(self, entry: Entry, after: datetime) -> datetime | None:
        """Return an entry's next time, UTC; None if there is none any more."""
        return next(islice(self._times_from(entry, after), 1), None)

    def _times_from(self, entry: Entry, after: datetime) -> Iterator[datetime]:
        """Yield an entry's times later than `after`."""
        if entry.start is not None and after < entry.start:
            after = entry.start - timedelta(microseconds=1)
        if entry.at is not None:
            yield from (time for time in (entry.at,) if time > after)
        elif entry.every_s is not None:
            step = timedelta(seconds=entry.every_s)
            zero = entry.start or datetime(1970, 1, 1, tzinfo=UTC)
            time = zero + (max((after - zero) // step, -1) + 1) * step
            while True:
                yield time
                time += step
        elif entry.cron is not None:
            for time in CronSim(entry.cron, after.astimezone(self.zone)):
                yield time.astimezone(UTC)
