"""Campaign files: tests, the rig they run on, and the model and detector that judge them."""

from collections.abc import Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from datetime import date
from math import isinf
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from estimator.baselines import Baseline, BaselineError, load_baseline
from estimator.filters import DEFAULT_FILTER, FILTERS
from faults import Campaign, CampaignTest, OnFault
from rig.configuration.models import named_model, read_model
from rig.configuration.reading import (
    Located,
    Name,
    Physical,
    Schema,
    Sources,
    Under,
    asked,
    read_in,
    read_mapping,
    resolve,
    suggestion,
)
from rig.configuration.rigs import Rig, read_rig
from rig.plant import Model

from .campaign_tests import CampaignTestFile, TestLoopFile, read_tests
from .conditions import condition_files, read_conditions


class CampaignFile(Schema):
    """Keys of a campaign file; the mappings under them have their own schemas."""

    name: Name
    description: str = ""
    rig: str
    model: str = "nominal"
    detector: Annotated[Any, Under(lambda: (DetectorFile,))] = None
    on_fault: OnFault = OnFault.IGNORE
    conditions: Annotated[Any, Under(condition_files, many=True)] = None
    defaults: Annotated[Any, Under(lambda: (CampaignTestFile,), optional=True)] = None
    tests: Annotated[Any, Under(lambda: (CampaignTestFile, TestLoopFile), many=True)]


class DetectorFile(Schema):
    """Keys of `detector` in a campaign file: the detector that judges the tests."""

    filter: str = DEFAULT_FILTER
    false_alarms_per_day: Annotated[float, Physical("", 1e-3, 1e3, 1.0)] = 1.0
    baseline: str | None = None


def load_campaign(
    reference: str | Path,
    rig_override: str | Path | None = None,
    base: Path | None = None,
    day: date | None = None,
) -> tuple[Campaign, Rig]:
    """Return a campaign, checked against its rig, and the rig.

    Args:
        reference: path of a file, or name of a campaign.
        rig_override: path or name of the rig to use instead of the campaign's.
        base: folder from which the relative paths and names of these arguments are resolved; the
            working directory if None.
        day: the day on which calibrations of transducers are to hold; today if None.

    Raises:
        ConfigError: lists every problem of the campaign, its rig, models and setpoint files.
    """
    sources = Sources()
    base = base or Path.cwd()
    path = resolve("campaign", asked("campaign", reference, sources), base)
    chosen = None if rig_override is None else asked("rig", rig_override, sources)
    rig_path = resolve("rig", chosen, base)
    root = sources.read_yaml(path)
    return sources.finished(read_campaign(root, rig_path, day) if root is not None else None)


def read_campaign(
    root: Located, rig_path: Path | None = None, day: date | None = None
) -> tuple[Campaign, Rig] | None:
    """Return the campaign that a file describes, and its rig; None if there is any problem.

    Problems are recorded in `root.sources`; the result is None also if a problem was recorded there
    before. `rig_path` is the file of another rig to use instead of the one that `root` names, `day`
    the day on which calibrations of transducers are to hold, today if None.
    """
    sources = root.sources
    file = read_mapping(CampaignFile, root)
    rig_root = sources.read_yaml(rig_path or resolve("rig", root.get("rig")))
    rig = read_rig(rig_root, day) if rig_root is not None else None
    model = read_in("model", named_model(root), read_model)
    detector = _read_detector(root.get("detector"))
    baseline = _read_baseline(root.find("detector", "baseline"), detector, model)
    conditions = read_conditions(root.get("conditions"), rig)
    tests = _read_tests(root, rig)
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
        conditions=conditions,
    )
    return campaign, rig


def _read_detector(item: Located | None) -> DetectorFile | None:
    if item is None:
        return DetectorFile()
    file = read_mapping(DetectorFile, item)
    if file is not None and file.filter not in FILTERS:
        remedy = suggestion(file.filter, list(FILTERS), "filters")
        item.refuse("is not a known filter", remedy, key="filter")
    return file


def _read_baseline(
    entry: Located, detector: DetectorFile | None, model: Model | None
) -> Baseline | None:
    """Return the baseline that the key `baseline` of a detector names; None if it names none.

    The path in `detector` is relative to the campaign's folder. If the file cannot be used, record
    the problems at `entry`, the value of the key, and return None, as without detector or model.
    """
    if detector is None or model is None or not detector.baseline:
        return None
    path = entry.path_to(detector.baseline).resolve()
    if entry.sources.read_bytes(path, entry) is None:
        return None
    try:
        return load_baseline(path, model)
    except BaselineError as error:
        for problem in error.problems:
            entry.refuse(problem, value="")
    return None


def _read_tests(root: Located, rig: Rig | None) -> tuple[CampaignTest, ...]:
    defaults, tests, on_fault = (root.get(key) for key in ("defaults", "tests", "on_fault"))
    if defaults is not None and not isinstance(defaults.value, dict):
        defaults.refuse("is not a mapping", "write keys of tests below it")
    elif defaults is not None and (name := defaults.get("name")) is not None:
        name.refuse("is a default", "give every test its own")
    if tests is None:
        return ()
    if not tests.elements():
        tests.refuse("is not a list of tests", "write at least one test: `- name: ...`")
    if on_fault is not None and on_fault.value in list(OnFault):
        given = dict(defaults.items()) if defaults is not None else {}
        defaults = root.with_value({"on_fault": on_fault, **given})
    return read_tests(tests, defaults, rig)


def plain(value: Any) -> Any:
    """Return a value as dicts, lists, strings, numbers and None, which JSON can hold.

    A dataclass becomes a dict of its fields, with the name of its class under "type", so that a
    sine differs from a chirp; fields that its repr hides are left out, and so are those with the
    metadata `UNLESS_USUAL` while they have their default. A named tuple becomes a dict of its
    fields. Infinity, which means "never" or "no limit", becomes None; NaN stays, and any
    other object becomes its text.
    """
    if is_dataclass(value) and not isinstance(value, type):
        public = {
            f.name: plain(getattr(value, f.name)) for f in fields(value) if _is_told(f, value)
        }
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


def _is_told(item: Field[Any], of: object) -> bool:
    """Return whether `plain` has a field of the object `of`."""
    usual = item.default if item.default_factory is MISSING else item.default_factory()
    is_usual = "unless_usual" in item.metadata and getattr(of, item.name) == usual
    return item.repr and not is_usual
