"""The thesis's leak identification: which moving averages of the residuals rise (sections 4.4, 5.3).

One chamber up: an external leak there. Both up: an internal leak. The thesis sets its thresholds by
eye; here they are learnt from a healthy stretch at a stated false-alarm rate.
"""

from math import exp, log, sqrt
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .detection import Decision, Samples
from .filters import FilterRun
from .residuals import THESIS_WINDOW, extend_moving_average, start_moving_average

Array = NDArray[np.float64]

LEARNING_S: Final = 15.0
"""Healthy stretch that thresholds are learnt from when no baseline is given; the thesis injects at
18 s and 20 s."""
STARTED_S: Final = 2.0
"""The filter's start, which says nothing about the rig, is left out."""
EXTERNAL_RATIO: Final = 2.0
"""With both averages above threshold, the chamber whose rise is this many times the other's is named
(table 5.1: an external leak also lifts the other chamber's average a little)."""


class PatternDetector:
    """Compares moving averages of the absolute innovations of both chambers with their thresholds.

    Args:
        false_alarms_per_day: alarms that a healthy rig may raise in a day.
        thresholds: averages (Pa) of chambers 1 and 2 learnt from healthy recordings; else the first
            15 s of the recording are taken as healthy.
    """

    def __init__(
        self, false_alarms_per_day: float = 1.0, thresholds: tuple[float, float] | None = None
    ) -> None:
        self.false_alarms_per_day = false_alarms_per_day
        self._averages = (start_moving_average(), start_moving_average())
        self._healthy: list[Array] = []
        self._thresholds = None if thresholds is None else np.array(thresholds)
        self._normal = np.array([np.nan, np.nan]) if thresholds is None else np.array(thresholds)
        self._current = np.zeros(2)
        self._onset: float | None = None
        self._start: float | None = None

    def update(self, samples: Samples, run: FilterRun) -> None:
        """Take the next samples; judge by the innovation, as docs/model.md says why."""
        if self._start is None:
            self._start = float(samples.time_s[0])
        innovation = run.innovation[:, 1:3]
        averages = np.column_stack(
            [extend_moving_average(memory, innovation[:, i]) for i, memory in enumerate(self._averages)]
        )
        elapsed = samples.time_s - self._start
        if self._thresholds is None:
            self._healthy.append(averages[elapsed > STARTED_S + THESIS_WINDOW * 1e-3])
            if elapsed[-1] >= LEARNING_S:
                healthy = np.concatenate(self._healthy)
                self._normal = healthy.mean(axis=0)
                self._thresholds = learn_thresholds(healthy, self.false_alarms_per_day)
        self._current = averages[-1]
        if self._thresholds is not None and self._onset is None:
            above = np.flatnonzero((averages > self._thresholds).any(axis=1))
            if above.size:
                self._onset = float(samples.time_s[above[0]])

    def decide(self) -> Decision:
        """Return the verdict by the pattern of section 5.3."""
        if self._thresholds is None:
            return Decision("inconclusive")
        up = self._current > self._thresholds
        ratio = float((self._current / self._thresholds).max())
        details = {
            f"average_{i + 1}_Pa": float(self._current[i]) for i in range(2)
        } | {f"threshold_{i + 1}_Pa": float(self._thresholds[i]) for i in range(2)}
        if not up.any():
            self._onset = None
            return Decision("healthy", statistic=ratio, threshold=1.0, details=details)
        rise = np.maximum(self._current - self._normal, 0.0)
        if up.all() and rise.max() < EXTERNAL_RATIO * rise.min():
            verdict = "internal_leakage"
        else:
            verdict = f"external_leakage_{int(np.argmax(rise)) + 1}"
        return Decision(verdict, self._onset, statistic=ratio, threshold=1.0, details=details)


def learn_thresholds(averages: Array, false_alarms_per_day: float) -> Array:
    """Return the thresholds (2,) in Pa that healthy moving averages exceed at the stated rate.

    The averages (n, 2) are positive and skewed: their logarithm is taken as normal. A window of 4000
    samples gives one independent look in 4 s, and each chamber has its own. With few independent
    looks behind the spread, the normal quantile is widened to Student's t's.
    """
    looks_per_day = 2.0 * 86400.0 / (THESIS_WINDOW * 1e-3)
    probability = min(false_alarms_per_day / looks_per_day, 0.25)
    logs = np.log(np.maximum(averages, 1e-9))
    independent = max(averages.shape[0] / THESIS_WINDOW, 2.0)
    freedom = independent - 1.0
    z = -NormalDist().inv_cdf(probability)
    scaled = z * (8.0 * freedom + 3.0) / (8.0 * freedom + 1.0)
    quantile = sqrt(freedom * (exp(min(scaled * scaled / freedom, 50.0)) - 1.0))
    spread = logs.std(axis=0) * sqrt(1.0 + 1.0 / independent)
    return np.asarray(np.exp(np.minimum(logs.mean(axis=0) + quantile * spread, log(1e9))))
