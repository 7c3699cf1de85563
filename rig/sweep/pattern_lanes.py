"""Judges cases by the thesis's pattern of moving averages, from sums over half seconds.

It comes to the decisions that `estimator.leaks.pattern.PatternDetector` comes to after each half
second: its moving average of 4000 samples is there the mean of eight blocks.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.filters import THESIS_WINDOW
from estimator.leaks import LEARNING_S, PATTERNS, STARTED_S, HealthyLevel, pattern_of

from .case_figures import outcome_columns, true_flow
from .group import Group
from .setting import Figures, Setting
from .ticks import BLOCK, SUMS

Array = NDArray[np.float64]

_STARTED: Final = round(STARTED_S * 1000.0) // BLOCK
"""Blocks that are left out: the filter's start."""
_LEARNT: Final = round(LEARNING_S * 1000.0) // BLOCK
"""Blocks after which thresholds are learnt."""
_WINDOW: Final = THESIS_WINDOW // BLOCK
DIVERGED_PA: Final = 1e6
"""A moving average of |innovation| beyond which the filter follows its rig no more: it is a tenth
of what a chamber holds, and the thesis's largest healthy one is 0.2 MPa."""


def judged_by_pattern(sums: Array, group: Group, setting: Setting) -> Figures:
    """Return what the table shows of a group's cases, (LANES,) by column.

    Args:
        sums: float64 (blocks, 6, LANES), `rig.sweep.ticks.SUMS`.
        group: whose cases they are.
        setting: of the sweep.
    """
    means = sums[:, 0:2] / BLOCK
    healthy = means[_STARTED:_LEARNT]
    looks = healthy.shape[0]
    with np.errstate(all="ignore"):  # of a filter that ran away
        level = HealthyLevel(healthy.mean(axis=0), healthy.std(axis=0, ddof=1), looks)
        baseline = level.baseline(setting.false_alarms_per_day)
        averages = _moving(means)
        patterns = pattern_of(averages, baseline)
        excess = (averages - baseline.normal) / (baseline.thresholds - baseline.normal)
        # The moving averages are looked at anew each half second, the clearest counts.
        score = np.fmax.reduce(excess.max(axis=1), axis=0)
        ratio = (averages[-1] / baseline.thresholds).max(axis=0)
        squares = sums[_STARTED:, 2:5].mean(axis=0) / BLOCK
        lost = ~np.isfinite(sums).all(axis=(0, 1)) | (averages.max(axis=(0, 1)) > DIVERGED_PA)
    ends_s = np.arange(_LEARNT + 1, means.shape[0] + 1, dtype=np.float64) * (BLOCK * 1e-3)
    verdicts = np.array(PATTERNS)[patterns]
    columns = outcome_columns(group, verdicts, ends_s)
    nothing = np.full(score.shape, np.nan)
    return columns | {
        "leak_true_m3_per_s": true_flow(sums[:, SUMS.index("leak_flow")].sum(axis=0), group),
        "statistic": ratio,
        "threshold": np.ones(score.shape),
        "score": np.nan_to_num(score, nan=0.0, posinf=1e9),
        "probability_healthy": nothing,
        "leak_m3_per_s": nothing,
        "leak_low_m3_per_s": nothing,
        "leak_high_m3_per_s": nothing,
        "innovation_1_Pa": means[_STARTED:, 0].mean(axis=0),
        "innovation_2_Pa": means[_STARTED:, 1].mean(axis=0),
        "nis": squares.mean(axis=0),
        "nis_position": squares[0],
        "nis_pressure_1": squares[1],
        "nis_pressure_2": squares[2],
        "resets": np.zeros(score.shape, dtype=np.int64),
        "lost": lost,
    }


def _moving(means: Array) -> Array:
    """Return means of `_WINDOW` blocks at the end of each block from the one after learning on."""
    windows = np.lib.stride_tricks.sliding_window_view(means, _WINDOW, axis=0)
    return np.asarray(windows[_LEARNT - _WINDOW + 1 :].mean(axis=-1))
