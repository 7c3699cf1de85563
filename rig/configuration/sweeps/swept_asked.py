"""What a sweep asks of its cases is read here: figures of its own, criteria and limits."""

from collections.abc import Sequence as Listing
from math import inf
from typing import Any, Final, NamedTuple

from control import Constant
from faults import FOLLOWING_ERROR, Criterion, OwnFigure, TestLimit
from rig.configuration.campaigns import (
    CriterionFile,
    Motion,
    bounds_of,
    read_criteria,
    read_own_figures,
    read_test_limits,
)
from rig.configuration.reading import Located, elements_of, read_mapping, show, suggestion
from rig.configuration.rigs import Rig

from .asked_columns import AskedColumns, watched_key
from .sweep_plan import LATENCY, SweepFilter, SweptMotion

LONGEST_S: Final = 600.0
"""Longest case in s of which figures may be asked. A process keeps up to eight channels of all its
lanes for them, half a megabyte for each simulated second, so that ten minutes take 300 MB."""
_OF_SAMPLES: Final = ("rms_error", "peak_error", "overshoot", "settling", "peak", "valley")
_OF_STEPS: Final = ("overshoot", "settling")
_STEPPING: Final = ("steps", "pseudorandom", "segments")
_IN_LIMITS: Final = ("rms_error", "peak_error", "peak", "valley")
_WHOLE: Final = ("channel", "during", "from_time", "until_time")
_COMMANDED: Final = ("time_s", "setpoint_m", "setpoint_V", "command_V", FOLLOWING_ERROR)


def lane_channels(rig: Rig | None) -> tuple[str, ...]:
    """Return the channels of a case: those that a rig, or any rig, has in lanes."""
    fitted = (
        ("spool_m", rig is None or rig.has_spool_sensor),
        ("supply_pressure_Pa", rig is None or rig.has_supply_pressure_sensor),
    )
    measured = ("position_m", "pressure_1_Pa", "pressure_2_Pa")
    return (*_COMMANDED, *measured, *(name for name, has in fitted if has))


