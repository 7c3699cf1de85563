"""Stiction along the stroke: the mean of the break-aways, and its trend with the position."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, nan, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import student_quantile

from .break_away import BreakAway

Array = NDArray[np.float64]

LEAST_PLACES: Final = 4
"""Fewest places for a level; the standard errors rest on the differences between places."""
TREND_PROBABILITY: Final = 0.01
"""Probability that a rig with the same stiction everywhere is said to have a trend."""


class Trend(NamedTuple):
    """The slope of a force along the stroke (N/m), its standard error, and whether it is real.

    A force that is the same everywhere seems to have a slope with a probability of
    `TREND_PROBABILITY` only.
    """

    slope: float
    standard_error: float
    significant: bool


@dataclass(frozen=True)
class StictionLevel:
    """Mean and trend of the break-aways at all places along the stroke.

    Attributes:
        level, level_error: half the difference of extending and retracting force, mean over the
            places, and its standard error, N.
        offset, offset_error: half the sum of both forces, mean over the places, and its standard
            error, N; it comes from asymmetric friction and from biases of the transducers.
        creep: mean speed at the greatest force, m/s.
        level_trend: trend of the level; it shows stiction that depends on the position.
        offset_trend: trend of the offset; it shows a spring that was not specified.
        places: number of places with a break-away in both directions.
    """

    level: float
    level_error: float
    offset: float
    offset_error: float
    creep: float
    level_trend: Trend
    offset_trend: Trend
    places: int


_NO_TREND: Final = Trend(nan, inf, False)
NO_LEVEL: Final = StictionLevel(nan, inf, nan, inf, nan, _NO_TREND, _NO_TREND, 0)


def stiction_level(places: Sequence[Sequence[BreakAway]]) -> StictionLevel:
    """Return the stiction of all places where the ram took off in both directions.

    The standard errors of level and offset follow from the scatter between places and are widened
    by Student's t, so that 1.96 of them make a 95 % interval; those of the trends are not widened.

    Args:
        places: the break-aways of each ramp (`break_away.break_aways`).

    Returns:
        The stiction; `NO_LEVEL` if there are fewer than `LEAST_PLACES` such places.
    """
    pairs = []
    for found in places:
        by_direction = {each.direction: each for each in found if each.taken_off}
        if len(by_direction) == 2:
            pairs.append((by_direction[-1], by_direction[1]))
    if len(pairs) < LEAST_PLACES:
        return NO_LEVEL
    position = np.array([0.5 * (back.position + out.position) for back, out in pairs])
    level = np.array([0.5 * (out.force - back.force) for back, out in pairs])
    offset = np.array([0.5 * (out.force + back.force) for back, out in pairs])
    creep = float(np.mean([0.5 * (out.velocity - back.velocity) for back, out in pairs]))
    return StictionLevel(
        float(level.mean()), _error_of_mean(level),
        float(offset.mean()), _error_of_mean(offset),
        creep, _trend(position, level), _trend(position, offset), len(pairs),
    )  # fmt: skip


def _error_of_mean(values: Array) -> float:
    widening = student_quantile(0.025, values.size - 1.0) / 1.96
    return float(widening * np.std(values, ddof=1)) / sqrt(values.size)


def _trend(position: Array, values: Array) -> Trend:
    """Return the slope of the straight line through values (n,) over position (n,) in m.

    Whether it is significant is decided by Student's test.
    """
    centred = position - position.mean()
    spread = float(centred @ centred)
    slope = float(centred @ values) / spread
    rest = values - values.mean() - slope * centred
    freedom = values.size - 2
    error = sqrt(float(rest @ rest) / freedom / spread)
    limit = student_quantile(0.5 * TREND_PROBABILITY, freedom)
    return Trend(slope, error, abs(slope) > limit * error)
