"""A configuration of any kind is checked here, and a campaign is dry-run as well."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from faults import Campaign
from rig.configuration.campaigns import (
    CampaignFile,
    PlannedTest,
    Schedule,
    ScheduleFile,
    plan_campaign,
    read_campaign,
    read_schedule,
)
from rig.configuration.models import ModelFile, read_model, term_lines
from rig.configuration.reading import (
    FOLDERS,
    ConfigError,
    Kind,
    Located,
    Place,
    Problems,
    Sources,
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
    Map,
    Rig,
    RigFile,
    StreamFile,
    read_dbc,
    read_map,
    read_rig,
    read_stream,
    stream_lines,
)
from rig.configuration.sweeps import Sweep, SweepFile, read_sweep, sweep_lines
from rig.io import ChannelLimit, DriverSpec, RegisterMap
from rig.plant import CATALOGUE, Model
from rig.recording import unit_of
from rig.stream import StreamSettings

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
}


_ORDER: Final[tuple[Kind, ...]] = (
    "campaign", "rig", "model", "map", "dbc", "stream", "schedule", "sweep",
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
        rig_time_s: how long a campaign keeps its rig busy, with settling; 0 for other kinds.
    """

    kind: Kind
    path: Path
    name: str
    summary: tuple[str, ...]
    tests: tuple[PlannedTest, ...] = ()
    rig_time_s: float = 0.0

    @property
    def warnings(self) -> tuple[str, ...]:
        """Warnings of the tests' plans (`PlannedTest.warnings`), each after its test's name."""
        return tuple(f"{test.name}: {warning}" for test in self.tests for warning in test.warnings)

    def __str__(self) -> str:
        """Return the report as text."""
        lines = [f"{display_path(self.path)}: {self.kind} {self.name}", *self.summary]
        return "\n".join(lines + [line for test in self.tests for line in test.lines()])


def check(
    reference: str | Path, rig_override: str | Path | None = None, base: Path | None = None
) -> CheckReport:
    """Check a configuration, given by path or by name, dry-run a campaign, and return a report.

    Args:
        reference: path of a file, or name of a configuration.
        rig_override: path or name of a rig to check a campaign against, instead of its own; other
            kinds do not use it.
        base: folder from which relative paths are resolved; the working directory if None.

    Raises:
        ConfigError: lists every problem of the file and of all files it refers to.
    """
    base = base or Path.cwd()
    sources = Sources()
    path, kind = _locate(str(reference), base, sources)
    if path is None or kind is None:
        raise ConfigError(sources.problems.found)
    if kind == "campaign":
        chosen = None
        if rig_override is not None:
            chosen = resolve("rig", str(rig_override), base, sources.problems)
        loaded = read_campaign(path, sources, chosen)
        report = None if loaded is None else _report_campaign(path, *loaded)
    else:
        read, reported = _KINDS[kind]
        found = read(path, sources)
        report = None if found is None else reported(path, found)
    sources.problems.raise_if_any()
    assert report is not None
    return report


def _locate(reference: str, base: Path, sources: Sources) -> tuple[Path | None, Kind | None]:
    """Return the file that a reference means, and the kind of configuration in it.

    Either is None if it cannot be found; a problem is recorded then.
    """
    if is_path(reference):
        folder = Path(reference).parent.name
        guess = next((kind for kind, name in FOLDERS.items() if name == folder), _ORDER[0])
        path = resolve(guess, reference, base, sources.problems)
        if path is not None and path.suffix == ".dbc":
            return path, "dbc"
        root = sources.read_yaml(path) if path is not None else None
        return path, _kind_of(root, sources.problems) if root is not None else None
    for kind in _ORDER:
        found = resolve(kind, reference, base, Problems())
        if found is not None:
            return found, kind
    names = [name for kind in _ORDER for name in available(kind, base)]
    remedy = suggestion(reference, names, "configurations")
    limit = "is not known"
    sources.problems.add(Place(Path(reference), 0, 0), "configuration", "", limit, remedy)
    return None, None


def _kind_of(root: Located, problems: Problems) -> Kind | None:
    """Return the kind of which the file has the most keys.

    If it has no key of any kind, record a problem and return None.
    """
    keys = {key for key, _ in root.items()} - {"name", "description", "parent"}
    scores = {kind: len(keys & known) for kind, known in _KEYS.items()}
    best = max(scores, key=lambda kind: scores[kind])
    if scores[best] > 0 or root.get("parent") is not None:
        return best if scores[best] > 0 else "model"
    remedy = f"write a {', '.join(_KEYS)}; see the shipped ones"
    problems.add(Place(root.place.path, 1, 1), "file", "", "is no known configuration", remedy)
    return None


def _report_model(path: Path, model: Model) -> CheckReport:
    effects = [f"  effect {name}: {CATALOGUE[name].equation}" for name in model.effects]
    summary = (*(effects or ["  no effects"]), *term_lines(model))
    return CheckReport("model", path, model.name, summary)


