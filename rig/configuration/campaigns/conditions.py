"""The `conditions` of a campaign: while one of them is not met, the campaign waits."""

from typing import Annotated, Any, Final

from faults import Condition, WhenUnmet
from rig.configuration.reading import Located, Physical, Schema, elements_of, show
from rig.configuration.rigs import Rig, limit_schema, read_channel_limits
from rig.io import FAST_INPUTS, SLOW_INPUTS
from rig.recording import unit_of

_SIMULATED: Final = ("position_m", "pressure_1_Pa", "pressure_2_Pa")
MEASURABLE: Final = tuple(
    name for name in dict.fromkeys((*FAST_INPUTS, *SLOW_INPUTS)) if unit_of(name)
)
"""Names of all signals that some rig can measure and that have a unit."""


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
    return tuple(name for name in MEASURABLE if name in read)


def read_conditions(item: Located | None, rig: Rig | None) -> tuple[Condition, ...]:
    """Return the usable conditions of a campaign; record the problems of the others.

    If `rig` is None, a condition may be on any signal that some rig can measure.
    """
    known = MEASURABLE if rig is None else measured_by(rig)
    elements = elements_of(item, "write a list: - {channel: ..., low: ...}")
    unknown = "is not measured by this rig"
    limits = read_channel_limits(elements, _keys, MEASURABLE, known, unknown)
    conditions = (
        (Condition(give_up_s=given.pop("give_up"), **given), element) for element, given in limits
    )
    return tuple(each for each, element in conditions if is_sound(each, element))


def condition_files() -> tuple[type[Schema], ...]:
    """Return the class of the keys of a condition, whose bounds are in its channel's unit."""
    return (limit_schema(_keys, name="ConditionFile"),)


def _keys(bound: Any) -> dict[str, Any]:
    default = Condition("")
    return {
        "hysteresis": (bound, 0.0),
        "for": (Annotated[float, Physical("s", 0.0, 600.0, 1.0)], default.for_s),
        "action": (WhenUnmet, default.action),
        "give_up": (Annotated[float, Physical("s", 1.0, 7 * 86400.0, 3600.0)], default.give_up_s),
    }


def is_sound(condition: Condition, element: Located) -> bool:
    """Return whether something is left between a condition's limits; if not, record a problem."""
    width = condition.high - condition.low
    is_sound = 0.0 <= 2.0 * condition.hysteresis < width
    if not is_sound:
        apart = show(width, unit_of(condition.channel))
        limit = f"leaves nothing between the limits, {apart} apart"
        element.refuse(limit, "reduce it; low must be below high", key="hysteresis")
    return is_sound
