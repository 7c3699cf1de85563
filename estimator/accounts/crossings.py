"""Crossings: how often noise alone exceeds the limit of a sequential test, and limits for a rate.

A sequential test computes a score for each possible onset of a change. Without a change each score
is standard normal, but the scores are dependent, as a block enters those of all onsets before it.
Noise takes the maximum of the scores over a high limit b, in one direction, at a rate per block of

    r(b) = b phi(b) / 2 * integral of x nu(x)^2 dx,    nu(x) = exp(-0.583 x),

with x from b / w_most^0.5 to b / w_least^0.5 for onsets w_least to w_most blocks ago (Siegmund and
Venkatraman 1995, Ann. Statist. 23, theorem 1, which is for both signs and all onsets).
"""

from functools import lru_cache
from math import exp, log, pi, sqrt
from statistics import NormalDist
from typing import Final

LEAST_LIMIT: Final = 2.0
"""Least limit in standard deviations for which the approximation, made for rare events, holds."""
_STEEPNESS: Final = 2.0 * 0.583
_ROUNDS: Final = 20


def crossing_rate(limit: float, least: int, most: int) -> float:
    """Return the rate per block at which the greatest score of one direction crosses a limit.

    Args:
        limit: the limit in standard deviations, `LEAST_LIMIT` or more.
        least: number of blocks since the latest onset.
        most: number of blocks since the earliest onset.
    """
    density = exp(-0.5 * limit * limit) / sqrt(2.0 * pi)
    return 0.5 * limit * density * _spread(limit, least, most)


@lru_cache(maxsize=4096)
def limit_at(rate: float, least: int, most: int) -> float:
    """Return the limit that the greatest score crosses at a given rate; undoes `crossing_rate`.

    The limit is in standard deviations and not below `LEAST_LIMIT`.

    Args:
        rate: crossings per block.
        least: number of blocks since the latest onset.
        most: number of blocks since the earliest onset.
    """
    limit = 4.0
    for _ in range(_ROUNDS):
        height = 0.5 * limit * _spread(limit, least, most) / (rate * sqrt(2.0 * pi))
        before, limit = limit, sqrt(2.0 * log(max(height, exp(0.5 * LEAST_LIMIT**2))))
        if abs(limit - before) < 1e-6:
            break
    return limit


def student_quantile(probability: float, freedom: float) -> float:
    """Return the value that Student's t exceeds with a small probability, accurate to 3 %.

    It is Wallace's transformation of the normal quantile (Wallace 1959, Ann. Math. Stat. 30).

    Args:
        probability: probability of exceeding the value, on one side, above 0 and below 0.5.
        freedom: degrees of freedom, above 0.
    """
    return _students(_normal_quantile(probability), freedom)


def noise_limit(rate: float, least: int, most: int, freedom: float) -> float:
    """Return the limit that the greatest score crosses at a given rate if the noise is estimated.

    The scores are divided by that estimate. The limit is `limit_at`, raised by Student's t.

    Args:
        rate: crossings per block.
        least: number of blocks since the latest onset.
        most: number of blocks since the earliest onset.
        freedom: degrees of freedom of the estimated noise.
    """
    return _students(limit_at(rate, least, most), freedom)


def between(exact: float, bound: float, model_error: float) -> float:
    """Return a limit that rises linearly with `model_error`: `exact` at 0, `bound` from 1 on."""
    allowed = min(model_error, 1.0)
    return (1.0 - allowed) * exact + allowed * bound


@lru_cache(maxsize=4096)
def _normal_quantile(probability: float) -> float:
    return -NormalDist().inv_cdf(probability)


def _students(z: float, freedom: float) -> float:
    scaled = z * (8.0 * freedom + 3.0) / (8.0 * freedom + 1.0)
    return sqrt(freedom * (exp(scaled * scaled / freedom) - 1.0))


def _spread(limit: float, least: int, most: int) -> float:
    """Return the integral of x nu(x)^2 from limit / most^0.5 to limit / least^0.5."""
    return _below(limit / sqrt(least)) - _below(limit / sqrt(most))


def _below(x: float) -> float:
    return (1.0 - (1.0 + _STEEPNESS * x) * exp(-_STEEPNESS * x)) / _STEEPNESS**2
