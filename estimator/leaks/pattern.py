"""The thesis's leak identification: which averages of the innovations rise (sections 4.4, 5.3).

One chamber up: an external leak there. Both up: an internal leak. The thesis sets its thresholds by
eye; here they are learnt from healthy running at a stated false-alarm rate.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import student_quantile
from estimator.filters import THESIS_WINDOW, FilterRun, extend_moving_average, start_moving_average
from rig.plant import LEAKS

from .detection import Decision, Samples

Array = NDArray[np.float64]

LEARNING_S: Final = 15.0
"""Healthy stretch that thresholds are learnt from when no healthy run is given; the thesis injects
at 18 s and 20 s."""
STARTED_S: Final = 2.0
"""The filter's start, which says nothing about the rig, is left out."""
EXTERNAL_RATIO: Final = 2.0
"""With both averages above threshold, the chamber whose rise is this many times the other's is
named (table 5.1: an external leak also lifts the other chamber's average a little)."""
_PIECE: Final = 500
"""Samples whose mean is one look at the healthy level: half a second."""


@dataclass(frozen=True)
class PatternBaseline:
    """Healthy levels and thresholds (2,) of the moving averages of both chambers, Pa."""

    normal: Array
    thresholds: Array


@dataclass(frozen=True)
class HealthyLevel:
    """Healthy innovations: mean and deviation (2,) of half-second means of |innovation|, Pa.

    Attributes:
        looks: how many half seconds were seen.
    """

    mean: Array
    deviation: Array
    looks: int

    def baseline(self, false_alarms_per_day: float) -> PatternBaseline:
        """Return the thresholds that healthy moving averages exceed at the stated rate.

        Means of half a second are independent looks at the healthy level; a moving average of 4000
        samples is the mean of eight, and renews itself with every half second. Two chambers and
        172800 such averages a day share the stated rate, and the quantile is Student's for the
        looks there were.
        """
        looks_per_day = 2.0 * 86400.0 / (_PIECE * 1e-3)
        probability = min(false_alarms_per_day / looks_per_day, 0.25)
        quantile = student_quantile(probability, self.looks - 1.0)
        spread = self.deviation * sqrt(_PIECE / THESIS_WINDOW + 1.0 / self.looks)
        return PatternBaseline(self.mean, self.mean + quantile * spread)


def learn_pattern(innovations: Sequence[Array], false_alarms_per_day: float) -> PatternBaseline:
    """Learn the thresholds that healthy moving averages exceed at the stated rate.

    Args:
        innovations: of healthy runs, float64 (n, 2) each: pressures 1 and 2, Pa; 4 s or more.
        false_alarms_per_day: alarms that a healthy rig may raise in a day.

    Raises:
        ValueError: fewer than eight half seconds.
    """
    return healthy_level(innovations).baseline(false_alarms_per_day)


def healthy_level(innovations: Sequence[Array]) -> HealthyLevel:
    """Return the level of healthy innovations, float64 (n, 2) each: pressures 1 and 2, Pa.

    Raises:
        ValueError: fewer than eight half seconds.
    """
    pieces = [_pieces(np.abs(innovation)) for innovation in innovations]
    means = np.concatenate(pieces) if pieces else np.empty((0, 2))
    if means.shape[0] < THESIS_WINDOW // _PIECE:
        raise ValueError(
            f"baseline: {means.shape[0]} half seconds of healthy innovations; give at least 8"
        )
    return HealthyLevel(means.mean(axis=0), means.std(axis=0, ddof=1), means.shape[0])


def _pieces(absolute: Array) -> Array:
    """Return the means (m, 2) of each half second's measured samples, if it has any."""
    count = absolute.shape[0] // _PIECE
    pieces = absolute[: count * _PIECE].reshape(count, _PIECE, 2)
    measured = np.isfinite(pieces).sum(axis=1)
    sums = np.where(np.isfinite(pieces), pieces, 0.0).sum(axis=1)
    known = measured.all(axis=1)
    return np.asarray(sums[known] / measured[known])


PATTERNS: Final = ("healthy", *LEAKS)
"""Verdicts, by the number that `pattern_of` gives them."""


def pattern_of(averages: Array, baseline: PatternBaseline) -> NDArray[np.intp]:
    """Return which of `PATTERNS` moving averages show (section 5.3).

    Args:
        averages: float64 (..., 2, *rigs) of both chambers, Pa, the levels and thresholds of the
            baseline being (2, *rigs).
        baseline: learnt from healthy running.
    """
    axis = -baseline.normal.ndim
    up = averages > baseline.thresholds
    rise = np.maximum(averages - baseline.normal, 0.0)
    both = up.all(axis=axis) & (rise.max(axis=axis) < EXTERNAL_RATIO * rise.min(axis=axis))
    pattern = np.where(both, 3, 1 + np.argmax(rise, axis=axis))
    return np.where(up.any(axis=axis), pattern, 0)


class PatternDetector:
    """Compares moving averages of the absolute innovations of both chambers with their thresholds.

    Args:
        false_alarms_per_day: alarms that a healthy rig may raise in a day.
        baseline: learnt from healthy runs; else the first 15 s are taken as healthy.
    """

    def __init__(
        self, false_alarms_per_day: float = 1.0, baseline: PatternBaseline | None = None
    ) -> None:
        self.false_alarms_per_day = false_alarms_per_day
        self.baseline = baseline
        self._memories = (start_moving_average(), start_moving_average())
        self._healthy: list[Array] = []
        self._current = np.zeros(2)
        self._onset: float | None = None
        self._start: float | None = None

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Take the next samples; judge by the innovation (docs/model.md says why)."""
        if self._start is None:
            self._start = float(samples.time_s[0])
        elapsed = samples.time_s - self._start
        started = elapsed > STARTED_S
        if not started.any():
            return
        innovation = run.innovation[started, 1:3]
        averages = np.column_stack(
            [extend_moving_average(m, innovation[:, i]) for i, m in enumerate(self._memories)]
        )
        self._current = averages[-1]
        if self.baseline is None:
            self._healthy.append(innovation)
            if elapsed[-1] >= LEARNING_S:
                healthy = [np.concatenate(self._healthy)]
                self.baseline = learn_pattern(healthy, self.false_alarms_per_day)
            return
        if elapsed[-1] < STARTED_S + THESIS_WINDOW * 1e-3:
            return
        above = np.asarray((averages > self.baseline.thresholds).any(axis=1))
        if self._onset is None and above.any():
            self._onset = float(samples.time_s[started][np.argmax(above)])

    def decide(self) -> Decision:
        """Return the verdict by the pattern of section 5.3."""
        if self.baseline is None:
            return Decision("inconclusive")
        thresholds = self.baseline.thresholds
        details = {f"average_{i + 1}_Pa": float(self._current[i]) for i in range(2)}
        details |= {f"threshold_{i + 1}_Pa": float(thresholds[i]) for i in range(2)}
        ratio = float((self._current / thresholds).max())
        verdict = PATTERNS[int(pattern_of(self._current, self.baseline))]
        if self._onset is None or verdict == "healthy":
            return Decision("healthy", statistic=ratio, threshold=1.0, details=details)
        return Decision(verdict, self._onset, statistic=ratio, threshold=1.0, details=details)
