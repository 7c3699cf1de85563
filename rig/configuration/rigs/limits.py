"""The `limits` of a rig file say what a test may ask of a rig, and what is done beyond that.

From the limits of position and pressure follows the ladder that every rig has; the key `channels`
adds limits (rungs) for any signal that the loop reads.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from math import inf
from typing import Annotated, Any, Final

from pydantic import create_model

from control import COMMAND_LIMIT, Quantity
from rig.channels import SHOWN
from rig.configuration.reading import (
    AnyQuantity,
    Interval,
    Located,
    Physical,
    Schema,
    Under,
    elements_of,
    read_mapping,
    show,
    show_alike,
    suggestion,
)
from rig.io import FAST_INPUTS, ChannelLimit, Response
from rig.plant import Model, Parameters
from rig.recording import unit_of

_GLITCH: Final = 3e-3
"""Time in s of three samples. One or two samples beyond a limit may be a glitch of the wire."""


_SHOWN: Final = {channel: shown.unit for channel, shown in SHOWN}
"""The unit in which the screen shows each channel that has a line there."""
_BOUND: Final = Annotated[Any, AnyQuantity()]


@dataclass(frozen=True)
class Limits:
    """The limits of a rig: ram position, magnitude of the command, and highest chamber pressure."""

    position_min_m: float
    position_max_m: float
    command_V: float  # noqa: N815
    pressure_max_Pa: float  # noqa: N815

    def of(self, quantity: Quantity) -> Physical:
        """Return the range of a setpoint with this quantity: positions in m, or commands in V."""
        if quantity == "position":
            return Physical("m", self.position_min_m, self.position_max_m)
        return Physical("V", -self.command_V, self.command_V)


class LimitsFile(Schema):
    """Keys of a rig's limits."""

    position: Annotated[tuple[float, float], Interval(Physical("m", -1.0, 6.0, 0.3))]
    command: Annotated[float, Physical("V", 0.1, 100.0, COMMAND_LIMIT)] = COMMAND_LIMIT
    pressure: Annotated[float, Physical("Pa", 1e6, 1e8, 2e7)]
    channels: Annotated[Any, Under(lambda: (limit_schema(_rung_keys),), many=True)] = None


def read_limits(item: Located | None, plant: Model | None) -> Limits | None:
    """Return a rig's limits; if the section is missing or unusable, return None.

    If the plant is known, the position limits must lie within its stroke and the pressure limit
    above its supply pressure; limits that do not are returned all the same. Problems are recorded.
    """
    file = read_mapping(LimitsFile, item)
    if item is None or file is None:
        return None
    lower, upper = file.position
    if plant is not None:
        par = plant.parameters
        if lower < par.stroke_min or upper > par.stroke_max:
            limit = f"reaches beyond the stroke of {_range(par.stroke_min, par.stroke_max)}"
            remedy = "keep the limits within the stroke"
            item.refuse(limit, remedy, _range(lower, upper), "position")
        if file.pressure <= par.supply_pressure:
            limit = f"is not above the supply pressure of {show(par.supply_pressure, 'Pa')}"
            item.refuse(limit, "give the pressure at which the rig must trip", key="pressure")
    return Limits(lower, upper, file.command, file.pressure)


def _range(lower: float, upper: float) -> str:
    return f"{show(lower, 'm')} to {show(upper, 'm')}"


def usual_ladder(limits: Limits, par: Parameters) -> tuple[ChannelLimit, ...]:
    """Return the ladder that follows from a rig's limits.

    A chamber pressure above its limit trips the rig. A ram beyond its position limits is held; if
    it gets beyond the middle between a limit and the end of the stroke all the same, the rig trips.
    Nothing is done before the channel has been beyond its limit for 3 ms.
    """
    low, high = limits.position_min_m, limits.position_max_m
    far_low, far_high = 0.5 * (low + par.stroke_min), 0.5 * (high + par.stroke_max)
    return (
        ChannelLimit("position_m", low, high, "hold", _GLITCH),
        ChannelLimit("position_m", far_low, far_high, "trip", _GLITCH),
        ChannelLimit("pressure_1_Pa", -inf, limits.pressure_max_Pa, "trip", _GLITCH),
        ChannelLimit("pressure_2_Pa", -inf, limits.pressure_max_Pa, "trip", _GLITCH),
    )


