"""Play, lag and delay: the laws of effects with a memory, for floats and lanes (`rig.lanes`)."""

from math import floor
from typing import Final

from .compiled import inlined

NO_FRACTION: Final = 1e-6
"""Part of a tick below which the fraction of a delay counts as zero."""


@inlined
def play(follower, leader, half_width):
    """Return the new position of a follower that its leader moves through a play.

    The follower stays within `half_width` of the leader and moves no more than necessary for that.
    All values are in m.
    """
    return min(max(follower, leader - half_width), leader + half_width)


@inlined
def lagged(shown, before, now, steps, kept):
    """Return the output of a first-order lag after a step in which its input changes linearly.

    Args:
        shown: output at the beginning of the step.
        before: input at the beginning of the step, in the same unit.
        now: input at the end of the step.
        steps: time constant of the lag, in steps.
        kept: decay over the step, exp(-1 / steps).
    """
    behind = (now - before) * steps
    return now - behind + kept * (shown - before + behind)


@inlined
def whole_ticks(ticks):
    """Return the number of whole ticks in a delay that is given in ticks.

    A delay that is less than `NO_FRACTION` below a whole number counts as that number.
    """
    return floor(ticks + NO_FRACTION)
