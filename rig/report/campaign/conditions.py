"""What a test asked of the rig, read from its recording's metadata and said with units."""

import json
import re
from collections.abc import Mapping
from typing import Any, Final

from rig.loop import TIMING, in_short
from rig.plant import Parameters
from rig.recording import Recording

_UNITS_BY_ENDING: Final = (
    ("_hz_per_s", "Hz/s"),
    ("_hz", "Hz"),
    ("_rad", "rad"),
    ("_s", "s"),
)
_FEW: Final = 8
"""Values of a list that are still worth reading out."""


def assumed_parameters(metadata: Mapping[str, Any]) -> Parameters | None:
    """Return the parameters that the filter assumed, as the runner records them under `model`.

    Parameters of effects that the recording does not know yet are absent from it: they keep the
    value at which the effect is. None where nothing readable is recorded.
    """
    try:
        told = dict(metadata["model"]["parameters"])
        known = {name: float(told[name]) for name in Parameters._fields if name in told}
    except (KeyError, TypeError, ValueError):
        return None
    return Parameters(**known) if "piston_area" in known else None


def conditions_of(metadata: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Return the setpoint and load of a recorded test as (name, text), as far as told."""
    test = metadata.get("test")
    if not isinstance(test, Mapping):
        return []
    told = []
    setpoint, load = test.get("setpoint"), test.get("load")
    if isinstance(setpoint, Mapping):
        told.append(("Setpoint", _setpoint(setpoint)))
    if isinstance(load, Mapping):
        told.append(("Load", _load(load)))
    return told


def loop_conditions(recording: Recording) -> list[tuple[str, str]]:
    """Return how the loop of a rig on hardware kept its time as (name, text), as far as told."""
    told = []
    loop = recording.metadata.get("loop")
    if isinstance(loop, Mapping):
        grants = [grant for grant in loop.get("grants", ()) if isinstance(grant, Mapping)]
        shown = [
            grant.get("name", "") if grant.get("granted") else f"without {grant.get('name', '')}"
            for grant in grants
        ]
        told.append(("Loop ran with", ", ".join(shown) or "nothing granted"))
    for event in recording.events:
        if event.kind == TIMING:
            told.append(("Loop timing", in_short(json.loads(event.text))))
    return told


def _setpoint(setpoint: Mapping[str, Any]) -> str:
    metres = setpoint.get("quantity", "position") == "position"
    parts = [
        f"{name.replace('_', ' ')} {text}"
        for key, value in setpoint.items()
        if key not in ("type", "quantity") and value is not None
        for name, text in [_with_unit(key, value, metres)]
    ]
    kind = re.sub(r"(?<=[a-z])(?=[A-Z])", " ", str(setpoint.get("type", "setpoint"))).lower()
    return f"{kind}: {', '.join(parts)}" if parts else kind


def _with_unit(key: str, value: Any, metres: bool) -> tuple[str, str]:
    if key in ("seed", "path"):
        return key, str(value)
    for ending, unit in _UNITS_BY_ENDING:
        if key.endswith(ending):
            return key.removesuffix(ending), _number(value, 1.0, unit)
    return key, _number(value, 1e3 if metres else 1.0, "mm" if metres else "V")


def _number(value: Any, scale: float, unit: str) -> str:
    if isinstance(value, list | tuple):
        if len(value) > _FEW:
            return f"({len(value)} values)"
        return " / ".join(_number(item, scale, "") for item in value) + f" {unit}"
    if isinstance(value, int | float):
        return f"{value * scale:.6g} {unit}".rstrip()
    return str(value)


def _load(load: Mapping[str, Any]) -> str:
    try:
        stiffness, contact = float(load["stiffness"]), float(load["contact"])
    except (KeyError, TypeError, ValueError):
        return "as recorded in the metadata"
    return f"spring of {stiffness:.3g} N/m, met at {contact * 1e3:g} mm"
