"""Schedule files list campaigns and the times at which they are run; both are checked here."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from itertools import takewhile
from pathlib import Path
from typing import Annotated, Any, Final, Literal
from zoneinfo import ZoneInfo

from cronsim import CronSim, CronSimError
from pydantic import Field as SchemaField

from rig.configuration.reading import (
    Located,
    Name,
    Physical,
    Schema,
    Sources,
    read_mapping,
    reference_in,
    resolve,
)
from rig.configuration.rigs import OFF, read_stream

from .campaign import read_campaign

MOST_TIMES: Final = 1000
"""Most times of an entry that are returned at once, in case a schedule did not run for years."""


class Missed(StrEnum):
    """A policy on an entry's times that passed while the scheduler was not running."""

    SKIP = "skip"
    """The campaign is not run for them."""
    RUN_ONCE = "run_once"
    """The campaign is run once for all of them together."""
    RUN_ALL = "run_all"
    """The campaign is run once for each of them."""


@dataclass(frozen=True)
class Entry:
    """A campaign and its times, which exactly one of `cron`, `every_s` and `at` gives.

    Attributes:
        name: name of the entry; the names of its runs' folders begin with it.
        campaign: path or name of the campaign, as `rig run` takes it.
        rig: path or name of the rig; None for the campaign's own.
        cron: times as five cron fields, in the schedule's time zone.
        every_s: period of the times in s, counted from `start`.
        at: the one time at which the campaign is run.
        start: time before which the campaign is not run; if None, `every_s` counts from 1970.
        missed: what to do about missed times.
        retries: how often, at most, a run that failed (exit code 1) is run again.
        retry_after_s: time in s to wait before a failed run is run again.
        pace: pace of a simulated rig, as `rig run` takes it; None for the rig's own.
        wait_for_rig_s: longest time in s for which a run waits for a rig that another program uses;
            None to wait as long as it takes, which piles nothing up, as of each entry only one run
            waits.
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
    wait_for_rig_s: float | None = None


@dataclass(frozen=True)
class Schedule:
    """Campaigns and their times, on one rig at a time.

    Attributes:
        name: name of the schedule.
        path: path of its file; relative paths of campaigns and rigs count from the file's folder.
        folder: folder of its runs and its journal.
        zone: time zone of its times.
        entries: the campaigns with their times.
        hook: command that is executed after each run, as words that may hold `{run}` and other
            placeholders; empty for none.
        grace_s: how late, in s, the scheduler may notice a time before it counts as missed.
        halt: whether a run that tripped or was stopped halts the schedule.
        stream: profile of the runs' live stream, as `rig run` takes it; "" for its default.
    """

    name: str
    path: Path
    folder: Path
    zone: ZoneInfo
    entries: tuple[Entry, ...]
    hook: tuple[str, ...] = ()
    grace_s: float = 300.0
    halt: bool = True
    stream: str = ""

    def times(self, entry: Entry, after: datetime, upto: datetime) -> list[datetime]:
        """Return an entry's times later than `after` and up to `upto`, in UTC, oldest first.

        Both bounds must have a time zone. If there are more than `MOST_TIMES` times, only the
        newest `MOST_TIMES` are returned.
        """
        times = takewhile(lambda time: time <= upto, self._times_from(entry, after))
        return list(deque(times, MOST_TIMES))

    def next_time(self, entry: Entry, after: datetime) -> datetime | None:
        """Return an entry's first time after `after`, in UTC; None if no time is left."""
        return next(self._times_from(entry, after), None)

    def _times_from(self, entry: Entry, after: datetime) -> Iterator[datetime]:
        """Yield an entry's times after `after`, in UTC, oldest first, possibly without end."""
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


class ScheduleFile(Schema):
    """Keys of a schedule file."""

    name: Name
    description: str = ""
    runs: str = "runs"
    timezone: str = "UTC"
    grace: Annotated[float, Physical("s", 0.0, 86400.0, 300.0)] = 300.0
    halt: bool = True
    hook: Any = None
    stream: str | Literal[False] | None = None
    defaults: Any = None
    entries: Any


class EntryFile(Schema):
    """Keys of an entry; keys that all entries share may be written once under `defaults`."""

    name: Name
    campaign: str
    rig: str | None = None
    cron: str | None = None
    every: Annotated[float | None, Physical("s", 1.0, 366 * 86400.0, 3600.0)] = None
    at: Any = None
    start: Any = None
    missed: Missed = Missed.RUN_ONCE
    retries: Annotated[int, SchemaField(ge=0, le=10)] = 0
    retry_after: Annotated[float, Physical("s", 0.0, 86400.0, 60.0)] = 60.0
    pace: Literal["real", "fast"] | None = None
    wait_for_rig: Annotated[float | None, Physical("s", 0.0, 366 * 86400.0, 7200.0)] = None


def load_schedule(path: Path) -> Schedule:
    """Return the schedule in a file, after its campaigns are checked against their rigs.

    Raises:
        ConfigError: lists every problem of the file and of all files it refers to.
    """
    sources = Sources()
    root = sources.read_yaml(path.resolve())
    return sources.finished(read_schedule(root) if root is not None else None)


