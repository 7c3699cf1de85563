"""Campaign files: tests, the rig they run on, and the model and detector that judge them."""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from math import isinf
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from estimator.filters import DEFAULT_FILTER, FILTERS
from estimator.leaks import Baseline, BaselineError, load_baseline
from faults import Campaign, CampaignTest, OnFault
from rig.configuration.models import read_model
from rig.configuration.reading import (
    Located,
    Physical,
    Schema,
    Sources,
    read_mapping,
    resolve,
    resolve_in,
    shown,
    suggestion,
)
from rig.configuration.rigs import Rig, read_rig
from rig.plant import Model

from .campaign_tests import read_tests
from .conditions import read_conditions


class CampaignFile(Schema):
    """Keys of a campaign file; the mappings under them have their own schemas."""

    name: str
    description: str = ""
    rig: str
    model: str = "nominal"
    detector: Any = None
    on_fault: OnFault = OnFault.IGNORE
    conditions: Any = None
    defaults: Any = None
    tests: Any


class DetectorFile(Schema):
    """Keys of the detector that judges a campaign."""

    filter: str = DEFAULT_FILTER
    false_alarms_per_day: Annotated[float, Physical("", 1e-3, 1e3, 1.0)] = 1.0
    baseline: str | None = None


def load_campaign(
    reference: str | Path, rig_override: str | Path | None = None, base: Path | None = None
) -> tuple[Campaign, Rig]:
    """Return a campaign, checked against its rig, and the rig.

    Args:
        reference: path of a file, or name of a campaign.
        rig_override: path or name of the rig to use instead of the campaign's.
        base: folder from which the relative paths and names of these arguments are resolved; the
            working directory if None.

    Raises:
        ConfigError: lists every problem of the campaign, its rig, models and setpoint files.
    """
    sources = Sources()
    base = base or Path.cwd()
    path = resolve("campaign", str(reference), base, sources.problems)
    rig_path = None
    if rig_override is not None:
        rig_path = resolve("rig", str(rig_override), base, sources.problems)
    loaded = read_campaign(path, sources, rig_path) if path is not None else None
    sources.problems.raise_if_any()
    assert loaded is not None
    return loaded


def read_campaign(
    path: Path, sources: Sources, rig_path: Path | None = None
) -> tuple[Campaign, Rig] | None:
    """Return the campaign in a file, and its rig; None if there is any problem.

    The problems are added to those of `sources`, where earlier ones count too. `rig_path` replaces
    the rig that the file names.
    """
    root = sources.read_yaml(path)
    if root is None:
        return None
    file = read_mapping(CampaignFile, root, sources.problems)
    rig = _read_rig(root, rig_path, sources)
    model = _read_model(root, sources)
    detector = _read_detector(root, sources)
    baseline = _read_baseline(root.find(("detector", "baseline")), detector, model, sources)
    conditions = read_conditions(root.get("conditions"), rig, sources.problems)
    tests = _read_tests(root, path, rig, sources)
    if sources.problems.found or file is None or rig is None or model is None or detector is None:
        return None
    campaign = Campaign(
        name=file.name,
        description=file.description.strip(),
        rig_name=rig.name,
        model=model,
        filter_name=detector.filter,
        false_alarms_per_day=detector.false_alarms_per_day,
        tests=tests,
        baseline=baseline,
        baseline_file=detector.baseline or "",
        source_files={str(source): digest for source, digest in sources.sha256.items()},
        resolved=resolved(file, rig, model, detector, tests),
        conditions=conditions,
    )
    return campaign, rig


def _read_rig(root: Located, chosen: Path | None, sources: Sources) -> Rig | None:
    chosen = chosen or resolve_in("rig", root.get("rig"), sources.problems)
    return read_rig(chosen, sources) if chosen is not None else None


def _read_model(root: Located, sources: Sources) -> Model | None:
    entry = root.get("model") or Located("nominal", root.place, "model")
    found = resolve_in("model", entry, sources.problems)
    return read_model(found, sources) if found is not None else None


