"""A configuration of any kind is checked here, and a campaign is dry-run as well."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import asdict, dataclass
from datetime import UTC, date, datetime, timedelta
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from faults import Campaign
from rig.configuration.campaigns import (
    CampaignFile,
    PlannedTest,
    Schedule,
    ScheduleFile,
    load_campaign,
    plan_campaign,
    read_schedule,
)
from rig.configuration.models import ModelFile, read_model, term_lines
from rig.configuration.reading import (
    FOLDERS,
    ConfigError,
    Kind,
    Located,
    Place,
    Sources,
    asked,
    available,
    display_path,
    is_path,
    options_of,
    resolve,
    show,
    suggestion,
)
from rig.configuration.rigs import (
    MAPS,
    SOON,
    Map,
    Rig,
    RigFile,
    StreamFile,
    TransducerFile,
    as_shown,
    calibration_warnings,
    corrected_twice,
    read_dbc,
    read_map,
    read_rig,
    read_stream,
    read_transducer,
    stream_lines,
    transducer_lines,
)
from rig.configuration.sweeps import SweepFile, read_sweep, sweep_lines
from rig.io import ChannelLimit, RegisterMap, calibration_doubts, today
from rig.plant import CATALOGUE, Model
from rig.recording import unit_of

if TYPE_CHECKING:
    from cantools.database.can import Database

_KEYS: Final[dict[Kind, frozenset[str]]] = {
    "campaign": frozenset(CampaignFile.model_fields),
    "rig": frozenset(RigFile.model_fields),
    "model": frozenset(ModelFile.model_fields),
    "schedule": frozenset(ScheduleFile.model_fields),
    "sweep": frozenset(SweepFile.model_fields),
    "map": frozenset(key for kind in MAPS for key in options_of(kind)),
    "stream": frozenset(StreamFile.model_fields),
    "transducer": frozenset(TransducerFile.model_fields),
}


_ORDER: Final[tuple[Kind, ...]] = (
    "campaign", "rig", "model", "map", "dbc", "stream", "schedule", "sweep", "transducer",
)  # fmt: skip
"""Kinds of configuration, in the order in which a name without a kind is looked up."""


@dataclass(frozen=True)
class CheckReport:
    """A report on a configuration that has no mistakes.

    Attributes:
        kind: kind of the configuration.
        path: path of its file.
        name: its name, or the file's name without suffix where it has none.
        summary: a few lines that describe the configuration.
        tests: plan of every test of a campaign; empty for other kinds.
        calibration_warnings: warnings about the calibrations of a rig, or of a campaign's rig, and
            about a campaign's baseline.
        rig: lines that describe the rig of a campaign, with its limits; empty for other kinds.
    """

    kind: Kind
    path: Path
    name: str
    summary: tuple[str, ...]
    tests: tuple[PlannedTest, ...] = ()
    calibration_warnings: tuple[str, ...] = ()
    rig: tuple[str, ...] = ()

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings about the rig's calibrations, then those of the tests' plans.

        The latter (`PlannedTest.warnings`) stand each after its test's name.
        """
        of_tests = (f"{each.test.name}: {text}" for each in self.tests for text in each.warnings)
        return (*self.calibration_warnings, *of_tests)

    def __str__(self) -> str:
        """Return the report as text."""
        lines = [f"{display_path(self.path)}: {self.kind} {self.name}", *self.summary]
        lines += [f"  warning: {warning}" for warning in self.calibration_warnings]
        return "\n".join(lines + [line for test in self.tests for line in test.lines()])


