"""The `limits` of a test are read here: what is watched while it runs, and what is done beyond."""

from collections.abc import Iterator, Sequence as Listing
from math import inf
from typing import Annotated, Any, Final, Literal, NamedTuple

from pydantic import create_model

from faults import (
    DECIDED_FIGURES,
    FOLLOWING_ERROR,
    FRICTION,
    STEP_FIGURES,
    STEP_M,
    WATCHED_FIGURES,
    Expression,
    LimitAction,
    LimitEach,
    OwnFigure,
    TestLimit,
    has_step,
    stretches_of,
)
from rig.configuration.reading import (
    AnyQuantity,
    Located,
    Physical,
    Schema,
    elements_of,
    read_mapping,
    show,
    suggestion,
)
from rig.configuration.rigs import Rig
from rig.recording import unit_of

from .criteria import FIGURE_UNITS, bounds_of, channels_of, figure_unit, windows_of
from .segments import Motion

_WINDOW_S: Final = Physical("s", 0.5, 60.0, 10.0)
"""How far back a figure that is watched looks. It is computed anew every 50 ms, so that a minute of
rows is what a test in real time can afford."""
_MOST_STRETCHES: Final = 100
"""Most stretches in which one limit holds, such as the turns of a loop. The loop judges each of
them in every tick, at some nanoseconds each."""
_MOST_LIMITS: Final = 100
"""Most limits of a test."""
_MOST_LOOK_BACK_S: Final = 500.0
"""Longest that the limits of a test may look back, s, all their `over` added up.

The supervisor judges every 50 ms. A limit takes it 0.05 ms, and 0.04 ms more for each second of
`over` (measured on the project's reference machine, with max, rms, percentile and median, see
decision 25). So the most that is allowed takes 100 x 0.05 ms + 500 x 0.04 ms = 25 ms, which leaves
half of its time for recording and for the detector."""

_DISTANCES: Final = (FOLLOWING_ERROR, "rms_error", "peak_error")
"""What is watched and is a distance between setpoint and position, so that it is never below 0."""
_NEVER_BELOW_0: Final = (*_DISTANCES, *STEP_FIGURES)
"""What is watched and is never below 0."""
_SHARE: Final = "loop_missed"
"""What is watched and is a part of a whole, from 0 to 1."""
_INSTANT_S: Final = 1e-9
"""Times in s that are nearer to each other are the same; ticks are 1 ms apart."""


class _TestLimitKeys(Schema):
    """Keys of a limit that holds while a test runs; its bounds have the unit of its channel."""

    __test__ = False  # not a pytest class, whatever its name

    channel: str | None = None
    figure: str | None = None
    low: Annotated[Any, AnyQuantity()] = None
    high: Annotated[Any, AnyQuantity()] = None
    inner_low: Annotated[Any, AnyQuantity()] = None
    inner_high: Annotated[Any, AnyQuantity()] = None
    action: LimitAction = "trip"
    each: LimitEach | None = None
    hysteresis: Annotated[Any, AnyQuantity()] = None
    during: str | None = None
    over: Annotated[float | None, _WINDOW_S] = None


_FOR: Final = Physical("s", 0.0, 600.0, 1.0)
# `for` is a word of Python, so that the class above cannot have it.
TestLimitFile = create_model(  # type: ignore[call-overload]
    "TestLimitFile",
    __base__=_TestLimitKeys,
    __doc__=_TestLimitKeys.__doc__,
    **{"for": (Annotated[float, _FOR], 0.0)},
)


def read_test_limits(
    item: Located | None, own: Listing[OwnFigure], motion: Motion | None, rig: Rig | None
) -> tuple[TestLimit, ...]:
    """Return the usable limits of a test; record the problems of the others.

    Args:
        item: the list under the key `limits`; None if there is none.
        own: the test's own figures.
        motion: the test's motion; None if it is not known.
        rig: the rig; None if it is unusable.
    """
    remedy = "write a list: - {channel: following_error_m, high: 5 mm, action: ramp_down}"
    elements = elements_of(item, remedy)
    if item is not None and len(elements) > _MOST_LIMITS:
        many = f"has {len(elements)} limits, and {_MOST_LIMITS} can be judged in time"
        item.refuse(many, "leave out those that matter least, or give them to another test", "")
        return ()
    limits = tuple(_limits(elements, own, motion, rig))
    looks_back_s = sum(limit.over_s for limit in limits)
    if item is not None and looks_back_s > _MOST_LOOK_BACK_S:
        most = show(_MOST_LOOK_BACK_S, "s")
        far = (
            f"looks back over {show(looks_back_s, 's')} in all limits together, and {most} can be "
            "judged in time"
        )
        usual = show(_WINDOW_S.typical or 0.0, "s")
        remedy = f"give shorter `over` (it is {usual} where it is not given), or fewer figures"
        item.refuse(far, remedy, "")
    return limits


