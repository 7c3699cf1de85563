"""The `conditions` of a campaign: what must hold of the rig, lest the campaign be held."""

from collections.abc import Iterator
from math import inf
from typing import Annotated, Any, Final

from pydantic import create_model

from faults import Condition, WhenUnmet
from rig.configuration.reading import (
    Located,
    Physical,
    Problems,
    Schema,
    read_mapping,
    show,
    shown,
    suggestion,
)
from rig.configuration.rigs import Rig
from rig.io import FAST_INPUTS, SLOW_INPUTS
from rig.recording import unit_of

_SIMULATED: Final = ("position_m", "pressure_1_Pa", "pressure_2_Pa")
_MEASURABLE: Final = tuple(
    name for name in dict.fromkeys((*FAST_INPUTS, *SLOW_INPUTS)) if unit_of(name)
)


def measured_by(rig: Rig) -> tuple[str, ...]:
    """Return the quantities that a rig measures, by the names of their signals."""
    if rig.backend == "simulated":
        fitted = (
            ("spool_m", rig.has_spool_sensor),
            ("supply_pressure_Pa", rig.has_supply_pressure_sensor),
            ("load_N", rig.has_load_cell),
        )
        return (*_SIMULATED, *(name for name, has in fitted if has))
    read = {name for spec in rig.drivers for name in spec.inputs}
    return tuple(name for name in _MEASURABLE if name in read)


def read_conditions(
    item: Located | None, rig: Rig | None, problems: Problems
) -> tuple[Condition, ...]:
    """Return a campaign's conditions, those that are usable."""
    if item is None:
        return ()
    if not isinstance(item.value, list):
        remedy = "write a list: - {channel: ..., low: ...}"
        problems.add(item.place, item.name, shown(item), "is not a list", remedy)
        return ()
    return tuple(_read(item.elements(), rig, problems))


def _read(elements: list[Located], rig: Rig | None, problems: Problems) -> Iterator[Condition]:
    known = _MEASURABLE if rig is None else measured_by(rig)
    for element in elements:
        entry = element.get("channel")
        channel = str(entry.value) if entry is not None else ""
        before = problems.reported
        file = read_mapping(_schema(channel), element, problems)
        if entry is not None and channel not in known:
            limit = "is not measured by this rig"
            problems.add(
                entry.place, "channel", channel, limit, suggestion(channel, known, "channels")
            )
        elif file is not None and problems.reported == before:
            keys = file.model_dump()
            condition = Condition(for_s=keys.pop("for"), give_up_s=keys.pop("give_up"), **keys)
            if _is_sound(condition, element, problems):
                yield condition


def _schema(channel: str) -> type[Schema]:
    """Return the keys of one condition; its limits are in the channel's unit."""
    bound = Annotated[float, Physical(unit_of(channel))] if channel in _MEASURABLE else Any
    default = Condition("")
    keys: dict[str, Any] = {
        "channel": (str, ...),
        "low": (bound, -inf),
        "high": (bound, inf),
        "hysteresis": (bound, 0.0),
        "for": (Annotated[float, Physical("s", 0.0, 600.0, 1.0)], default.for_s),
        "action": (WhenUnmet, default.action),
        "give_up": (Annotated[float, Physical("s", 1.0, 7 * 86400.0, 3600.0)], default.give_up_s),
    }
    return create_model("ConditionFile", __base__=Schema, **keys)


def _is_sound(condition: Condition, element: Located, problems: Problems) -> bool:
    unit = unit_of(condition.channel)
    if condition.low == -inf and condition.high == inf:
        remedy = "add `low: ...`, `high: ...` or both"
        problems.add(element.place, condition.channel, "", "has no limit", remedy)
        return False
    width = condition.high - condition.low
    if not 0.0 <= 2.0 * condition.hysteresis < width:
        entry = element.find(("hysteresis",))
        limit = f"leaves nothing between the limits, {show(width, unit)} apart"
        remedy = "reduce it; low must be below high"
        problems.add(entry.place, "hysteresis", shown(entry), limit, remedy)
        return False
    return True
