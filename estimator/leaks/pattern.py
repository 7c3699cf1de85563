"""The thesis's leak detector, which watches averages of the innovations (sections 4.4, 5.3).

If the average of one chamber's pressure rises, there is an external leak of that chamber; if both
rise, an internal leak. The thesis sets its thresholds by eye; here they are learnt from healthy
running at a stated rate of false alarms.
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

from .decision import Decision
from .oil_account import Samples

Array = NDArray[np.float64]

LEARNING_S: Final = 15.0
"""Seconds from the start that are taken as healthy and used to learn the thresholds if no healthy
run is given; the thesis injects its leaks at 18 s and 20 s."""
STARTED_S: Final = 2.0
"""Seconds from the start that are left out, as they show the filter's start and not the rig."""
EXTERNAL_RATIO: Final = 2.0
"""If both averages are above their thresholds and one has risen at least this many times as much
as the other, an external leak of that chamber is named. Table 5.1: an external leak also raises
the other chamber's average a little."""
_PIECE: Final = 500
"""Samples (half a second) whose mean is one observation of the healthy level."""
LEAST_LOOKS: Final = THESIS_WINDOW // _PIECE
"""Least half seconds that a healthy level is learnt from: the window of a moving average (4 s)."""


@dataclass(frozen=True)
class PatternBaseline:
    """Levels and thresholds of the moving averages of both chambers, float64 (2,) each, in Pa.

    Attributes:
        normal: averages of a healthy rig.
        thresholds: values above which an average counts as raised.
    """

    normal: Array
    thresholds: Array


@dataclass(frozen=True)
class HealthyLevel:
    """The level of |innovation| of both pressures on a healthy rig, from means over half a second.

    Attributes:
        mean: mean of the half-second means of |innovation|, float64 (2,), Pa.
        deviation: standard deviation of the half-second means, float64 (2,), Pa.
        looks: number of half seconds that were averaged.
    """

    mean: Array
    deviation: Array
    looks: int

    def baseline(self, false_alarms_per_day: float) -> PatternBaseline:
        """Return the levels and the thresholds that healthy averages exceed at the stated rate.

        Means over half a second count as independent. A moving average of 4000 samples is the mean
        of eight of them, and a new one comes every half second: 172800 a day for each of two
        chambers, which share the stated rate. The quantile is Student's, by the number of looks.
        """
        looks_per_day = 2.0 * 86400.0 / (_PIECE * 1e-3)
        probability = min(false_alarms_per_day / looks_per_day, 0.25)
        quantile = student_quantile(probability, self.looks - 1.0)
        spread = self.deviation * sqrt(_PIECE / THESIS_WINDOW + 1.0 / self.looks)
        return PatternBaseline(self.mean, self.mean + quantile * spread)


def learn_pattern(innovations: Sequence[Array], false_alarms_per_day: float) -> PatternBaseline:
    """Return the levels and thresholds that follow from the innovations of healthy runs.

    Args:
        innovations: innovations of pressures 1 and 2 in each healthy run, float64 (n, 2), Pa.
        false_alarms_per_day: alarms that a healthy rig may raise in a day.

    Raises:
        ValueError: there are fewer than eight half seconds (4 s) in all.
    """
    return healthy_level(innovations).baseline(false_alarms_per_day)


def healthy_level(innovations: Sequence[Array]) -> HealthyLevel:
    """Return the level of |innovation| in healthy runs: mean and scatter of half-second means.

    NaN samples and the incomplete half second at the end of each run are left out.

    Args:
        innovations: innovations of pressures 1 and 2 in each run, float64 (n, 2), Pa.

    Raises:
        ValueError: there are fewer than eight half seconds (4 s) in all.
    """
    pieces = [_pieces(np.abs(innovation)) for innovation in innovations]
    means = np.concatenate(pieces) if pieces else np.empty((0, 2))
    if means.shape[0] < LEAST_LOOKS:
        raise ValueError(
            f"baseline: {means.shape[0]} half seconds of healthy innovations; give at least "
            f"{LEAST_LOOKS}"
        )
    return HealthyLevel(means.mean(axis=0), means.std(axis=0, ddof=1), means.shape[0])


def _pieces(absolute: Array) -> Array:
    """Return the mean of each half second of values (n, 2), float64 (m, 2), NaN left out.

    A half second in which a chamber has no measured sample is left out.
    """
    count = absolute.shape[0] // _PIECE
    pieces = absolute[: count * _PIECE].reshape(count, _PIECE, 2)
    measured = np.isfinite(pieces).sum(axis=1)
    sums = np.where(np.isfinite(pieces), pieces, 0.0).sum(axis=1)
    known = measured.all(axis=1)
    return np.asarray(sums[known] / measured[known])


PATTERNS: Final = ("healthy", *LEAKS)
"""Verdicts; `pattern_of` returns indices into this tuple."""


def pattern_of(averages: Array, baseline: PatternBaseline) -> NDArray[np.intp]:
    """Return the index into `PATTERNS` of the pattern that moving averages show (section 5.3).

    It is an internal leak if both averages are above their thresholds and neither has risen
    `EXTERNAL_RATIO` times as much as the other. In all other cases with an average above its
    threshold it is an external leak of the chamber whose average has risen more.

    Args:
        averages: moving averages of both chambers, float64 (..., 2, *rigs), Pa.
        baseline: levels and thresholds, (2, *rigs) each.

    Returns:
        Indices of shape (..., *rigs); 0 (healthy) where no average is above its threshold.
    """
    axis = -baseline.normal.ndim
    up = averages > baseline.thresholds
    rise = np.maximum(averages - baseline.normal, 0.0)
    both = up.all(axis=axis) & (rise.max(axis=axis) < EXTERNAL_RATIO * rise.min(axis=axis))
    pattern = np.where(both, 3, 1 + np.argmax(rise, axis=axis))
    return np.where(up.any(axis=axis), pattern, 0)


class PatternDetector:
    """The thesis's detector: compares averages of absolute innovations with their thresholds.

    Args:
        false_alarms_per_day: alarms that a healthy rig may raise in a day.
        baseline: levels and thresholds; if None they are learnt from the first 15 s, which are
            then taken as healthy.
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
        """Take the next samples, one or more; their innovations are averaged (docs/model.md).

        The first 2 s are left out. Without a baseline, one is learnt as soon as 15 s have passed.
        With it, the first sample with an average above its threshold is kept as the onset, but none
        before the averages cover 4 s.
        """
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
        """Return the decision by the pattern (section 5.3) that the averages show now.

        It is inconclusive until there is a baseline, and healthy until `update` has kept an onset.
        A fault whose averages have fallen below their thresholds again is no longer named.
        """
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
