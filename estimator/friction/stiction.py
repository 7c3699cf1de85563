"""Stiction along the stroke: the mean of the break-aways, and whether it depends on the place."""

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
"""Fewer say nothing of how much places differ, which the standard errors rest on."""
TREND_PROBABILITY: Final = 0.01
"""Rate at which a rig with the same stiction everywhere is said to have a trend."""


class Trend(NamedTuple):
    """How something changes along the stroke, N/m."""

    slope: float
    standard_error: float
    significant: bool


@dataclass(frozen=True)
class StictionLevel:
    """What the break-aways of all places have in common.

    Attributes:
        level, level_error: half of extending less retracting, mean of the places, N.
        offset, offset_error: half their sum, N: asymmetry, and what transducers are off by.
        creep: mean speed at the greatest force, m/s.
        level_trend: of the level: stiction that depends on the position.
        offset_trend: of the offset: a spring that nobody told of.
        places: with a break-away both ways.
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
    """Return the level of the places where the ram took off both ways; `NO_LEVEL` if too few.

    Standard errors are of the scatter between places, widened by Student's t, so that 1.96 of them
    make a 95 % interval.

    Args:
        places: what each ramp showed (`break_away.break_aways`).
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
    """Return the straight line through values over position, tested by Student's t."""
    centred = position - position.mean()
    spread = float(centred @ centred)
    slope = float(centred @ values) / spread
    rest = values - values.mean() - slope * centred
    freedom = values.size - 2
    error = sqrt(float(rest @ rest) / freedom / spread)
    limit = student_quantile(0.5 * TREND_PROBABILITY, freedom)
    return Trend(slope, error, abs(slope) > limit * error)