def read_ladder(item: Located | None) -> tuple[ChannelLimit, ...]:
    """Return the usable limits that a rig file lists under `limits: {channels: [...]}`.

    Problems of the others are recorded.
    """
    channels = item.get("channels") if item is not None else None
    elements = elements_of(channels, "write a list: - {channel: ..., high: ..., action: ...}")
    unknown = "is not a known channel"
    limits = read_channel_limits(elements, _rung_keys, FAST_INPUTS, FAST_INPUTS, unknown)
    rungs = ((ChannelLimit(**given), element) for element, given in limits)
    return tuple(rung for rung, element in rungs if _is_sound(rung, element))


def read_channel_limits(
    elements: list[Located],
    keys_of: Callable[[Any], dict[str, Any]],
    channels: Sequence[str],
    known: Sequence[str],
    unknown: str,
) -> Iterator[tuple[Located, dict[str, Any]]]:
    """Yield each usable element of a list of channel limits, with the values of its keys.

    The key `for` is renamed to `for_s`. A missing `low` is -inf, a missing `high` is inf; an
    element without either is a problem.

    Args:
        elements: elements of the list.
        keys_of: returns type and default of the keys beside `channel`, `low` and `high`, given the
            type of a bound.
        channels: channels whose unit is known; their bounds are read in this unit.
        known: channels that may have a limit here.
        unknown: what a message says of a channel that is not in `known`: "is not known".
    """
    for element in elements:
        entry = element.get("channel")
        channel = str(entry.value) if entry is not None else ""
        # The bounds of an unknown channel cannot be checked; only the channel is reported.
        bound = Annotated[float, Physical(unit_of(channel))] if channel in channels else Any
        problems = element.sources.problems
        before = problems.reported
        file = read_mapping(limit_schema(keys_of, bound), element)
        if entry is not None and channel not in known:
            entry.refuse(unknown, suggestion(channel, known, "channels"), channel)
        elif file is not None and problems.reported == before:
            given = file.model_dump()
            if given["low"] == -inf and given["high"] == inf:
                remedy = "add `low: ...`, `high: ...` or both"
                element.refuse("has no limit", remedy, "", name=channel)
            else:
                given["for_s"] = given.pop("for")
                yield element, given


def limit_schema(
    keys_of: Callable[[Any], dict[str, Any]], bound: Any = _BOUND, name: str = "LimitFile"
) -> type[Schema]:
    """Return the class of the keys of a channel's limit.

    Args:
        keys_of: type and default of the keys beside `channel`, `low` and `high`.
        bound: type of a bound; any quantity unless it is given.
        name: name of the class.
    """
    ends = {"channel": (str, ...), "low": (bound, -inf), "high": (bound, inf)}
    keys: dict[str, Any] = ends | keys_of(bound)
    return create_model(name, __base__=Schema, __doc__="Keys of a limit of a channel.", **keys)


def _rung_keys(bound: Any) -> dict[str, Any]:
    return {
        "action": (Response, ...),
        "hysteresis": (bound, 0.0),
        "for": (Annotated[float, Physical("s", 0.0, 600.0, 1.0)], 0.0),
    }


def _is_sound(rung: ChannelLimit, element: Located) -> bool:
    if rung.low >= rung.high:
        limit = f"is not below high ({show(rung.high, unit_of(rung.channel))})"
        element.refuse(limit, "swap them", key="low")
    return rung.low < rung.high


def as_shown(values: Sequence[float], channel: str, si_unit: str) -> list[str]:
    """Return values of a channel as texts in one unit: that in which the screen shows it.

    Of a channel without such a unit, or of a figure, it is the one of `show_alike`.
    """
    if channel not in _SHOWN:
        return show_alike(values, si_unit)
    unit = _SHOWN[channel]
    return [f"{unit.shown(value):.6g} {unit.text}" for value in values]