class Asking(NamedTuple):
    """What is known of a sweep while it is read, to read what it asks of its cases.

    Attributes:
        root: the sweep, with the keys `figures`, `criteria` and `limits`.
        rig: its rig; None if it is unusable.
        filter_name: its filter.
        duration_s: duration of a case, s.
        own: its own figures.
        columns: the columns of the table that follow, which `of_motion` adds to.
    """

    root: Located
    rig: Rig | None
    filter_name: SweepFilter
    duration_s: float
    own: tuple[OwnFigure, ...]
    columns: AskedColumns

    def of_motion(
        self, item: Located, motion: SweptMotion | None
    ) -> tuple[tuple[Criterion, ...], tuple[TestLimit, ...]]:
        """Return the criteria and the limits of a motion's cases; record all problems.

        Args:
            item: the motion, which may have criteria and limits of its own.
            motion: the motion as it was read; None if it is unusable.
        """
        asked = None
        if motion is not None:
            setpoint = motion.sequence or Constant(0.0, motion.quantity)
            asked = Motion(setpoint, self.duration_s)
        criteria: list[tuple[Located, Criterion]] = []
        limits: list[tuple[Located, TestLimit]] = []
        for where in (self.root, item):
            criteria += self._criteria(where.get("criteria"), motion, asked)
            for element, limit in self._limits(where.get("limits"), asked):
                same = [
                    known.place.line
                    for known, other in limits
                    if (other.watched, other.during) == (limit.watched, limit.during)
                ]
                if same:
                    name = "this motion" if motion is None else motion.name
                    text = (
                        f"watches {limit.watched}, as another limit of {name} does, that of line "
                        f"{same[0]}"
                    )
                    remedy = "give one limit with an inner and an outer band"
                    element.refuse(text, remedy, "", watched_key(element), "limits")
                else:
                    limits.append((element, limit))
        self.columns.criteria.append(criteria)
        self.columns.limits.append(limits)
        return tuple(each for _, each in criteria), tuple(each for _, each in limits)

    def _criteria(
        self, item: Located | None, motion: SweptMotion | None, asked: Motion | None
    ) -> list[tuple[Located, Criterion]]:
        """Return the usable criteria of a list, each with its place; record all problems."""
        if item is None:
            return []
        found: list[tuple[Located, Criterion]] = []
        for element in elements_of(item, "write a list: - {figure: rms_error, at_most: 3 mm}"):
            figure = element.get("figure")
            name = "" if figure is None else str(figure.value)
            if not self._is_known(element, name, [*_OF_SAMPLES, "leak", LATENCY]):
                continue
            if name == "leak" and self.filter_name == "thesis-7":
                element.refuse("is not told by thesis-7", "write `filter: product`", key="figure")
            elif name in _OF_STEPS and motion is not None and motion.type not in _STEPPING:
                limit = f"needs steps of the setpoint, and the motion {motion.name} has none"
                element.refuse(limit, "give it to a motion with steps", key="figure")
            elif name == LATENCY:
                found += [(element, each) for each in self._latency(element)]
            else:
                alone = item.with_value([element])
                read = read_criteria(alone, self.own, asked, self.rig)
                found += [(element, each) for each in read]
        return found

    def _latency(self, item: Located) -> list[Criterion]:
        """Return a criterion of the time after which a leak is named; record its problems."""
        before = item.sources.problems.reported
        file = read_mapping(CriterionFile, item)
        for key in _WHOLE:
            if item.get(key) is not None:
                item.refuse("is given for a figure of the whole case", "leave it out", key=key)
        ends = bounds_of(item, ("at_least", "at_most"), "s")
        if file is None or item.sources.problems.reported > before:
            return []
        if not ends:
            item.refuse("has no limit", "add `at_most: 5 s`", LATENCY)
            return []
        return [Criterion(LATENCY, ends.get("at_least", -inf), ends.get("at_most", inf), "s")]

    def _limits(
        self, item: Located | None, asked: Motion | None
    ) -> list[tuple[Located, TestLimit]]:
        """Return the usable limits of a list, each with its place; record all problems."""
        if item is None:
            return []
        remedy = "write a list: - {channel: following_error_m, high: 5 mm, action: warn}"
        known = [
            element
            for element in elements_of(item, remedy)
            if element.get("figure") is None
            or self._is_known(element, str(element.find("figure").value), _IN_LIMITS)
            if self._is_channel(element) and _is_judged_all_along(element)
        ]
        return [
            (element, limit)
            for element in known
            for limit in read_test_limits(item.with_value([element]), self.own, asked, self.rig)
        ]

    def _is_known(self, item: Located, name: str, figures: Listing[str]) -> bool:
        """Return whether a figure is computed of cases; if it is another one, record that."""
        known = [*figures, *(each.name for each in self.own)]
        if name not in known and name:
            remedy = suggestion(name, known, "figures of cases")
            item.refuse("is not computed of the cases of a sweep", remedy, key="figure")
            return False
        return self._is_channel(item)

    def _is_channel(self, item: Located) -> bool:
        channel, channels = item.get("channel"), lane_channels(self.rig)
        if channel is None or channel.value in channels:
            return True
        remedy = suggestion(str(channel.value), channels, "channels of cases")
        channel.refuse("is not simulated in lanes", remedy)
        return False


def _is_judged_all_along(item: Located) -> bool:
    """Return whether a limit has no `each`; if it has, record that sweeps do not judge so."""
    if item.get("each") is None:
        return True
    limit = "is not judged in the cases of a sweep, whose limits hold all along"
    item.refuse(limit, "give a criterion of the figure, or `over: 5 s` in its place", key="each")
    return False


def asking_of(
    root: Located, rig: Rig | None, filter_name: SweepFilter, duration_s: float
) -> Asking:
    """Return what is needed to read what a sweep asks of its cases; record problems.

    Problems are figures of its own that cannot be computed of cases, and cases that last too long
    for figures.

    Args:
        root: the sweep.
        rig: its rig; None if it is unusable.
        filter_name: its filter.
        duration_s: duration of a case, s.
    """
    item = root.get("figures")
    own: tuple[OwnFigure, ...] = ()
    columns = AskedColumns()
    if item is not None:
        channels = lane_channels(rig)
        own = read_own_figures(item, rig)
        for figure in own:
            entry = item.find(figure.name)
            columns.own.append((entry, figure))
            for channel in figure.expression.channels:
                if channel not in channels:
                    remedy = suggestion(channel, channels, "channels of cases")
                    entry.refuse("is not simulated in lanes", remedy, channel, "expression")
            if figure.name == LATENCY:
                entry.refuse("has a meaning already", "choose another name", LATENCY)
    asked = any(_asks(each) for each in (root, *root.find("motions").elements()))
    if asked and duration_s > LONGEST_S:
        most = show(LONGEST_S, "s")
        limit = f"is above {most}, for which the samples that figures and limits need can be kept"
        remedy = f"let a case last {most} at most, or ask for no figures, criteria and limits"
        root.refuse(limit, remedy, key="duration")
    return Asking(root, rig, filter_name, duration_s, own, columns)


def _asks(item: Located) -> bool:
    given: Any = (item.get(key) for key in ("figures", "criteria", "limits"))
    return any(each is not None for each in given)
