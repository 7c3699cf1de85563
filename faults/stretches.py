"""The stretches of a test over each of which a figure of it is computed, as they are laid out."""

from itertools import pairwise
from math import inf
from typing import Final

import numpy as np

from control import Sequence, Setpoint, period_of
from rig.plant import TICK

from .criteria import STEP_M, LimitEach

Stretches = tuple[tuple[float, float], ...]

_ROUNDING_S: Final = TICK
"""Time in s by which a motion may be too short for its last cycle: a motion that is given in cycles
lasts for a whole number of ticks."""


def stretches_of(
    setpoint: Setpoint,
    duration_s: float,
    during: str,
    each: LimitEach,
) -> Stretches:
    """Return (begin, end) of each stretch of a kind, in s of the motion as it is laid out.

    A "test" is one stretch without an end, because a test may last for less or longer than planned
    by a tick. A "segment" is one without its blend. A "cycle" is a whole period of a setpoint that
    repeats itself, counted from its begin; a part of one at the end is none. Where "step" is asked
    for, the result is where steps are looked for, and ends where they do: in each of the segments,
    with its blend unless `during` is given, or in the whole test if it has none.

    Args:
        setpoint: the setpoint of the test.
        duration_s: how long the test lasts, s.
        during: name of the segments to which the stretches are confined; empty for the whole test.
        each: the kind of stretch.

    Returns:
        The stretches in their order; none if the motion has none of that kind.
    """
    pieces = _pieces(setpoint, duration_s, during)
    if each == "cycle":
        return tuple(cycle for piece in pieces for cycle in _cycles(*piece))
    if each == "segment" or during:
        is_whole = not isinstance(setpoint, Sequence)
        return () if is_whole else tuple((begin, end) for _, begin, end in pieces)
    if each == "step" and isinstance(setpoint, Sequence):
        return tuple(pairwise((*setpoint.starts_s, inf)))
    return ((0.0, inf),)


def has_step(setpoint: Setpoint, duration_s: float, during: str) -> bool:
    """Return whether a setpoint jumps by more than `STEP_M` in a tick.

    The arguments are those of `stretches_of`.
    """
    for each, begin_s, end_s in _pieces(setpoint, duration_s, during):
        ticks = np.arange(round((end_s - begin_s) / TICK))
        if np.any(np.abs(np.diff(each.sample(ticks * TICK))) > STEP_M):
            return True
    return False


def _pieces(
    setpoint: Setpoint, duration_s: float, during: str
) -> list[tuple[Setpoint, float, float]]:
    """Return (setpoint, begin, end) of each segment, or of the whole test if it has none."""
    if not isinstance(setpoint, Sequence):
        return [(setpoint, 0.0, duration_s)]
    return [
        (each.setpoint, start + each.blend_s, start + each.total_s)
        for start, each in zip(setpoint.starts_s, setpoint.stretches, strict=True)
        if not during or each.name == during
    ]


def _cycles(setpoint: Setpoint, begin_s: float, end_s: float) -> Stretches:
    period_s = period_of(setpoint)
    if not period_s:
        return ()
    count = int((end_s - begin_s + _ROUNDING_S) / period_s)
    begins_s = [begin_s + number * period_s for number in range(count)]
    return tuple((each, min(each + period_s, end_s)) for each in begins_s)
