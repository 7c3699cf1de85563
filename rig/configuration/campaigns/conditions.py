"""The `conditions` of a campaign: while one of them is not met, the campaign waits."""

from typing import Annotated, Any, Final

from pydantic import create_model

from faults import Condition, Until, Verdict, WhenUnmet
from rig.configuration.reading import Located, Physical, Schema, elements_of, read_mapping, show
from rig.configuration.rigs import Rig, limit_schema, read_channel_limits
from rig.io import FAST_INPUTS, SLOW_INPUTS
from rig.recording import unit_of

from .segments import DURATION

_SIMULATED: Final = ("position_m", "pressure_1_Pa", "pressure_2_Pa")
_MEASURABLE: Final = tuple(
    name for name in dict.fromkeys((*FAST_INPUTS, *SLOW_INPUTS)) if unit_of(name)
)


_AWAITED: Final = "write {channel: ..., low: ..., at_most: 10 min}, or a list of such"
_FOR = Annotated[float, Physical("s", 0.0, 600.0, 1.0)]
UntilVerdictFile = create_model(
    "UntilVerdictFile",
    __base__=Schema,
    __doc__="Keys of `until` with a verdict.",
    **{"verdict": (Verdict, ...), "for": (_FOR, 0.0), "at_most": (Annotated[float, DURATION], ...)},  # type: ignore[call-overload]
)


def measured_by(rig: Rig) -> tuple[str, ...]:
    """Return the names of those signals that a rig measures and that have a unit.

    For a hardware rig these are the signals that its drivers read.
    """
    if rig.backend == "simulated":
        fitted = (
            ("spool_m", rig.has_spool_sensor),
            ("supply_pressure_Pa", rig.has_supply_pressure_sensor),
            ("load_N", rig.has_load_cell),
        )
        return (*_SIMULATED, *(name for name, has in fitted if has))
    read = {name for spec in rig.drivers for name in spec.inputs}
    return tuple(name for name in _MEASURABLE if name in read)


def read_conditions(item: Located | None, rig: Rig | None) -> tuple[Condition, ...]:
    """Return the usable conditions of a campaign; record the problems of the others.

    If `rig` is None, a condition may be on any signal that some rig can measure.
    """
    known = _MEASURABLE if rig is None else measured_by(rig)
    elements = elements_of(item, "write a list: - {channel: ..., low: ...}")
    unknown = "is not measured by this rig"
    limits = read_channel_limits(elements, _keys, _MEASURABLE, known, unknown)
    conditions = (
        (Condition(give_up_s=given.pop("give_up"), **given), element) for element, given in limits
    )
    return tuple(each for each, element in conditions if _is_sound(each, element))


def condition_files() -> tuple[type[Schema], ...]:
    """Return the class of the keys of a condition, whose bounds are in its channel's unit."""
    return (limit_schema(_keys, name="ConditionFile"),)


def awaited_files() -> tuple[type[Schema], ...]:
    """Return the class of the keys of what a test waits for."""
    return (limit_schema(_awaited_keys, name="AwaitedFile"),)


def until_files() -> tuple[type[Schema], ...]:
    """Return the classes of the keys of what ends a test: a channel or a verdict."""
    return (limit_schema(_until_keys, name="UntilChannelFile"), UntilVerdictFile)


def read_awaited(item: Located | None, rig: Rig | None) -> tuple[Condition, ...]:
    """Return what a test waits for before it begins; record the problems.

    Args:
        item: the list under the key `wait_for`, or the only element of it; None if there is none.
        rig: the rig; if it is None, any signal that some rig can measure may be awaited.
    """
    if item is None:
        return ()
    known = _MEASURABLE if rig is None else measured_by(rig)
    given = [item] if isinstance(item.value, dict) else elements_of(item, _AWAITED)
    unknown = "is not measured by this rig"
    limits = read_channel_limits(given, _awaited_keys, _MEASURABLE, known, unknown)
    awaited = (
        (Condition(give_up_s=keys.pop("at_most"), **keys), element) for element, keys in limits
    )
    return tuple(each for each, element in awaited if _is_sound(each, element))


def read_until(item: Located | None, rig: Rig | None) -> tuple[Until, float] | None:
    """Return what ends a test and its longest duration, s; if it is wrong, record why, and None.

    Args:
        item: the mapping under the key `until`; None if there is none.
        rig: the rig; if it is None, any signal that some rig can measure may be awaited.
    """
    if item is None:
        return None
    if item.get("verdict") is not None:
        file = read_mapping(UntilVerdictFile, item)
        if file is None:
            return None
        return Until(verdict=file.verdict, for_s=getattr(file, "for")), file.at_most
    known = _MEASURABLE if rig is None else measured_by(rig)
    unknown = "is not measured by this rig"
    for keys in (
        dict(keys)
        for _, keys in read_channel_limits([item], _until_keys, _MEASURABLE, known, unknown)
    ):
        at_most = keys.pop("at_most")
        if not keys["low"] < keys["high"]:
            item.refuse("is not below high", "swap them", key="low")
            return None
        return Until(**keys), at_most
    return None


def _awaited_keys(bound: Any) -> dict[str, Any]:
    at_most = Annotated[float, Physical("s", 1.0, 7 * 86400.0, 600.0)]
    return {"hysteresis": (bound, 0.0), "for": (_FOR, 0.0), "at_most": (at_most, ...)}


def _until_keys(bound: Any) -> dict[str, Any]:
    return {"for": (_FOR, 0.0), "at_most": (Annotated[float, DURATION], ...)}


def _keys(bound: Any) -> dict[str, Any]:
    default = Condition("")
    return {
        "hysteresis": (bound, 0.0),
        "for": (Annotated[float, Physical("s", 0.0, 600.0, 1.0)], default.for_s),
        "action": (WhenUnmet, default.action),
        "give_up": (Annotated[float, Physical("s", 1.0, 7 * 86400.0, 3600.0)], default.give_up_s),
    }


def _is_sound(condition: Condition, element: Located) -> bool:
    width = condition.high - condition.low
    is_sound = 0.0 <= 2.0 * condition.hysteresis < width
    if not is_sound:
        apart = show(width, unit_of(condition.channel))
        limit = f"leaves nothing between the limits, {apart} apart"
        element.refuse(limit, "reduce it; low must be below high", key="hysteresis")
    return is_sound
