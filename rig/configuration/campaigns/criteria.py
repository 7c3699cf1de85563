"""The `figures` and `criteria` of a test are read here."""

from collections.abc import Mapping, Sequence as Listing
from math import inf
from typing import Annotated, Any, Final

from pydantic import create_model

from control import Sequence, Stretch
from faults import (
    FOLLOWING_ERROR,
    FRICTION,
    MEASURES,
    Criterion,
    Expression,
    ExpressionError,
    OwnFigure,
)
from rig.configuration.reading import (
    DIMENSIONS,
    AnyQuantity,
    Located,
    Physical,
    Schema,
    check_name,
    elements_of,
    read_mapping,
    suggestion,
)
from rig.configuration.rigs import Rig
from rig.io import FAST_INPUTS, SLOW_INPUTS
from rig.plant import quantities
from rig.recording import unit_of

from .conditions import measured_by
from .segments import Motion

_EVERY_TEST: Final = {
    "residual_pressure_1": "Pa",
    "residual_pressure_2": "Pa",
    "bulk_modulus": "Pa",
    "loop_wakeup_p50": "s",
    "loop_wakeup_p99": "s",
    "loop_command_p99": "s",
    "loop_missed": "",
}
"""Figures that tests have by themselves -> SI unit, beside `leak`."""
FIGURE_UNITS: Final = {**MEASURES, **_EVERY_TEST}
"""Figures that tests have by themselves -> SI unit, without those of friction."""
_OF_CHANNEL: Final = ("peak", "valley")
_COMMANDED: Final = ("time_s", "setpoint_m", "setpoint_V", "command_V", FOLLOWING_ERROR)


class OwnFigureFile(Schema):
    """Keys of a figure of one's own, whose name is its key under `figures`."""

    expression: str
    unit: str = ""


class CriterionFile(Schema):
    """Keys of a criterion; the unit of its limits is that of its figure."""

    figure: str
    at_least: Annotated[Any, AnyQuantity()] = None
    at_most: Annotated[Any, AnyQuantity()] = None
    channel: str | None = None
    during: str | None = None
    from_time: Annotated[float | None, Physical("s", 0.0, 3600.0, 10.0)] = None
    until_time: Annotated[float | None, Physical("s", 0.0, 3600.0, 10.0)] = None


def figure_unit(name: str) -> str | None:
    """Return the SI unit of a figure that tests have by themselves, one of no channel.

    It is None for a name that is no such figure.
    """
    if name.startswith(FRICTION):
        known = quantities()
        found = known.get(name) or known.get(name.removeprefix(FRICTION))
        if found is not None:
            return found.unit
    return FIGURE_UNITS.get(name)


def channels_of(rig: Rig | None) -> tuple[str, ...]:
    """Return the channels that expressions, criteria and limits may name, for a rig or for any."""
    measured = (*FAST_INPUTS, *SLOW_INPUTS) if rig is None else measured_by(rig)
    return tuple(dict.fromkeys((*_COMMANDED, *measured)))


def read_own_figures(item: Located | None, rig: Rig | None) -> tuple[OwnFigure, ...]:
    """Return the usable figures under the key `figures`; record the problems of the others."""
    if item is None:
        return ()
    if not isinstance(item.value, dict):
        item.refuse("is not a mapping", "write `name: {expression: ..., unit: ...}`")
        return ()
    return tuple(each for name, entry in item.items() if (each := _own(name, entry, rig)))


def _own(name: str, item: Located, rig: Rig | None) -> OwnFigure | None:
    if not check_name(item, name):
        return None
    if name in MEASURES or name in _EVERY_TEST or name in channels_of(None):
        item.refuse("has a meaning already", "choose another name", name, name="figures")
        return None
    file = read_mapping(OwnFigureFile, item)
    if file is None:
        return None
    if file.unit not in DIMENSIONS:
        remedy = (
            f"expressions are in SI; give one of {', '.join(each for each in DIMENSIONS if each)}"
        )
        item.refuse("is no SI unit", remedy, file.unit, "unit")
        return None
    try:
        expression = Expression(file.expression)
    except ExpressionError as error:
        item.refuse(error.limit, error.remedy, key="expression")
        return None
    known = channels_of(rig)
    unknown = [channel for channel in expression.channels if channel not in known]
    for channel in unknown:
        remedy = suggestion(channel, known, "channels")
        item.refuse("is no channel of this rig", remedy, channel, "expression")
    if not expression.channels:
        item.refuse("uses no channel", f"channels: {', '.join(known)}", key="expression")
    return OwnFigure(name, expression, file.unit) if expression.channels and not unknown else None


def read_criteria(
    item: Located | None, own: Listing[OwnFigure], motion: Motion | None, rig: Rig | None
) -> tuple[Criterion, ...]:
    """Return the usable criteria of a test; record the problems of the others.

    Args:
        item: the list under the key `criteria`; None if there is none.
        own: the test's own figures.
        motion: the test's motion; None if it is not known.
        rig: the rig; None if it is unusable.
    """
    remedy = "write a list: - {figure: rms_error, at_most: 3 mm}"
    return tuple(
        each
        for element in elements_of(item, remedy)
        if (each := _criterion(element, own, motion, rig)) is not None
    )