def _limits(
    elements: Listing[Located],
    own: Listing[OwnFigure],
    motion: Motion | None,
    rig: Rig | None,
) -> Iterator[TestLimit]:
    for element in elements:
        limit = _limit(element, own, motion, rig)
        if limit is not None:
            yield limit


class _Watched(NamedTuple):
    """What a limit watches."""

    name: str
    unit: str
    """SI unit; empty for a plain number."""
    is_figure: bool
    """Whether it is one number of the last samples, so that it is computed over some time."""
    expression: Expression | None = None
    """How it follows from the channels, for a figure that is not the test's own."""
    only_each: LimitEach | None = None
    """The only kind of stretch over which the figure is computed; None if there is a choice."""


def _limit(
    item: Located, own: Listing[OwnFigure], motion: Motion | None, rig: Rig | None
) -> TestLimit | None:
    problems = item.sources.problems
    before = problems.reported
    file = read_mapping(TestLimitFile, item)
    if file is None:
        return None
    watched = _watched(item, file, own, motion, rig)
    windows = () if file.during is None or motion is None else windows_of(item, file.during, motion)
    if len(windows) > _MOST_STRETCHES:
        limit = f"is the name of {len(windows)} segments, and a limit holds in {_MOST_STRETCHES}"
        item.refuse(limit, "let it hold in the whole test, or loop less often", key="during")
    if watched is None or problems.reported > before:
        return None
    keys = ("low", "high", "inner_low", "inner_high", "hysteresis")
    ends = bounds_of(item, keys, watched.unit)
    each = _each(item, file, watched, motion)
    if file.over is not None and not watched.is_figure and not each:
        limit = "is for figures; a channel has a value at each sample"
        item.refuse(limit, "leave it out", key="over")
    if problems.reported > before:
        return None
    usual = _WINDOW_S.typical or 0.0
    limit_of = TestLimit(
        watched.name,
        watched.unit,
        ends.get("low", -inf),
        ends.get("high", inf),
        ends.get("inner_low", -inf),
        ends.get("inner_high", inf),
        file.action,
        getattr(file, "for"),
        ends.get("hysteresis", 0.0),
        (file.over or usual) if watched.is_figure and not each else 0.0,
        file.during or "",
        windows,
        watched.expression,
        each,
    )
    if not _is_sound(item, limit_of) or not _is_crossable(item, limit_of):
        return None
    if motion is not None and not each and not _has_time_to_act(item, limit_of, motion.duration_s):
        return None
    return limit_of


def _watched(
    item: Located,
    file: _TestLimitKeys,
    own: Listing[OwnFigure],
    motion: Motion | None,
    rig: Rig | None,
) -> _Watched | None:
    """Return what a limit watches; if it cannot be watched, record why, and return None."""
    of_channel = file.figure in ("peak", "valley")
    if file.figure is None and file.channel is None:
        item.refuse("names nothing to watch", "give `channel: ...` or `figure: ...`", "")
        return None
    if file.figure is not None and file.channel is not None and not of_channel:
        limit, remedy = "names both a channel and a figure", "give `channel: ...` or `figure: ...`"
        item.refuse(limit, remedy, "")
        return None
    channel = file.channel or ("position_m" if of_channel else "")
    if channel:
        known = [name for name in channels_of(rig) if unit_of(name) and name != "time_s"]
        if channel not in known:
            item.refuse(
                "is not measured by this rig", suggestion(channel, known, "channels"), key="channel"
            )
            return None
    follows = channel == FOLLOWING_ERROR or file.figure in (
        "rms_error",
        "peak_error",
        *STEP_FIGURES,
    )
    if follows and motion is not None and motion.setpoint.quantity != "position":
        limit = "compares with a setpoint in m, and this test has none"
        key = "channel" if channel else "figure"
        item.refuse(limit, "leave it out, or give a setpoint in m", key=key)
        return None
    if file.figure is None:
        return _Watched(channel, unit_of(channel), is_figure=False)
    return _watched_figure(item, file.figure, channel, own)


