"""How often noise alone takes a sequential test over a limit, and the limit for a stated rate.

A standard score of a change with an unknown onset is normal at any time and for any onset, but no
two of them are independent: what one block adds enters all onsets before it. Noise takes their
maximum over a high limit b, in one direction, at a rate per block of

    r(b) = b phi(b) / 2 * integral of x nu(x)^2 dx,    nu(x) = exp(-0.583 x),

with x from b / w_most^0.5 to b / w_least^0.5 for onsets w_least to w_most blocks ago (Siegmund and
Venkatraman 1995, Ann. Statist. 23, theorem 1, there for both signs and all onsets).
"""

from functools import lru_cache
from math import exp, log, pi, sqrt
from statistics import NormalDist
from typing import Final

LEAST_LIMIT: Final = 2.0
"""Below it the approximation, which is for rare events, does not hold."""
_STEEPNESS: Final = 2.0 * 0.583
_ROUNDS: Final = 20


def crossing_rate(limit: float, least: int, most: int) -> float:
    """Return how often a block the score of one direction exceeds a limit.

    Args:
        limit: in standard deviations, `LEAST_LIMIT` or more.
        least: blocks since the latest onset.
        most: blocks since the earliest one.
    """
    density = exp(-0.5 * limit * limit) / sqrt(2.0 * pi)
    return 0.5 * limit * density * _spread(limit, least, most)


@lru_cache(maxsize=4096)
def limit_at(rate: float, least: int, most: int) -> float:
    """Return the limit that one direction exceeds at a rate per block; at least `LEAST_LIMIT`."""
    limit = 4.0
    for _ in range(_ROUNDS):
        height = 0.5 * limit * _spread(limit, least, most) / (rate * sqrt(2.0 * pi))
        before, limit = limit, sqrt(2.0 * log(max(height, exp(0.5 * LEAST_LIMIT**2))))
        if abs(limit - before) < 1e-6:
            break
    return limit


def student_quantile(probability: float, freedom: float) -> float:
    """Return the value that Student's t exceeds with a (small) probability, to 3 %.

    Wallace's transformation of the normal quantile (Wallace 1959, Ann. Math. Stat. 30).
    """
    return _students(-NormalDist().inv_cdf(probability), freedom)


def noise_limit(rate: float, least: int, most: int, freedom: float) -> float:
    """Return what a score whose noise is estimated exceeds at a rate per block (`limit_at`)."""
    return _students(limit_at(rate, least, most), freedom)


def between(exact: float, bound: float, model_error: float) -> float:
    """Return the limit for a model that is exact (0) to one that errs as usual (1 and more)."""
    allowed = min(model_error, 1.0)
    return (1.0 - allowed) * exact + allowed * bound


def _students(z: float, freedom: float) -> float:
    scaled = z * (8.0 * freedom + 3.0) / (8.0 * freedom + 1.0)
    return sqrt(freedom * (exp(scaled * scaled / freedom) - 1.0))


def _spread(limit: float, least: int, most: int) -> float:
    """Return the integral of x nu(x)^2 over the onsets."""
    return _below(limit / sqrt(least)) - _below(limit / sqrt(most))


def _below(x: float) -> float:
    return (1.0 - (1.0 + _STEEPNESS * x) * exp(-_STEEPNESS * x)) / _STEEPNESS**2
