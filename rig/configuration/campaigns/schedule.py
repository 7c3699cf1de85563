"""Schedule files list campaigns and the times at which they are run; both are checked here."""

from collections.abc import Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Final, Literal
from zoneinfo import ZoneInfo

from cronsim import CronSim, CronSimError
from pydantic import Field as SchemaField

from rig.configuration.reading import (
    Located,
    Physical,
    Schema,
    Sources,
    read_mapping,
    reference_in,
    resolve,
    shown,
)

from .campaign import read_campaign

MOST_TIMES: Final = 1000
"""Most times of an entry that are returned at once, in case a schedule did not run for years."""


class Missed(StrEnum):
    """A policy on an entry's times that passed while the scheduler was not running.

    They are skipped, or the campaign is run once, or once for each of them.
    """

    SKIP = "skip"
    RUN_ONCE = "run_once"
    RUN_ALL = "run_all"


@dataclass(frozen=True)
class Entry:
    """A campaign and its times, which exactly one of `cron`, `every_s` and `at` gives.

    Attributes:
        name: name of the entry; the names of its runs' folders begin with it.
        campaign: path or name of the campaign, as `rig run` takes it.
        rig: path or name of the rig; None for the campaign's own.
        cron: times as five cron fields, in the schedule's time zone.
        every_s: period between the beginnings of two runs, counted from `start`.
        at: the one time at which the campaign is run.
        start: time before which the campaign is not run; if None, `every_s` counts from 1970.
        missed: what to do about missed times.
        retries: how often a run that failed (exit code 1) is run again.
        retry_after_s: time to wait before a failed run is run again.
        pace: pace of a simulated rig, as `rig run` takes it; None for the rig's own.
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
        name: name of the schedule.
        path: path of its file; relative paths of campaigns and rigs count from the file's folder.
        folder: folder of its runs and its journal.
        zone: time zone of its times.
        entries: the campaigns with their times.
        hook: command that is executed after each run, as words that may hold `{run}` and other
            placeholders; empty for none.
        grace_s: how late the scheduler may notice a time without the time counting as missed.
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
        """Return an entry's times later than `after` and up to `upto`, in UTC, oldest first.

        Both have a time zone. Only the newest `MOST_TIMES` are returned if there are more.
        """
        found: list[datetime] = []
        for time in self._times_from(entry, after):
            if time > upto:
                break
            found.append(time)
            if len(found) > MOST_TIMES:
                found.pop(0)
        return found

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

    name: str
    description: str = ""
    runs: str = "runs"
    timezone: str = "UTC"
    grace: Annotated[float, Physical("s", 0.0, 86400.0, 300.0)] = 300.0
    halt: bool = True
    hook: Any = None
    defaults: Any = None
    entries: Any


class EntryFile(Schema):
    """Keys of an entry; keys that all entries share may be written once under `defaults`."""

    name: str
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


def load_schedule(path: Path) -> Schedule:
    """Return the schedule in a file, after its campaigns are checked against their rigs.

    Raises:
        ConfigError: lists every problem of the file and of all files it refers to.
    """
    sources = Sources()
    schedule = read_schedule(path.resolve(), sources)
    sources.problems.raise_if_any()
    assert schedule is not None
    return schedule


def read_schedule(path: Path, sources: Sources) -> Schedule | None:
    """Return the schedule in a file; None if it cannot be read.

    Problems are added to those of `sources`. Entries with problems are left out, so that the
    schedule may only be used if there are none.
    """
    root = sources.read_yaml(path)
    file = read_mapping(ScheduleFile, root, sources.problems) if root is not None else None
    if root is None or file is None:
        return None
    zone = _zone(root, file.timezone, sources)
    entries = tuple(_entries(root, zone, sources))
    return Schedule(
        name=file.name,
        path=path,
        folder=(path.parent / Path(file.runs).expanduser()).resolve(),
        zone=zone,
        entries=entries,
        hook=_hook(root.get("hook"), sources),
        grace_s=file.grace,
        halt=file.halt,
    )


def _zone(root: Located, name: str, sources: Sources) -> ZoneInfo:
    try:
        return ZoneInfo(name)
    except (OSError, ValueError, KeyError):
        entry = root.find(("timezone",))
        remedy = "write one such as UTC or Europe/Helsinki"
        sources.problems.add(entry.place, "timezone", name, "is not a known time zone", remedy)
        return ZoneInfo("UTC")


def _hook(item: Located | None, sources: Sources) -> tuple[str, ...]:
    if item is None:
        return ()
    words = [word.value for word in item.elements()]
    if not words or not all(isinstance(word, str | int | float) for word in words):
        remedy = 'write a list of words, such as ["notify", "{campaign}", "{exit_code}"]; no shell'
        sources.problems.add(item.place, "hook", shown(item), "is no command", remedy)
        return ()
    return tuple(str(word) for word in words)


def _entries(root: Located, zone: ZoneInfo, sources: Sources) -> Iterator[Entry]:
    items, defaults = root.get("entries"), root.get("defaults")
    shared = dict(defaults.items()) if defaults is not None else {}
    if items is None or not items.elements():
        place = (items or root).place
        remedy = "write at least one: `- {name: ..., campaign: ..., cron: ...}`"
        sources.problems.add(place, "entries", "", "is not a list of entries", remedy)
        return
    names: set[str] = set()
    for item in items.elements():
        if isinstance(item.value, dict):
            item = Located({**shared, **item.value}, item.place, item.name)
        before = sources.problems.reported
        file = read_mapping(EntryFile, item, sources.problems)
        if file is None:
            continue
        if file.name in names:
            remedy = "choose another name"
            sources.problems.add(item.place, "name", file.name, "is given twice", remedy)
        names.add(file.name)
        entry = _entry(item, file, zone, sources)
        if sources.problems.reported == before:
            yield entry


def _entry(item: Located, file: EntryFile, zone: ZoneInfo, sources: Sources) -> Entry:
    given = [key for key in ("cron", "every", "at") if item.get(key) is not None]
    if len(given) != 1:
        value = f"has {' and '.join(given)}" if given else "has no time"
        remedy = "give one of cron, every and at"
        sources.problems.add(item.place, file.name, "", value, remedy)
    if file.cron is not None:
        _check_cron(item.find(("cron",)), file.cron, sources)
    campaign, rig = _check_campaign(item, sources)
    return Entry(
        name=file.name,
        campaign=campaign,
        rig=rig,
        cron=file.cron,
        every_s=file.every,
        at=_time(item.get("at"), zone, sources),
        start=_time(item.get("start"), zone, sources),
        missed=file.missed,
        retries=file.retries,
        retry_after_s=file.retry_after,
        pace=file.pace,
    )


def _check_cron(entry: Located, text: str, sources: Sources) -> None:
    try:
        if len(text.split()) != 5:
            raise CronSimError("five fields are needed")
        next(CronSim(text, datetime(2026, 1, 1, tzinfo=UTC)))
    except (CronSimError, StopIteration) as error:
        remedy = "write minute, hour, day, month, weekday, such as 30 2 * * MON-FRI"
        why = str(error).lower() or "never comes"
        sources.problems.add(entry.place, "cron", text, f"is no time: {why}", remedy)


def _check_campaign(item: Located, sources: Sources) -> tuple[str, str | None]:
    """Read and check an entry's campaign and rig, and return their absolute paths.

    The rig is None if the entry names none. Problems are added to those of `sources`.
    """
    entry, rig_entry = item.get("campaign"), item.get("rig")
    folder = item.place.path.parent
    reference, rig = reference_in(entry), reference_in(rig_entry)
    rig_path = None
    if rig is not None:
        rig_path = resolve("rig", rig, folder, sources.problems, rig_entry)
    if reference is not None:
        path = resolve("campaign", reference, folder, sources.problems, entry)
        if path is not None and (rig is None or rig_path is not None):
            read_campaign(path, sources, rig_path)
            reference = str(path)
    return reference or "", None if rig_path is None else str(rig_path)


def _time(item: Located | None, zone: ZoneInfo, sources: Sources) -> datetime | None:
    if item is None:
        return None
    value = item.value
    try:
        time = value if isinstance(value, datetime) else datetime.fromisoformat(str(value))
    except ValueError:
        remedy = "write 2026-12-01 03:00, in the schedule's time zone"
        sources.problems.add(item.place, item.name, shown(item), "is no date and time", remedy)
        return None
    return (time if time.tzinfo else time.replace(tzinfo=zone)).astimezone(UTC)