def check(
    reference: str | Path,
    rig_override: str | Path | None = None,
    base: Path | None = None,
    day: date | None = None,
) -> CheckReport:
    """Check a configuration, given by path or by name, and return a report on it.

    A campaign is dry-run too; the warnings are part of the report.

    Args:
        reference: path of a file, or name of a configuration.
        rig_override: path or name of a rig to check a campaign against, instead of its own; other
            kinds do not use it.
        base: folder from which relative paths and names are resolved; the working directory if
            None.
        day: the day on which calibrations of transducers are to hold; today if None.

    Raises:
        ConfigError: lists every problem of the file and of all files it refers to.
    """
    base, day = base or Path.cwd(), day or today()
    sources = Sources()
    path, kind = _locate(str(reference), base, sources)
    if path is None or kind is None:
        raise ConfigError(sources.problems.found)
    if kind == "dbc":
        database = sources.finished(read_dbc(path, sources))
        return CheckReport(kind, path, path.stem, tuple(_dbc_lines(database)))
    if kind == "campaign":
        return _report_campaign(path, *load_campaign(path, rig_override, base, day), day)
    root = sources.read_yaml(path)
    if kind == "rig":
        rig = sources.finished(read_rig(root, day) if root is not None else None)
        doubts = calibration_warnings(rig.calibrations, rig.limits, day)
        return CheckReport(kind, path, rig.name, tuple(_rig_lines(rig)), (), tuple(doubts))
    if kind == "transducer":
        each = sources.finished(read_transducer(root) if root is not None else None)
        doubts = calibration_doubts((each,), day, SOON)
        lines = tuple(transducer_lines(each))
        return CheckReport(kind, path, path.stem, lines, (), tuple(doubts))
    read, lines_of = _KINDS[kind]
    found = sources.finished(read(root) if root is not None else None)
    return CheckReport(kind, path, getattr(found, "name", path.stem), tuple(lines_of(found)))


def _locate(reference: str, base: Path, sources: Sources) -> tuple[Path | None, Kind | None]:
    """Return the file that a reference means, and the kind of configuration in it.

    Either is None if it cannot be found; a problem is recorded then.
    """
    if is_path(reference):
        folder = Path(reference).parent.name
        guess = next((kind for kind, name in FOLDERS.items() if name == folder), _ORDER[0])
        path = resolve(guess, asked(guess, reference, sources), base)
        if path is not None and path.suffix == ".dbc":
            return path, "dbc"
        root = sources.read_yaml(path)
        return path, _kind_of(root) if root is not None else None
    for kind in _ORDER:
        found = resolve(kind, asked(kind, reference, Sources()), base)
        if found is not None:
            return found, kind
    names = [name for kind in _ORDER for name in available(kind, base)]
    remedy = suggestion(reference, names, "configurations")
    place = Place(Path(reference), 0, 0)
    sources.problems.add(place, "configuration", "", "is not known", remedy)
    return None, None


def _kind_of(root: Located) -> Kind | None:
    """Return the kind of configuration of which the file has the most keys.

    The keys `name`, `description` and `parent`, which several kinds have, do not count, but a file
    with a parent and no other known key is a model. If the file has no known key, record a problem
    and return None.
    """
    keys = {key for key, _ in root.items()} - {"name", "description", "parent"}
    scores = {kind: len(keys & known) for kind, known in _KEYS.items()}
    best = max(scores, key=lambda kind: scores[kind])
    if scores[best] > 0 or root.get("parent") is not None:
        return best if scores[best] > 0 else "model"
    remedy = f"write a {', '.join(_KEYS)}; see the shipped ones"
    root.refuse("is no known configuration", remedy, "")
    return None


def _model_lines(model: Model) -> Iterator[str]:
    effects = [f"  effect {name}: {CATALOGUE[name].equation}" for name in model.effects]
    yield from effects or ["  no effects"]
    yield from term_lines(model)


def _rig_lines(rig: Rig) -> Iterator[str]:
    limits = rig.limits
    yield f"  {rig.description}"
    yield (
        f"  backend {rig.backend}, pace {rig.pace}, plant {rig.plant.name} with "
        f"{', '.join(rig.plant.effects) or 'no effects'}"
    )
    position = as_shown([limits.position_min_m, limits.position_max_m], "position_m", "m")
    (pressure,) = as_shown([limits.pressure_max_Pa], "pressure_1_Pa", "Pa")
    yield f"  limits {' to '.join(position)}, {show(limits.command_V, 'V')}, {pressure}"
    yield f"  faults it can inject: {', '.join(rig.injectable) or 'none'}"
    yield from map(_limit_line, rig.ladder)
    for spec in rig.drivers:
        is_slower = spec.kind == "fast" and spec.rate_hz < rig.loop.rate
        remark = ", slower than the loop: values held in between" if is_slower else ""
        rate = show(spec.rate_hz, "Hz")
        yield f"  driver {spec.name}: {spec.type}, {spec.kind}, {rate}{remark}"
    for each in rig.calibrations:
        yield (
            f"  {each}: of {each.date}, until {each.valid_until}, largest correction "
            f"{show(each.largest_correction, unit_of(each.channel))}"
        )
    if rig.uncalibrated:
        yield f"  without calibration: {', '.join(rig.uncalibrated)}"


