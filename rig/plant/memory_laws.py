"""Play, lag and delay: the laws by which effects remember, on floats and on lanes (`rig.lanes`)."""

from math import floor
from typing import Final

from .compiled import inlined

NO_FRACTION: Final = 1e-6
"""Part of a tick below which a delay is one of whole ticks."""


@inlined
def play(follower, leader, half_width):
    """Return where a follower in m is that its leader takes along at the ends of a play."""
    return min(max(follower, leader - half_width), leader + half_width)


@inlined
def lagged(shown, before, now, steps, kept):
    """Return what a first-order lag shows at the end of a step over which its input changes evenly.

    Args:
        shown: what it showed at the beginning.
        before: the input at the beginning, of the same unit.
        now: the input at the end.
        steps: the time constant, in such steps.
        kept: the part of a distance that is left after the step, exp(-1 / steps).
    """
    behind = (now - before) * steps
    return now - behind + kept * (shown - before + behind)


@inlined
def whole_ticks(ticks):
    """Return the whole ticks of a delay in ticks; one that rounding left a little short counts."""
    return floor(ticks + NO_FRACTION)
