"""A leak that grows within seconds to minutes, and is steady from then on or grows still.

A sudden leak leaves much of such a leak unexplained, from block to block with the same sign. That
counts as noise that lasts, so that no onset is ever sure. Here each leak is fitted as one that grew
from nothing along a straight line over time (`estimator.accounts.Ramp`), from each of some onsets
and over each of some durations.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    SHIFT,
    SUPPLY_LEAKAGE,
    AccountSums,
    FaultProducts,
    Intervals,
    Ramp,
    RampFit,
    RecentBlocks,
    Regression,
    lasting_noise,
)
from rig.plant import LEAKS

from .fault_scores import RIVAL_GAIN, WITNESSES, gains_of
from .finding import Finding

Array = NDArray[np.float64]

DURATIONS_S: Final = tuple(4.0 * 2.0 ** (k / 2.0) for k in range(11))
"""Durations of growth that are tried, s: 4 to 128 in steps of a factor of the root of two. A leak
that grows faster is found as a sudden one, and one that grows more slowly by `fault_size`. Between
two durations a ramp is off by a fifth of its duration at most, until it is refined."""
_LIMITS_S: Final = DURATIONS_S[0], DURATIONS_S[-1]
ONSETS: Final = 40
"""Greatest number of onsets that are tried before the best one is refined. In the first two minutes
they are at most 3 s apart, three quarters of the shortest duration."""
RAMP_PART: Final = 0.05
"""Part of the stated rate of false alarms at which noise may pass for a leak that grows, divided
evenly among the durations. Of the sum of all tests' rates it is a twentieth at most. It is next to
nothing in fact, as a ramp must also be likelier than any sudden fault by odds of e^10. The scores z
of a ramp that goes on and of the sudden fault most like it are correlated by 0.943 (the greatest
value, over a, of (1 + a) sqrt(3 (1 - a)) / 2), so that noise with z = 6 for the ramp, which leaves
5.7 +- 0.33 for the sudden fault, falls short of the 4 that the odds ask for by 5 deviations."""
_REFINEMENTS: Final = 12
"""Most rounds in which the best ramp is refined; each tries ramps around the best one so far."""
_FINEST: Final = 1.05
"""Refinement ends when durations a factor below this apart no longer differ."""
_NULL: Final = SUPPLY_LEAKAGE + 2
"""Index of a null that moves, after those of `FAULTS`; it may do so by any amount."""
_SHAPES: Final = np.array([*range(_NULL), SHIFT, SHIFT])
_EITHER: Final = np.arange(_NULL + 1) >= SUPPLY_LEAKAGE
"""Which causes may act in either direction: the lines' pressures and the null wander both ways."""


