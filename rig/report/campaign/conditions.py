"""Puts a test's setpoint, load and loop timing into words, from the metadata of its recording."""

import json
import re
from collections.abc import Iterator, Mapping
from typing import Any, Final

from rig.loop import TIMING, in_short
from rig.plant import Parameters
from rig.recording import Recording

_UNITS_BY_ENDING: Final = {"_hz_per_s": "Hz/s", "_hz": "Hz", "_rad": "rad", "_s": "s"}
_FEW: Final = 8
"""Greatest length of a list whose values are written one by one."""


def assumed_parameters(metadata: Mapping[str, Any]) -> Parameters | None:
    """Return the parameters that the filter assumed, from the key `model` of the metadata.

    A parameter of an effect that is newer than the recording gets the value at which the effect is
    absent. The result is None if no parameters can be read.
    """
    try:
        recorded = dict(metadata["model"]["parameters"])
        known = {name: float(recorded[name]) for name in Parameters._fields if name in recorded}
    except (KeyError, TypeError, ValueError):
        return None
    return Parameters(**known) if "piston_area" in known else None


def conditions_of(metadata: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield setpoint and load of a test as (name, text), without those that are not recorded.

    Args:
        metadata: metadata of the test's recording.
    """
    test = metadata.get("test")
    if not isinstance(test, Mapping):
        return
    for name, key, in_words in (("Setpoint", "setpoint", _setpoint), ("Load", "load", _load)):
        recorded = test.get(key)
        if isinstance(recorded, Mapping):
            yield name, in_words(recorded)


def loop_conditions(recording: Recording) -> Iterator[tuple[str, str]]:
    """Yield the grants and the timing of a hardware rig's loop as (name, text), if recorded."""
    loop = recording.metadata.get("loop")
    if isinstance(loop, Mapping):
        shown = [
            f"{'' if grant.get('granted') else 'without '}{grant.get('name', '')}"
            for grant in loop.get("grants", ())
            if isinstance(grant, Mapping)
        ]
        yield "Loop ran with", ", ".join(shown) or "nothing granted"
    for event in recording.events:
        if event.kind == TIMING:
            yield "Loop timing", in_short(json.loads(event.text))


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
    for ending, unit in _UNITS_BY_ENDING.items():
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