def _watched_figure(
    item: Located, figure: str, channel: str, own: Listing[OwnFigure]
) -> _Watched | None:
    mine = {each.name: each for each in own}
    if figure in mine:
        return _Watched(figure, mine[figure].unit, mine[figure].expression.is_number)
    if figure in DECIDED_FIGURES:
        return _Watched(figure, DECIDED_FIGURES[figure], is_figure=False)
    if figure in WATCHED_FIGURES:
        expression = Expression(WATCHED_FIGURES[figure].format(channel=channel))
        unit = unit_of(channel) if channel else FIGURE_UNITS[figure]
        name = f"{figure} of {channel}" if channel else figure
        return _Watched(name, unit, True, expression)
    unit_of_figure = figure_unit(figure)
    if figure in STEP_FIGURES:
        return _Watched(figure, FIGURE_UNITS[figure], is_figure=False, only_each="step")
    if figure.startswith(FRICTION) and unit_of_figure is not None:
        return _Watched(figure, unit_of_figure, is_figure=False, only_each="test")
    item.refuse(
        "is no known figure", suggestion(figure, [*FIGURE_UNITS, *mine], "figures"), key="figure"
    )
    return None


def _each(
    item: Located, file: _TestLimitKeys, watched: _Watched, motion: Motion | None
) -> LimitEach | Literal[""]:
    """Return over which stretches a limit's figure is computed once; "" if it is judged all along.

    If the figure, the limit's other keys or the motion do not allow it, record why.
    """
    each = file.each or watched.only_each
    if each is None:
        return ""
    if watched.only_each not in (None, each):
        of = f"is a figure of a {watched.only_each} alone"
        remedy = f"write `each: {watched.only_each}`, or leave it out"
        if watched.only_each == "test" and file.during:
            remedy = "leave `each` and `during` out"
        item.refuse(of, remedy, watched.name, "each")
        return each
    is_one_number = watched.only_each or watched.is_figure or watched.name in DECIDED_FIGURES
    if not is_one_number:
        limit = "has a value at each sample, and is judged at each"
        remedy = "leave `each` out, or watch one number of it, such as its peak, or max(...)"
        item.refuse(limit, remedy, watched.name, "each")
        return each
    if each == "step" and watched.only_each != "step":
        remedy = f"write one of {', '.join(STEP_FIGURES)}, or `each: cycle`, segment or test"
        item.refuse("is no figure of a step", remedy, watched.name, "each")
        return each
    for key in ("for", "over", "hysteresis"):
        if item.get(key) is not None:
            limit = f"is given for a figure that has one value for each {each}"
            item.refuse(limit, f"leave `{key}` out", key=key)
    if motion is not None:
        _check_stretches(item, each, file.during or "", motion, watched)
    return each


def _check_stretches(
    item: Located, each: LimitEach, during: str, motion: Motion, watched: _Watched
) -> None:
    """Record a problem if a motion has no stretch over which a limit's figure is computed."""
    setpoint = motion.setpoint
    laid = setpoint, motion.duration_s, during
    of = f"the segment {during}" if during else "the test"
    key = "each" if item.get("each") is not None else "figure"
    if each == "test" and during:
        limit = f"is known as the test ends, and `during: {during}` holds before"
        remedy = "leave `during` out, or write `each: segment`"
        if watched.only_each == "test":
            remedy = f"leave `during` out: {watched.name} is a figure of a whole test alone"
        item.refuse(limit, remedy, key=key)
    elif each == "segment" and not stretches_of(*laid, each):
        item.refuse("can never act: the test has no segments", "write `each: test`", key=key)
    elif each == "cycle" and not stretches_of(*laid, each):
        limit = f"can never act: {of} has no whole cycle of a setpoint that repeats itself"
        remedy = (
            "let it last for a cycle of a sine, triangle, trapezoid or multisine, or use `over`"
        )
        item.refuse(limit, remedy, key=key)
    elif each == "step" and setpoint.quantity == "position" and not has_step(*laid):
        limit = (
            f"can never act: {of} has no step, a jump by more than {show(STEP_M, 'm')} in a tick"
        )
        item.refuse(limit, "leave it out, or limit following_error_m", key=key)