def _criterion(
    item: Located, own: Listing[OwnFigure], motion: Motion | None, rig: Rig | None
) -> Criterion | None:
    problems = item.sources.problems
    before = problems.reported
    file = read_mapping(CriterionFile, item)
    if file is None:
        return None
    unit = _unit_of_criterion(item, file, own, rig)
    window = _window(item, file, motion)
    if unit is None or window is None:
        return None
    if motion is not None and motion.setpoint.quantity != "position" and (
        file.figure in ("rms_error", "peak_error", "overshoot", "settling")
    ):  # fmt: skip
        limit = "compares with a setpoint in m, and this test has none"
        item.refuse(limit, "leave it out, or give a setpoint in m", key="figure")
    ends = bounds_of(item, ("at_least", "at_most"), unit)
    if problems.reported > before:
        return None
    low, high = ends.get("at_least", -inf), ends.get("at_most", inf)
    if (low, high) == (-inf, inf):
        item.refuse("has no limit", "add `at_least: ...`, `at_most: ...` or both", file.figure)
        return None
    if low > high:
        item.refuse("is above at_most", "swap them", key="at_least")
        return None
    channel = file.channel or ("position_m" if file.figure in _OF_CHANNEL else "")
    return Criterion(file.figure, low, high, unit, channel, file.during or "", *window)


def _unit_of_criterion(
    item: Located, file: CriterionFile, own: Listing[OwnFigure], rig: Rig | None
) -> str | None:
    mine = {each.name: each for each in own}
    if file.channel is not None and file.figure not in _OF_CHANNEL:
        item.refuse("is given for a figure of no channel", "leave it out", key="channel")
        return None
    if file.figure in _OF_CHANNEL:
        channel, channels = file.channel or "position_m", channels_of(rig)
        if channel not in channels:
            remedy = suggestion(channel, channels, "channels")
            item.refuse("is no channel of this rig", remedy, channel, "channel")
            return None
        return unit_of(channel)
    if file.figure in mine:
        if not mine[file.figure].expression.is_number:
            remedy = f"write max({mine[file.figure].expression.text}) or the like"
            item.refuse("has a value at each sample, and no single one", remedy, key="figure")
            return None
        return mine[file.figure].unit
    unit = figure_unit(file.figure)
    if unit is None:
        remedy = suggestion(file.figure, [*FIGURE_UNITS, *mine], "figures")
        item.refuse("is no known figure", remedy, key="figure")
    return unit


def _window(
    item: Located, file: CriterionFile, motion: Motion | None
) -> tuple[float, float] | None:
    """Return the stretch of a criterion, s of the test; if it is wrong, record why, and None."""
    timed = file.from_time is not None or file.until_time is not None
    if (timed or file.during) and file.figure in (*_EVERY_TEST, "leak"):
        item.refuse("is a figure of the whole test", "leave the stretch out", key="figure")
        return None
    if file.during is None:
        begin, end = file.from_time or 0.0, inf if file.until_time is None else file.until_time
        if motion is not None and begin >= min(end, motion.duration_s):
            lasts = f"{motion.duration_s:g} s"
            item.refuse(f"leaves nothing of the test's {lasts}", "begin earlier", key="from_time")
            return None
        return begin, end
    if timed:
        item.refuse("is given with from_time or until_time", "give one of both", key="during")
        return None
    if motion is None:
        return None
    windows = windows_of(item, file.during, motion)
    return (windows[0][0], windows[-1][1]) if windows else None


def windows_of(item: Located, name: str, motion: Motion) -> tuple[tuple[float, float], ...]:
    """Return (begin, end) in s of each segment with a name, as the motion is laid out.

    Blends are left out. If the test has no such segment, record a problem and return ().

    Args:
        item: the mapping that names the segment under the key `during`.
        name: the name.
        motion: the test's motion.
    """
    setpoint = motion.setpoint
    laid: list[tuple[float, Stretch]] = []
    if isinstance(setpoint, Sequence):
        laid = list(zip(setpoint.starts_s, setpoint.stretches, strict=True))
    windows = tuple(
        (start + each.blend_s, start + each.total_s) for start, each in laid if each.name == name
    )
    if not windows:
        names = list(dict.fromkeys(each.name for _, each in laid if each.name))
        remedy = suggestion(name, names, "named segments")
        item.refuse("is no segment of this test", remedy, key="during")
    return windows


def bounds_of(item: Located, keys: Listing[str], unit: str) -> Mapping[str, float]:
    """Return those of some keys that a mapping gives, as quantities; record their problems."""
    kind = Annotated[float, Physical(unit)]
    fields: Any = dict.fromkeys(keys, (kind, None))
    given = {key: entry for key, entry in item.items() if key in keys and entry.value is not None}
    file = read_mapping(
        create_model("BoundsFile", __base__=Schema, **fields), item.with_value(given)
    )
    found = {} if file is None else file.model_dump()
    return {key: value for key, value in found.items() if value is not None}