def _report_rig(path: Path, rig: Rig) -> CheckReport:
    limits = rig.limits
    summary = (
        f"  {rig.description}",
        f"  backend {rig.backend}, pace {rig.pace}, plant {rig.plant.name} with "
        f"{', '.join(rig.plant.effects) or 'no effects'}",
        f"  limits {show(limits.position_min_m, 'm')} to {show(limits.position_max_m, 'm')}, "
        f"{show(limits.command_V, 'V')}, {show(limits.pressure_max_Pa, 'Pa')}",
        f"  faults it can inject: {', '.join(rig.injectable) or 'none'}",
        *(_limit_line(limit) for limit in rig.ladder),
        *(_driver_line(spec, rig.loop.rate) for spec in rig.drivers),
    )
    return CheckReport("rig", path, rig.name, summary)


def _limit_line(limit: ChannelLimit) -> str:
    ends = (
        f"{word} {show(end, unit_of(limit.channel))}"
        for word, end in (("below", limit.low), ("above", limit.high))
        if isfinite(end)
    )
    lasting = f" for {show(limit.for_s, 's')}" if limit.for_s else ""
    return f"  {limit.action.replace('_', ' ')} if {limit.channel} is {' or '.join(ends)}{lasting}"


def _driver_line(spec: DriverSpec, loop_rate: float) -> str:
    line = f"  driver {spec.name}: {spec.type}, {spec.kind}, {show(spec.rate_hz, 'Hz')}"
    if spec.kind == "fast" and spec.rate_hz < loop_rate:
        line += ", slower than the loop: values held in between"
    return line


def _report_map(path: Path, device_map: Map) -> CheckReport:
    summary: tuple[str, ...]
    if isinstance(device_map, RegisterMap):
        summary = (
            f"  {device_map.device}, {show(device_map.rate, 'Hz')} by "
            f"{' or '.join(device_map.exchange)}",
            f"  reads {', '.join(register.signal for register in device_map.read)}",
            f"  writes {', '.join(register.signal for register in device_map.written)}",
        )
    else:
        addresses = (f"{key} {value}" for key, value in asdict(device_map).items())
        summary = (f"  bypass valves, first addresses: {', '.join(addresses)}",)
    return CheckReport("map", path, path.stem, summary)


def _report_dbc(path: Path, database: "Database") -> CheckReport:
    summary = tuple(
        f"  message {message.name} ({message.frame_id:#x}): "
        f"{', '.join(signal.name for signal in message.signals)}"
        for message in database.messages
    )
    return CheckReport("dbc", path, path.stem, summary)


def _report_schedule(path: Path, schedule: Schedule) -> CheckReport:
    now = datetime.now(UTC)
    lines = [f"  runs in {display_path(schedule.folder)}, times in {schedule.zone.key}"]
    for entry in schedule.entries:
        time = schedule.next_time(entry, now)
        shown = "never" if time is None else f"{time.astimezone(schedule.zone):%Y-%m-%d %H:%M}"
        lines.append(
            f"  {entry.name}: next {shown}, {display_path(Path(entry.campaign))}; missed "
            f"{entry.missed}, retries {entry.retries}"
        )
    return CheckReport("schedule", path, schedule.name, tuple(lines))


def _report_sweep(path: Path, sweep: Sweep) -> CheckReport:
    return CheckReport("sweep", path, sweep.name, tuple(sweep_lines(sweep)))


def _report_campaign(path: Path, campaign: Campaign, rig: Rig) -> CheckReport:
    minutes, seconds = divmod(round(campaign.rig_time_s), 60)
    known = f" and the baseline {campaign.baseline_file}" if campaign.baseline else ""
    summary = (
        f"  {campaign.description}",
        f"  {len(campaign.tests)} tests on the rig {campaign.rig_name}, judged by "
        f"{campaign.filter_name} with the model {campaign.model.name}{known}",
        f"  rig time {minutes} min {seconds} s",
    )
    tests = plan_campaign(campaign, rig)
    return CheckReport("campaign", path, campaign.name, summary, tests, campaign.rig_time_s)


def _report_stream(path: Path, stream: StreamSettings) -> CheckReport:
    return CheckReport("stream", path, path.stem, stream_lines(stream))


_Read = Callable[[Path, Sources], Any]
_Report = Callable[[Path, Any], CheckReport]
_KINDS: Final[dict[Kind, tuple[_Read, _Report]]] = {
    "model": (read_model, _report_model),
    "rig": (read_rig, _report_rig),
    "map": (read_map, _report_map),
    "schedule": (read_schedule, _report_schedule),
    "sweep": (read_sweep, _report_sweep),
    "dbc": (read_dbc, _report_dbc),
    "stream": (read_stream, _report_stream),
}
"""The functions that read and report each kind of configuration, except campaigns."""