def read_schedule(root: Located) -> Schedule | None:
    """Return the schedule that a file describes; None if a key that it needs is missing or wrong.

    Problems are recorded. Entries with problems are left out, so that the schedule may only be used
    if no problem was recorded.
    """
    file = read_mapping(ScheduleFile, root)
    if file is None:
        return None
    zone = _zone(root, file.timezone)
    return Schedule(
        name=file.name,
        path=root.place.path,
        folder=root.path_to(file.runs).resolve(),
        zone=zone,
        entries=tuple(_entries(root, zone)),
        hook=_hook(root.get("hook")),
        grace_s=file.grace,
        halt=file.halt,
        stream=_stream(root.get("stream")),
    )


def _stream(item: Located | None) -> str:
    """Return the path of a stream's profile, which is checked, or "off"; "" if none is given."""
    # In YAML a bare `off` is the truth value.
    if item is not None and (item.value is False or reference_in(item) == OFF):
        return OFF
    path = resolve("stream", item)
    root = None if item is None or path is None else item.sources.read_yaml(path)
    if root is not None:
        read_stream(root)
    return str(path or "")


def _zone(root: Located, name: str) -> ZoneInfo:
    try:
        return ZoneInfo(name)
    except (OSError, ValueError, KeyError):
        remedy = "write one such as UTC or Europe/Helsinki"
        root.refuse("is not a known time zone", remedy, name, "timezone")
        return ZoneInfo("UTC")


def _hook(item: Located | None) -> tuple[str, ...]:
    if item is None:
        return ()
    words = [word.value for word in item.elements()]
    if not words or not all(isinstance(word, str | int | float) for word in words):
        remedy = 'write a list of words, such as ["notify", "{campaign}", "{exit_code}"]; no shell'
        item.refuse("is no command", remedy)
        return ()
    return tuple(str(word) for word in words)


def _entries(root: Located, zone: ZoneInfo) -> Iterator[Entry]:
    items, problems = root.get("entries"), root.sources.problems
    if items is None or not items.elements():
        remedy = "write at least one: `- {name: ..., campaign: ..., cron: ...}`"
        (items or root).refuse("is not a list of entries", remedy, "", name="entries")
        return
    names: set[str] = set()
    for element in items.elements():
        item = element.completed_by(root.get("defaults"))
        before = problems.reported
        file = read_mapping(EntryFile, item)
        if file is None:
            continue
        if file.name in names:
            item.refuse("is given twice", "choose another name", file.name, name="name")
        names.add(file.name)
        entry = _entry(item, file, zone)
        if problems.reported == before:
            yield entry


def _entry(item: Located, file: EntryFile, zone: ZoneInfo) -> Entry:
    given = [key for key in ("cron", "every", "at") if item.get(key) is not None]
    if len(given) != 1:
        limit = f"has {' and '.join(given)}" if given else "has no time"
        item.refuse(limit, "give one of cron, every and at", "", name=file.name)
    if file.cron is not None:
        _check_cron(item, file.cron)
    campaign, rig = _check_campaign(item)
    return Entry(
        name=file.name,
        campaign=campaign,
        rig=rig,
        cron=file.cron,
        every_s=file.every,
        at=_time(item.get("at"), zone),
        start=_time(item.get("start"), zone),
        missed=file.missed,
        retries=file.retries,
        retry_after_s=file.retry_after,
        pace=file.pace,
        wait_for_rig_s=file.wait_for_rig,
    )


def _check_cron(item: Located, text: str) -> None:
    try:
        if len(text.split()) != 5:
            raise CronSimError("five fields are needed")
        next(CronSim(text, datetime(2026, 1, 1, tzinfo=UTC)))
    except (CronSimError, StopIteration) as error:
        remedy = "write minute, hour, day, month, weekday, such as 30 2 * * MON-FRI"
        why = str(error).lower() or "never comes"
        item.refuse(f"is no time: {why}", remedy, text, "cron")


def _check_campaign(item: Located) -> tuple[str, str | None]:
    """Read and check an entry's campaign, on the entry's rig if it names one; record the problems.

    Return the absolute paths of campaign and rig. The campaign is "" if it is not found, the rig
    None if the entry names none or it is not found.
    """
    rig = item.get("rig")
    rig_path, path = resolve("rig", rig), resolve("campaign", item.get("campaign"))
    root = item.sources.read_yaml(path) if reference_in(rig) is None or rig_path else None
    if root is not None:
        read_campaign(root, rig_path)
    return str(path or ""), None if rig_path is None else str(rig_path)


def _time(item: Located | None, zone: ZoneInfo) -> datetime | None:
    if item is None:
        return None
    value = item.value
    try:
        time = value if isinstance(value, datetime) else datetime.fromisoformat(str(value))
    except ValueError:
        remedy = "write 2026-12-01 03:00, in the schedule's time zone"
        item.refuse("is no date and time", remedy)
        return None
    return (time if time.tzinfo else time.replace(tzinfo=zone)).astimezone(UTC)
