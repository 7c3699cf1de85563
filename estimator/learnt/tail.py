"""How often a statistic exceeds limits that are higher than those that were seen exceeded.

The peaks of a statistic over a low limit u come as a Poisson process, and their excesses are nearly
exponential (peaks over threshold: Pickands 1975, Ann. Statist. 3; Davison and Smith 1990, J. R.
Statist. Soc. B 52). How many there are in a time T, and how far they go, is uncertain by their
number n. With Jeffreys's prior of the rate and a prior of n0 peaks of the mean excess s0, the
expected rate of peaks beyond x is

    rate(x) = (n + 1/2) / T * (1 + (x - u) / S)^-(n + n0),     S = sum of excesses + n0 s0
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

PRIOR_PEAKS: Final = 5.0
"""Number of peaks n0 that the priors of the mean excess count as."""
PRIOR_EXCESS: Final = 0.5
"""Mean excess s0 of the prior. Normal noise beyond a limit u has 1 / u: 0.3 beyond 3.5; errors of a
model have longer tails."""
_DRAWS: Final = 5_000


@dataclass(frozen=True)
class Tail:
    """Peaks of the test's statistic over a low limit in healthy hours.

    Attributes:
        base: the low limit.
        hours: time in which it could be exceeded, h.
        peaks: number of peaks.
        excess: sum of what they exceeded it by.
    """

    base: float
    hours: float
    peaks: int
    excess: float

    def rate(self, limit: float) -> float:
        """Return the expected number of alarms a day with a limit of `base` or more."""
        return self._rate * float((1.0 + (limit - self.base) / self._scale) ** -self._count)

    def limit(self, alarms_per_day: float) -> float:
        """Return the limit that is exceeded at a rate, on average over what is not known of it.

        It is not below `base`.
        """
        times = max(self._rate / alarms_per_day, 1.0)
        return self.base + self._scale * (float(times ** (1.0 / self._count)) - 1.0)

    def interval(self, limit: float) -> tuple[float, float]:
        """Return the 90 % interval of the alarms a day with a limit, by its posterior."""
        return _interval(self, limit)

    @property
    def _rate(self) -> float:
        return (self.peaks + 0.5) / self.hours * 24.0

    @property
    def _count(self) -> float:
        return self.peaks + PRIOR_PEAKS

    @property
    def _scale(self) -> float:
        return self.excess + PRIOR_PEAKS * PRIOR_EXCESS


@lru_cache(maxsize=256)
def _interval(tail: Tail, limit: float) -> tuple[float, float]:
    rng = np.random.default_rng(0)
    rates = rng.gamma(tail.peaks + 0.5, 24.0 / tail.hours, _DRAWS)
    steepness = rng.gamma(tail._count, 1.0 / tail._scale, _DRAWS)
    beyond = rates * np.exp(-steepness * max(limit - tail.base, 0.0))
    low, high = np.quantile(beyond, (0.05, 0.95))
    return float(low), float(high)


def tail_of(statistics: Sequence[float], base: float, hours: float) -> Tail:
    """Return the tail of the peaks among some statistics; those up to `base` do not count."""
    over = [statistic - base for statistic in statistics if statistic > base]
    return Tail(base, hours, len(over), float(sum(over)))