def _read_detector(root: Located, sources: Sources) -> DetectorFile | None:
    item = root.get("detector")
    if item is None:
        return DetectorFile()
    file = read_mapping(DetectorFile, item, sources.problems)
    if file is not None and file.filter not in FILTERS:
        entry = item.find(("filter",))
        remedy = suggestion(file.filter, list(FILTERS), "filters")
        sources.problems.add(entry.place, "filter", shown(entry), "is not a known filter", remedy)
    return file


def _read_baseline(
    entry: Located, detector: DetectorFile | None, model: Model | None, sources: Sources
) -> Baseline | None:
    """Return the detector's baseline; None if it names none or an unusable one.

    Its path is relative to the campaign's folder. Problems are added to those of `sources`.
    """
    if detector is None or model is None or not detector.baseline:
        return None
    path = (entry.place.path.parent / Path(detector.baseline).expanduser()).resolve()
    if sources.read_bytes(path, entry) is None:
        return None
    try:
        return load_baseline(path, model.name)
    except BaselineError as error:
        for problem in error.problems:
            sources.problems.add(entry.place, entry.name, "", problem)
    return None


def _read_tests(
    root: Located, path: Path, rig: Rig | None, sources: Sources
) -> tuple[CampaignTest, ...]:
    defaults, tests = root.get("defaults"), root.get("tests")
    if defaults is not None:
        _check_defaults(defaults, sources)
    if tests is None:
        return ()
    if not tests.elements():
        remedy = "write at least one test: `- name: ...`"
        sources.problems.add(tests.place, "tests", shown(tests), "is not a list of tests", remedy)
    return read_tests(tests, _with_on_fault(defaults, root), path.parent, rig, sources)


def _with_on_fault(defaults: Located | None, root: Located) -> Located | None:
    """Return the defaults of tests, completed by the campaign's `on_fault` if that is valid."""
    on_fault = root.get("on_fault")
    if on_fault is None or on_fault.value not in list(OnFault):
        return defaults
    given = dict(defaults.items()) if defaults is not None else {}
    return Located({"on_fault": on_fault, **given}, root.place, "defaults")


def _check_defaults(defaults: Located, sources: Sources) -> None:
    if not isinstance(defaults.value, dict):
        remedy = "write keys of tests below it"
        sources.problems.add(
            defaults.place, "defaults", shown(defaults), "is not a mapping", remedy
        )
    elif (name := defaults.get("name")) is not None:
        remedy = "give every test its own"
        sources.problems.add(name.place, "name", shown(name), "is a default", remedy)


def resolved(
    file: CampaignFile,
    rig: Rig,
    model: Model,
    detector: DetectorFile,
    tests: tuple[CampaignTest, ...],
) -> dict[str, Any]:
    """Return a campaign, its rig and its model as plain SI values, for recordings and results.

    Conditions, and the content of the baseline, are left out.
    """
    return {
        "name": file.name,
        "description": file.description.strip(),
        "rig": plain(rig),
        "model": plain(model),
        "detector": detector.model_dump(exclude_none=True),
        "tests": [plain(test) for test in tests],
    }


def plain(value: Any) -> Any:
    """Return a value as dicts, lists, strings, numbers and None, which JSON can hold.

    A dataclass becomes a dict of its fields, with the name of its class under "type", so that a
    sine differs from a chirp; fields that its repr hides are left out. Infinity, which means
    "never" or "no limit", becomes None; NaN stays, and any other object becomes its text.
    """
    if is_dataclass(value) and not isinstance(value, type):
        public = {f.name: plain(getattr(value, f.name)) for f in fields(value) if f.repr}
        return {"type": type(value).__name__, **public}
    if isinstance(value, tuple) and hasattr(value, "_asdict"):
        return plain(value._asdict())
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float) and isinf(value):
        return None
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)
