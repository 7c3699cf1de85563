"""Judges cases by the thesis's pattern of moving averages, from sums over blocks of half a second.

The decisions are those of `estimator.leaks.pattern.PatternDetector` after each block, at which its
moving average of 4000 samples is the mean of eight blocks.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.filters import THESIS_WINDOW
from estimator.leaks import LEARNING_S, PATTERNS, STARTED_S, HealthyLevel, pattern_of

from .group import Group
from .setting import Figures
from .ticks import BLOCK, SUMS

Array = NDArray[np.float64]

_STARTED: Final = round(STARTED_S * 1000.0) // BLOCK
"""Number of blocks at the beginning that are left out, because the filter settles in them."""
_LEARNT: Final = round(LEARNING_S * 1000.0) // BLOCK
"""Number of blocks after which the thresholds are learnt."""
_WINDOW: Final = THESIS_WINDOW // BLOCK
DIVERGED_PA: Final = 1e6
"""Moving average of |innovation| above which a filter is lost, Pa: a tenth of a chamber's pressure;
the thesis's largest healthy average is 0.2 MPa."""


def judged_by_pattern(sums: Array, group: Group) -> Figures:
    """Return the columns of `rig.sweep.table.FIGURES` for a group's cases, (LANES,) each.

    Args:
        sums: `rig.sweep.ticks.SUMS` of each block, float64 (blocks, 6, LANES).
        group: the group of the cases.
    """
    means = sums[:, 0:2] / BLOCK
    healthy = means[_STARTED:_LEARNT]
    looks = healthy.shape[0]
    with np.errstate(all="ignore"):  # a lost filter's numbers may overflow
        level = HealthyLevel(healthy.mean(axis=0), healthy.std(axis=0, ddof=1), looks)
        baseline = level.baseline(group.setting.false_alarms_per_day)
        # The mean of the last `_WINDOW` blocks at the end of each block after learning.
        windows = np.lib.stride_tricks.sliding_window_view(means, _WINDOW, axis=0)
        averages = windows[_LEARNT - _WINDOW + 1 :].mean(axis=-1)
        patterns = pattern_of(averages, baseline)
        excess = (averages - baseline.normal) / (baseline.thresholds - baseline.normal)
        # The score is that of the block in which the moving averages show a fault most clearly.
        score = np.fmax.reduce(excess.max(axis=1), axis=0)
        ratio = (averages[-1] / baseline.thresholds).max(axis=0)
        squares = sums[_STARTED:, 2:5].mean(axis=0) / BLOCK
        lost = ~np.isfinite(sums).all(axis=(0, 1)) | (averages.max(axis=(0, 1)) > DIVERGED_PA)
    ends_s = np.arange(_LEARNT + 1, means.shape[0] + 1, dtype=np.float64) * (BLOCK * 1e-3)
    verdicts = np.array(PATTERNS)[patterns]
    return group.outcome_columns(verdicts, ends_s) | {
        "leak_true_m3_per_s": group.true_flow(sums[:, SUMS.index("leak_flow")].sum(axis=0)),
        "statistic": ratio,
        "threshold": np.ones(score.shape),
        "score": np.nan_to_num(score, nan=0.0, posinf=1e9),
        "innovation_1_Pa": means[_STARTED:, 0].mean(axis=0),
        "innovation_2_Pa": means[_STARTED:, 1].mean(axis=0),
        "nis": squares.mean(axis=0),
        "nis_position": squares[0],
        "nis_pressure_1": squares[1],
        "nis_pressure_2": squares[2],
        "resets": np.zeros(score.shape, dtype=np.int64),
        "lost": lost,
    }