class _Ramps:
    """Scores of all causes that change along ramps, beside the nuisances."""

    def __init__(self, sums: AccountSums, least: float) -> None:
        self.intervals = Intervals(sums)
        self.since = sums.faults_since()
        ff, fy, yy = sums.nuisances()
        self._regression = Regression(ff, fy, yy, 2 * sums.blocks, least)
        self.starts = sums.starts_s
        # The last mark since which a leak can have grown for the shortest duration.
        before_s = self.intervals.end_s - DURATIONS_S[0] + 1e-6
        self.last = int(np.searchsorted(self.starts, before_s, side="right")) - 1

    def score(self, marks: NDArray[np.int64], seconds: Array) -> tuple[Array, Array]:
        """Return gains, 0 where not usable, and noise variances, (ramps, causes) each.

        Args:
            marks: mark at which each ramp begins, (ramps,).
            seconds: how long each lasts, s, (ramps,).
        """
        levels = self.intervals.levels(self.starts[marks], seconds)
        ramped = self.intervals.ramped(levels, self.since, marks)
        sizes = np.column_stack([ramped.sizes, np.ones(marks.size)])
        products = FaultProducts(
            ramped.squares[:, _SHAPES[:, None], _SHAPES],
            ramped.crossed[:, _SHAPES],
            ramped.products[:, _SHAPES],
            sizes,
            ramped.blocks,
        )
        visible = (sizes > 0.0) & (ramped.blocks >= WITNESSES)[:, None]
        scores, usable, gain = gains_of(
            self._regression, np.ascontiguousarray(products.crossed), products, visible, _EITHER
        )
        return np.where(usable, gain, 0.0), scores.variance

    def grid(self) -> tuple[NDArray[np.int64], Array]:
        """Return mark and duration of the ramps that are tried first.

        From each onset they have the durations that have passed, and the time since the onset.
        """
        marks = np.unique(np.linspace(0, self.last, min(ONSETS, self.last + 1)).astype(int))
        pairs = [
            (mark, seconds)
            for mark in marks
            for since in [self.intervals.end_s - self.starts[mark]]
            for seconds in [*(each for each in DURATIONS_S if each < since), since]
            if seconds <= DURATIONS_S[-1]
        ]
        of, seconds = zip(*pairs, strict=True) if pairs else ((), ())
        return np.array(of, dtype=np.int64), np.array(seconds, dtype=float)

    def from_one(self, ramp: Ramp) -> tuple[NDArray[np.int64], Array]:
        """Return mark and duration of a ramp, and of one that begins then and goes on until now."""
        mark = min(int(np.searchsorted(self.starts, ramp.begin_s - 1e-6)), self.last)
        since = self.intervals.end_s - float(self.starts[mark])
        both = np.array([min(ramp.seconds, since), since])
        return np.array([mark, mark]), both.clip(*_LIMITS_S)

    def going_on(self, mark: int, apart: int) -> tuple[NDArray[np.int64], Array]:
        """Return mark and duration of ramps that go on until now, from marks around one on."""
        marks = np.arange(max(mark - apart, 0), min(mark + apart, self.last) + 1)
        return marks, (self.intervals.end_s - self.starts[marks]).clip(*_LIMITS_S)

    def near(
        self, mark: int, seconds: float, apart: int, factor: float
    ) -> tuple[NDArray[np.int64], Array]:
        """Return mark and duration of ramps around one, which is among them.

        Args:
            mark: mark at which the ramp begins.
            seconds: how long it lasts, s.
            apart: greatest difference of the marks.
            factor: factor on the duration, and its inverse.
        """
        step = max(apart // 2, 1)
        marks = np.arange(mark - 2 * step, mark + 2 * step + 1, step).clip(0, self.last)
        of, longer = np.meshgrid(np.unique(marks), seconds * np.array([1.0 / factor, 1.0, factor]))
        since = self.intervals.end_s - self.starts[of]
        return of.ravel(), np.minimum(longer, since).clip(*_LIMITS_S).ravel()


def grown_leak(
    sums: AccountSums,
    recent: RecentBlocks,
    dead_zone: Array,
    model_error: float,
    least: float,
    *,
    begin: Ramp | None = None,
) -> Finding | None:
    """Return the leak that most likely grew within the blocks so far; None if none is likely.

    The result is None if a pressure of the lines or a null that moves along a ramp explains as
    much, to odds of e^10, or if the blocks last less than the shortest duration. The leak is taken
    to grow still, unless the odds that it has stopped are e^10.

    Args:
        sums: sums over the blocks.
        recent: the latest blocks, which show whether noise lasts from block to block.
        dead_zone: flow in L/min that each fault must exceed to be claimed, float64 (5,).
        model_error: factor on what is allowed for errors of the model.
        least: lower bound of the estimated noise variance.
        begin: a ramp to begin the search at; None to try the ramps of a grid first.

    Returns:
        The finding, whose `statistic` is that of a sudden fault: it holds without any one block.
        Its `limit` is left at 0 for the caller to set.
    """
    ramps = _Ramps(sums, least)
    if ramps.last < 0:
        return None
    tried = ramps.grid() if begin is None else ramps.from_one(begin)
    if not tried[0].size:
        return None
    best = _best_of(ramps, *tried)
    apart, factor = max(ramps.last // ONSETS, 1), sqrt(sqrt(2.0))
    for _ in range(_REFINEMENTS):
        better = _best_of(ramps, *ramps.near(best.mark, best.seconds, apart, factor))
        if not better.gain > best.gain:
            if apart == 1 and factor < _FINEST:
                break
            apart, factor = max(apart // 2, 1), sqrt(factor)
        else:
            best = better
    going_on = _best_of(ramps, *ramps.going_on(best.mark, 2 * apart + 2))
    if going_on.fault == best.fault and going_on.gain > best.gain - RIVAL_GAIN:
        best = going_on
    if best.gain <= 0.0 or best.rival > best.gain - RIVAL_GAIN:
        return None
    return _sized(ramps, recent, best, dead_zone, model_error)


@dataclass(frozen=True)
class _Best:
    """The leak and the ramp with the greatest gain among some, and the greatest gain of a rival."""

    fault: int
    mark: int
    seconds: float
    gain: float
    rival: float
    variance: float


def _best_of(ramps: _Ramps, marks: NDArray[np.int64], seconds: Array) -> _Best:
    gain, variances = ramps.score(marks, seconds)
    leaks = gain[:, : len(LEAKS)]
    at, fault = np.unravel_index(int(np.argmax(leaks)), leaks.shape)
    return _Best(
        int(fault), int(marks[at]), float(seconds[at]), float(leaks[at, fault]),
        float(gain[:, _EITHER].max()), float(variances[at, fault]),
    )  # fmt: skip


def _sized(
    ramps: _Ramps, recent: RecentBlocks, best: _Best, dead_zone: Array, model_error: float
) -> Finding:
    """Return the finding of the leak that grew along the best ramp, with statistic and size."""
    intervals, mark, fault = ramps.intervals, best.mark, best.fault
    ramp = Ramp(float(ramps.starts[mark]), best.seconds)
    level = intervals.level(ramp)
    shapes, levels = [SHIFT, fault], np.stack([level, level])
    fit = RampFit(intervals, shapes, levels, best.variance)
    # Departures from a straight line must not count as noise, as in `FaultSizes.sudden`.
    blocks = level.size - mark
    loose = fit
    if blocks >= 3 * WITNESSES:
        thirds = np.array([[mark + blocks // 3], [mark + 2 * blocks // 3]])
        changes = (np.arange(level.size) >= thirds).astype(float)
        both = np.vstack([changes, levels])
        loose = RampFit(intervals, [fault, fault, *shapes], both, best.variance)
    lasting = lasting_noise(recent.residuals(loose.nuisances, loose.terms()), model_error)
    dead = float(dead_zone[fault] / ramps.since.sizes[mark, fault])
    rest, error = fit.left_out()
    statistic = float(((rest - dead) / np.sqrt(error * lasting)).min())
    deviation = sqrt(max(fit.error, fit.uneven_error()) * lasting)
    size, mean = float(fit.coefficients[-1]), float(level[mark:].mean())
    return Finding(
        fault, int(intervals.sums.mark_blocks[mark]), size * mean, deviation * mean, statistic,
        best.gain, ramp.begin_s, lasting, size * float(level[-1]), ramp=ramp,
    )  # fmt: skip
