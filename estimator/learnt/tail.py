"""How often a statistic exceeds limits that are higher than those that were seen exceeded.

The peaks of a statistic over a low limit u come as a Poisson process, and their excesses are nearly
exponential (peaks over threshold: Pickands 1975, Ann. Statist. 3; Davison and Smith 1990, J. R.
Statist. Soc. B 52). How many there are in a time T, and how far they go, is uncertain by their
number n. With Jeffreys's prior of the rate and a prior of n0 peaks of the mean excess s0, the
expected rate of peaks beyond x is

    rate(x) = (n + 1/2) / T * (1 + (x - u) / S)^-(n + n0),     S = sum of excesses + n0 s0

The mean excess is not the same in each hour of a rig. If its inverse differs between hours by a
relative variance c^2, that of a later hour is known from H hours no better than by

    1/k = 1 / (n + n0) + c^2 (1 + 1/H)

which is what k peaks tell: k takes the place of n + n0, and S becomes k / (n + n0) times itself.

Peaks come more often in some regimes than in others. With n_r peaks in the time T_r of a regime,
the first factor, L = (n + 1/2) / T, becomes (n_r + m) / (T_r + m / L). It is the mean of the rate's
posterior if its prior is a gamma distribution about L with the weight of m peaks. The excesses are
those of all regimes: one regime has too few peaks to tell.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

PRIOR_PEAKS: Final = 5.0
"""Number of peaks n0 that the priors of the mean excess count as."""
PRIOR_EXCESS: Final = 0.5
"""Mean excess s0 of the prior. Normal noise beyond a limit u has 1 / u: 0.3 beyond 3.5; errors of a
model have longer tails."""
REGIME_WEIGHT: Final = 5.0
"""Number of peaks m that the rate of all regimes counts as for that of each. It is that of the
other prior: a regime of six minutes has some two peaks in an hour, which alone say little."""
HOURS_DIFFER: Final = 0.01
"""Relative variance c^2 of the inverse mean excess between hours of a rig, a deviation of 10 %.

On three rigs of the other simulator (seeds 4040, 4043 and 4044; 5.6 h) the logarithm of the mean
excess differed from an hour of baseline to an hour judged by a variance of 0.143, of which 0.125 is
chance; the rest is that of two hours. On five rigs that were not seen (4060 to 4064) there were
0.65 times the 100 alarms a day that were set, and one of 4 at 10 (docs/detection.md).
"""
_DRAWS: Final = 5_000


class RegimePeaks(NamedTuple):
    """Peaks that began in one regime.

    Attributes:
        regime: its name.
        hours: time in it, h.
        peaks: number of peaks.
    """

    regime: str
    hours: float
    peaks: int


@dataclass(frozen=True)
class Tail:
    """Peaks of the test's statistic over a low limit in healthy hours.

    Attributes:
        base: the low limit.
        hours: time in which it could be exceeded, h.
        peaks: number of peaks.
        excess: sum of what they exceeded it by.
        regimes: the same peaks and hours by regime. It is empty in files of earlier versions, whose
            base was 3 on every rig. Most rigs never went beyond that, so that their limit follows
            from noise alone.
    """

    base: float
    hours: float
    peaks: int
    excess: float
    regimes: tuple[RegimePeaks, ...] = ()

    def rate(self, limit: float, regime: str | None = None) -> float:
        """Return the expected number of alarms a day with a limit of `base` or more.

        Args:
            limit: value that the statistic must exceed.
            regime: the regime, in which all of the day is spent; None for days like the hours that
                the peaks are from.
        """
        times = float((1.0 + (limit - self.base) / self._scale) ** -self._count)
        return self._rate(regime) * times

    def limit(
        self, alarms_per_day: float, regime: str | None = None, enough: float = np.inf
    ) -> float:
        """Return the limit that is exceeded at a rate, on average over what is not known of it.

        It is not below `base`. That hours differ makes it no higher than `enough`.

        Args:
            alarms_per_day: the rate.
            regime: the regime in which the statistic has to exceed the limit; None for any.
            enough: a limit that few peaks, from which k is small, are no reason to go beyond.
        """
        times = max(self._rate(regime) / alarms_per_day, 1.0)
        careful = self.base + self._scale * (float(times ** (1.0 / self._count)) - 1.0)
        if careful <= enough:
            return careful
        count = self.peaks + PRIOR_PEAKS
        alike = self.base + self._total * (float(times ** (1.0 / count)) - 1.0)
        return min(careful, max(alike, enough))

    def interval(self, alarms_per_day: float) -> tuple[float, float]:
        """Return the 90 % interval, by the posterior, of the alarms a day that a setting leads to.

        They are those with the limits (`limit`) for that setting, in a later hour that has as much
        of each regime as the hours that the peaks are from.
        """
        return _interval(self, alarms_per_day)

    def _rate(self, regime: str | None) -> float:
        """Return the expected number of peaks a day, in one regime or in all."""
        rate = (self.peaks + 0.5) / self.hours
        for each in self.regimes:
            if each.regime == regime:
                prior = REGIME_WEIGHT / rate
                rate = (each.peaks + REGIME_WEIGHT) / (each.hours + prior)
                break
        return 24.0 * rate

    @property
    def _count(self) -> float:
        """The number k of peaks that would tell as much of a later hour."""
        count = self.peaks + PRIOR_PEAKS
        if not self.regimes:
            return count
        return 1.0 / (1.0 / count + HOURS_DIFFER * (1.0 + 1.0 / max(self.hours, 1.0)))

    @property
    def _scale(self) -> float:
        return self._total * self._count / (self.peaks + PRIOR_PEAKS)

    @property
    def _total(self) -> float:
        return self.excess + PRIOR_PEAKS * PRIOR_EXCESS


@lru_cache(maxsize=256)
def _interval(tail: Tail, alarms_per_day: float) -> tuple[float, float]:
    rng = np.random.default_rng(0)
    rates = rng.gamma(tail.peaks + 0.5, 24.0 / tail.hours, _DRAWS)
    steepness = rng.gamma(tail._count, 1.0 / tail._scale, _DRAWS)
    if not tail.regimes:
        limit = tail.limit(alarms_per_day)
        beyond = rates * np.exp(-steepness * (limit - tail.base))
    else:
        beyond = np.zeros(_DRAWS)
        for each in tail.regimes:
            hours = each.hours + REGIME_WEIGHT * 24.0 / rates
            own = rng.gamma(each.peaks + REGIME_WEIGHT, 24.0 / hours)
            limit = tail.limit(alarms_per_day, each.regime)
            part = each.hours / tail.hours
            beyond += part * own * np.exp(-steepness * (limit - tail.base))
    low, high = np.quantile(beyond, (0.05, 0.95))
    return float(low), float(high)


def tail_of(
    peaks: Sequence[tuple[float, str]], base: float, hours: float, regimes: dict[str, float]
) -> Tail:
    """Return the tail of some peaks; those up to `base` do not count.

    Args:
        peaks: greatest statistic of each, and the regime in which it began.
        base: the low limit.
        hours: time in which peaks could come, h.
        regimes: the part of that time in each regime, h.
    """
    over = [(statistic - base, regime) for statistic, regime in peaks if statistic > base]
    counted = tuple(
        RegimePeaks(name, time, sum(regime == name for _, regime in over))
        for name, time in regimes.items()
    )
    return Tail(base, hours, len(over), float(sum(excess for excess, _ in over)), counted)