def _limit_line(limit: ChannelLimit) -> str:
    shown = as_shown([limit.low, limit.high], limit.channel, unit_of(limit.channel))
    ends = (
        f"{word} {text}"
        for word, end, text in zip(("below", "above"), (limit.low, limit.high), shown, strict=True)
        if isfinite(end)
    )
    lasting = f" for {show(limit.for_s, 's')}" if limit.for_s else ""
    return f"  {limit.action.replace('_', ' ')} if {limit.channel} is {' or '.join(ends)}{lasting}"


def _map_lines(device_map: Map) -> Iterator[str]:
    if isinstance(device_map, RegisterMap):
        exchange = " or ".join(device_map.exchange)
        yield f"  {device_map.device}, {show(device_map.rate, 'Hz')} by {exchange}"
        yield f"  reads {', '.join(register.signal for register in device_map.read)}"
        yield f"  writes {', '.join(register.signal for register in device_map.written)}"
    else:
        addresses = (f"{key} {value}" for key, value in asdict(device_map).items())
        yield f"  bypass valves, first addresses: {', '.join(addresses)}"


def _dbc_lines(database: "Database") -> Iterator[str]:
    for message in database.messages:
        signals = ", ".join(signal.name for signal in message.signals)
        yield f"  message {message.name} ({message.frame_id:#x}): {signals}"


def _schedule_lines(schedule: Schedule) -> Iterator[str]:
    now = datetime.now(UTC)
    yield f"  runs in {display_path(schedule.folder)}, times in {schedule.zone.key}"
    for entry in schedule.entries:
        time = schedule.next_time(entry, now)
        shown = "never" if time is None else f"{time.astimezone(schedule.zone):%Y-%m-%d %H:%M}"
        yield (
            f"  {entry.name}: next {shown}, {display_path(Path(entry.campaign))}; missed "
            f"{entry.missed}, retries {entry.retries}"
        )


def _report_campaign(path: Path, campaign: Campaign, rig: Rig, day: date) -> CheckReport:
    minutes, seconds = divmod(round(campaign.rig_time_s), 60)
    known = f" and the baseline {campaign.baseline_file}" if campaign.baseline else ""
    summary = (
        f"  {campaign.description}",
        f"  {len(campaign.tests)} tests on the rig {campaign.rig_name}, judged by "
        f"{campaign.filter_name} with the model {campaign.model.name}{known}",
        f"  rig time {minutes} min {seconds} s",
    )
    plan, lasting = plan_campaign(campaign, rig), timedelta(seconds=campaign.rig_time_s)
    doubts = (
        *calibration_warnings(rig.calibrations, rig.limits, day, lasting),
        *corrected_twice(rig.calibrations, campaign.model),
        *filter(None, (campaign.baseline_doubt,)),
    )
    of_rig = tuple(_rig_lines(rig))
    return CheckReport("campaign", path, campaign.name, summary, plan, doubts, of_rig)


_Read = Callable[[Located], Any]
_Lines = Callable[[Any], Iterable[str]]
_KINDS: Final[dict[Kind, tuple[_Read, _Lines]]] = {
    "model": (read_model, _model_lines),
    "map": (read_map, _map_lines),
    "schedule": (read_schedule, _schedule_lines),
    "sweep": (read_sweep, sweep_lines),
    "stream": (read_stream, stream_lines),
}
"""The functions that read a kind of YAML file and describe it in lines.

Campaigns, rigs and transducers are left out, as warnings about them depend on the day."""