def _is_sound(item: Located, limit: TestLimit) -> bool:
    """Return whether the bands of a limit make sense; if not, record why."""
    outer, inner = (limit.low, limit.high), (limit.inner_low, limit.inner_high)
    if (*outer, *inner) == (-inf, inf, -inf, inf):
        item.refuse("has no limit", "add `low: ...`, `high: ...` or both", limit.watched)
        return False
    if outer == (-inf, inf) and limit.action != "warn":
        item.refuse("has an inner band only", "add the outer one, or `action: warn`", limit.watched)
        return False
    for ends, key in ((outer, "low"), (inner, "inner_low")):
        if not ends[0] < ends[1]:
            item.refuse("is not below its upper end", "swap them", key=key)
            return False
    if limit.inner_low < limit.low or limit.inner_high > limit.high:
        wide = (
            "inner_low" if limit.inner_low > -inf and limit.inner_low < limit.low else "inner_high"
        )
        if (wide == "inner_low" and limit.inner_low > -inf) or limit.inner_high < inf:
            item.refuse(
                "lies outside of the outer band", "let the inner band be narrower", key=wide
            )
            return False
    width = min(outer[1] - outer[0], inner[1] - inner[0])
    if not 0.0 <= 2.0 * limit.hysteresis < width:
        item.refuse("leaves nothing between the ends of a band", "reduce it", key="hysteresis")
        return False
    return True


def _is_crossable(item: Located, limit: TestLimit) -> bool:
    """Return whether a limit is neither always passed nor never; if not, record why.

    A distance is at least 0, so that it is always above an end below 0, and never below one. A
    share is at most 1.
    """
    if limit.watched == _SHARE:
        for key in ("low", "high", "inner_low", "inner_high"):
            if 1.0 < abs(getattr(limit, key)) < inf:
                beyond = f"is beyond 1, and {_SHARE} is the share of the ticks that were missed"
                item.refuse(beyond, "give a share, such as 0.1 % for one tick in 1000", key=key)
                return False
    if limit.watched not in _NEVER_BELOW_0:
        return True
    is_distance = limit.watched in _DISTANCES
    for key, end in (("high", limit.high), ("inner_high", limit.inner_high)):
        if end < 0.0 and is_distance:
            remedy = "give a distance of 0 or more: it counts in both directions"
            item.refuse("is below 0, and a distance never is", remedy, key=key)
            return False
        if end < 0.0:
            item.refuse(f"is below 0, and {limit.watched} never is", "give 0 or more", key=key)
            return False
    if not is_distance:
        return True
    has_upper = min(limit.high, limit.inner_high) < inf
    if not has_upper and max(limit.low, limit.inner_low) <= 0.0:
        key = "low" if limit.low > -inf else "inner_low"
        limit_text = "can never act: a distance is never below 0"
        item.refuse(limit_text, "give `high: ...`, which counts in both directions", key=key)
        return False
    return True


def _has_time_to_act(item: Located, limit: TestLimit, duration_s: float) -> bool:
    """Return whether a limit can act before the longest stretch in which it holds ends.

    A figure is first judged when `over` of the stretch has passed, and then counts for `for`. If
    that takes longer than the stretch, record a problem.
    """
    longest_s = max((end - begin for begin, end in limit.windows_s), default=duration_s)
    # A stretch that is as long as `over` is over at the instant at which it would first be judged.
    if limit.over_s < longest_s - _INSTANT_S and limit.over_s + limit.for_s <= longest_s:
        return True
    where = f"the segment {limit.during}" if limit.during else "the test"
    length = f"{where} lasts {show(longest_s, 's')}"
    if limit.over_s and limit.over_s >= longest_s - _INSTANT_S:
        over = show(limit.over_s, "s")
        usual = "" if item.get("over") is not None else ", which is the default"
        what = f"can never act: it looks back `over` {over}{usual}, and {length} at most"
        remedy = f"give an `over` below {show(longest_s, 's')}, or let {where} last longer"
        item.refuse(what, remedy, limit.watched, "over")
        return False
    waits = [f"`over` {show(limit.over_s, 's')}"] if limit.over_s else []
    needed = " and ".join([*waits, f"`for` {show(limit.for_s, 's')}"])
    what = f"can never act: it needs {needed}, and {length} at most"
    remedy = f"give less, so that it fits into {show(longest_s, 's')}, or let {where} last longer"
    item.refuse(what, remedy, limit.watched, "for")
    return False
