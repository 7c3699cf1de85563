"""Checks a configuration of any kind; a campaign is dry-run as well."""

from dataclasses import dataclass
from pathlib import Path

from rig.plant.effects import CATALOGUE
from rig.plant.model import Model

from .campaign import CampaignFile, read_campaign
from .document import Located, Sources
from .dry_run import PlannedTest, plan_campaign
from .lookup import FOLDERS, Kind, available, is_path, resolve
from .model import ModelFile, read_model
from .problems import ConfigError, Place, Problems, display_path, suggestion
from .quantities import show
from .rig import Rig, RigFile, read_rig

_SCHEMAS: dict[Kind, type[CampaignFile] | type[RigFile] | type[ModelFile]] = {
    "campaign": CampaignFile,
    "rig": RigFile,
    "model": ModelFile,
}


@dataclass(frozen=True)
class CheckReport:
    """What a configuration without mistakes amounts to.

    Attributes:
        summary: a few lines on the whole, for any kind.
        tests: of a campaign, every test as it will run.
        rig_time_s: of a campaign, how long the rig is busy, settling included.
    """

    kind: Kind
    path: Path
    name: str
    summary: tuple[str, ...]
    tests: tuple[PlannedTest, ...] = ()
    rig_time_s: float = 0.0

    @property
    def warnings(self) -> tuple[str, ...]:
        """What will not go as commanded, with the test it concerns."""
        return tuple(f"{test.name}: {warning}" for test in self.tests for warning in test.warnings)

    def __str__(self) -> str:
        """Return the report as text."""
        lines = [f"{display_path(self.path)}: {self.kind} {self.name}", *self.summary]
        return "\n".join(lines + [line for test in self.tests for line in test.lines()])


def check(
    reference: str | Path, rig_override: str | Path | None = None, base: Path | None = None
) -> CheckReport:
    """Check a model, rig or campaign, given by path or by name, and dry-run a campaign.

    Args:
        reference: path of a file, or name of a shipped configuration.
        rig_override: rig to check a campaign against, instead of its own.
        base: folder that relative paths count from; the working directory.

    Raises:
        ConfigError: every problem of the file and of all it refers to.
    """
    base = base or Path.cwd()
    sources = Sources()
    path, kind = _locate(str(reference), base, sources)
    if path is None or kind is None:
        raise ConfigError(sources.problems.found)
    report: CheckReport | None = None
    if kind == "model":
        model = read_model(path, sources)
        report = _report_model(path, model) if model else None
    elif kind == "rig":
        rig = read_rig(path, sources)
        report = _report_rig(path, rig) if rig else None
    else:
        chosen = None
        if rig_override is not None:
            chosen = resolve("rig", str(rig_override), base, sources.problems)
        report = _report_campaign(path, sources, chosen)
    sources.problems.raise_if_any()
    assert report is not None
    return report


def _locate(reference: str, base: Path, sources: Sources) -> tuple[Path | None, Kind | None]:
    """Return the file a reference means, and the kind of configuration it holds."""
    order: tuple[Kind, ...] = ("campaign", "rig", "model")
    if is_path(reference):
        folder = Path(reference).parent.name
        guess = next((kind for kind, name in FOLDERS.items() if name == folder), order[0])
        path = resolve(guess, reference, base, sources.problems)
        root = sources.read_yaml(path) if path is not None else None
        return path, _kind_of(root, sources.problems) if root is not None else None
    for kind in order:
        found = resolve(kind, reference, base, Problems())
        if found is not None:
            return found, kind
    names = [name for kind in order for name in available(kind, base)]
    remedy = suggestion(reference, names, "configurations")
    limit = "is not known"
    sources.problems.add(Place(Path(reference), 0, 0), "configuration", "", limit, remedy)
    return None, None


def _kind_of(root: Located, problems: Problems) -> Kind | None:
    """Return the kind whose own keys the file has most of."""
    keys = {key for key, _ in root.items()} - {"name", "description", "parent"}
    scores: dict[Kind, int] = {
        kind: len(keys & set(schema.model_fields)) for kind, schema in _SCHEMAS.items()
    }
    best = max(scores, key=lambda kind: scores[kind])
    if scores[best] > 0 or root.get("parent") is not None:
        return best if scores[best] > 0 else "model"
    listing = ", ".join(FOLDERS)
    remedy = f"write a {listing.replace(', campaign', ' or campaign')}; see the shipped ones"
    problems.add(Place(root.place.path, 1, 1), "file", "", "is no known configuration", remedy)
    return None


def _report_model(path: Path, model: Model) -> CheckReport:
    effects = [f"  effect {name}: {CATALOGUE[name].equation}" for name in model.effects]
    return CheckReport("model", path, model.name, tuple(effects) or ("  no effects",))


def _report_rig(path: Path, rig: Rig) -> CheckReport:
    valves = [*rig.bypass_valves, *(["return_blockage"] if rig.return_valve else [])]
    limits = rig.limits
    summary = (
        f"  {rig.description}",
        f"  backend {rig.backend}, pace {rig.pace}, plant {rig.plant.name} with "
        f"{', '.join(rig.plant.effects) or 'no effects'}",
        f"  limits {show(limits.position_min_m, 'm')} to {show(limits.position_max_m, 'm')}, "
        f"{show(limits.command_V, 'V')}, {show(limits.pressure_max_Pa, 'Pa')}",
        f"  faults it can inject: {', '.join(valves) or 'none'}",
    )
    return CheckReport("rig", path, rig.name, summary)


def _report_campaign(path: Path, sources: Sources, rig_path: Path | None) -> CheckReport | None:
    loaded = read_campaign(path, sources, rig_path)
    if loaded is None:
        return None
    campaign, rig = loaded
    minutes, seconds = divmod(round(campaign.rig_time_s), 60)
    summary = (
        f"  {campaign.description}",
        f"  {len(campaign.tests)} tests on the rig {campaign.rig_name}, judged by "
        f"{campaign.filter_name} with the model {campaign.model.name}",
        f"  rig time {minutes} min {seconds} s",
    )
    tests = plan_campaign(campaign, rig)
    return CheckReport("campaign", path, campaign.name, summary, tests, campaign.rig_time_s)
