"""Runs and judges cases on a worker, one group of lanes after another.

Cases with the thesis's filter are judged by the thesis's pattern of moving averages, from sums over
blocks of half a second. The decisions are those that `estimator.leaks.pattern.PatternDetector`
makes after each block: there its moving average of 4000 samples is the mean of the last eight
blocks.
"""

import os
import socket
import time
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

import rig
from estimator.filters import THESIS_WINDOW, initial_state
from estimator.leaks import LEARNING_S, PATTERNS, STARTED_S, HealthyLevel, pattern_of
from rig.compile_cache import source_key
from rig.lanes import LANES, aligned
from rig.loop import LANE_READINGS
from rig.plant import LEAKS

from .asked import Asked
from .drawing import Cases
from .group import Figures, Group, Setting, SweepError, groups_of
from .motions import Motions
from .ticks import BLOCK, SUMS, Thesis7Lanes, thesis7_cases, thesis7_readings

Array = NDArray[np.float64]

AHEAD: Final = 2
"""Number of blocks by which plants run ahead of the thesis's filter. This choice was the fastest in
`python -m tools.bench.sweep`."""
_LEAST_BLOCKS: Final = 40
"""Number of blocks after which both detectors have come to a verdict."""
_STARTED: Final = round(STARTED_S * 1000.0) // BLOCK
"""Number of blocks at the beginning that are left out, because the filter settles in them."""
_LEARNT: Final = round(LEARNING_S * 1000.0) // BLOCK
"""Number of blocks after which the thresholds are learnt."""
_WINDOW: Final = THESIS_WINDOW // BLOCK
DIVERGED_PA: Final = 1e6
"""Moving average of |innovation| above which a filter is lost, Pa: a tenth of a chamber's pressure;
the thesis's largest healthy average is 0.2 MPa."""


@dataclass(frozen=True)
class Judged:
    """The results of a chunk of cases, and what computing them took.

    Attributes:
        chunk: number of the chunk.
        figures: columns of the table by their names, (n,) each.
        process_s: processor time that the cases took, s.
        wall_s: wall-clock time that the cases took, s.
        source: hash of the program's sources in the worker.
        worker: name of the process that ran the cases.
        start_s: time that this process took to load the compiled code before it ran the cases, s;
            0 if the code was loaded already.
    """

    chunk: int
    figures: Mapping[str, NDArray[np.generic]]
    process_s: float
    wall_s: float
    source: str
    worker: str
    start_s: float = 0.0


def run_thesis7(group: Group, kept: Array | None = None) -> Array:
    """Run a group's cases with the seven-state filter of the thesis, and return its sums.

    Args:
        group: the group.
        kept: is filled with the readings that the sweep keeps, SI, float64 (ticks,
            `Setting.kept`, LANES); None if they are not wanted.

    Returns:
        `rig.sweep.ticks.SUMS` of each block, float64 (blocks, 6, LANES).

    Raises:
        SweepError: a rig needed more integration steps than are allowed.
    """
    setting = group.setting
    x, covariance = initial_state(with_load=True)
    filters = Thesis7Lanes(
        aligned(np.repeat(x[:, None], LANES, axis=1)),
        aligned(np.repeat(covariance[:, :, None], LANES, axis=2)),
        np.zeros((1, LANES)),
        aligned(np.zeros((setting.blocks, len(SUMS), LANES))),
    )
    given = (
        AHEAD, group.rigs, group.lanes, filters, setting.loop, setting.like, setting.sensors,
        setting.model.parameters,
    )  # fmt: skip
    if kept is None or not kept.size:
        enough = thesis7_cases(*given)
    else:
        wanted = np.array([LANE_READINGS.index(name) for name in setting.kept], np.int64)
        enough = thesis7_readings(*given, wanted, kept)
    if not enough:
        raise SweepError(f"{group.names}: a rig needed too many integration steps throughout")
    return filters.sums


def judge_cases(setting: Setting, cases: Cases) -> Figures:
    """Run and judge cases with the sweep's filter, and return the columns of results, (n,) each.

    These are the columns of `rig.sweep.table.FIGURES` that the filter can fill.

    Raises:
        SweepError: a case could not be run.
    """
    found = [_judged_by_filter(Group(setting, cases, at)) for at in groups_of(cases)]
    count = cases.numbers.size
    return {name: np.concatenate([each[name] for each in found])[:count] for name in found[0]}


def _judged_by_filter(group: Group) -> Figures:
    if group.setting.filter_name == "thesis-7":
        kept = group.room()
        figures = judged_by_pattern(run_thesis7(group, kept), group)
        not_told = np.full(LANES, np.nan)
        latency_s = figures["latency_s"].astype(np.float64)
        return figures | group.asked_columns(kept, not_told, latency_s)
    from .product_lanes import judged_by_product

    return judged_by_product(group)


def run_chunk(setting: Setting, cases: Cases) -> Judged:
    """Run and judge a chunk of cases in this process; return the results and the times it took.

    Raises:
        SweepError: a case could not be run.
    """
    start_s = _load(setting, cases)
    wall, process = time.perf_counter(), time.thread_time()
    figures = judge_cases(setting, cases)
    took = time.thread_time() - process, time.perf_counter() - wall
    worker = f"{socket.gethostname()}:{os.getpid()}"
    return Judged(cases.chunk, figures, *took, sources(), worker, start_s)


@cache
def sources() -> str:
    """Return a hash of the program's sources, which is equal for equal versions."""
    return source_key(Path(rig.__file__).parents[1])


_loaded: set[str] = set()


def _load(setting: Setting, cases: Cases) -> float:
    """Load or compile the code that runs cases, and return how long that took, s.

    If this process has done so for the same filter before, nothing is done and 0 is returned.
    """
    if setting.filter_name in _loaded:
        return 0.0
    start = time.perf_counter()
    nothing = (Asked(),) * len(setting.asked)
    short = replace(setting, ticks=_LEAST_BLOCKS * BLOCK + 1, asked=nothing)
    judge_cases(short, _still_case(setting, cases))
    if setting.filter_name == "product":
        from estimator.leak_lanes import load_compiled

        load_compiled()
    _loaded.add(setting.filter_name)
    return time.perf_counter() - start


def judged_by_pattern(sums: Array, group: Group) -> Figures:
    """Judge cases by the thesis's pattern of averages, and return the columns of results.

    These are the columns of `rig.sweep.table.FIGURES` that the thesis's filter can fill, (LANES,)
    each.

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


def _still_case(setting: Setting, cases: Cases) -> Cases:
    """Return one case without a leak and at rest; running it loads the compiled code for cases.

    Args:
        setting: what all cases of the sweep share.
        cases: some cases of the sweep; all that needs no other value is taken from the first.
    """
    none, zero = np.full(1, np.nan), np.zeros(1)
    level, endless = np.full((1, 1), setting.middle), np.full((1, 1), np.inf)
    flat = np.array([[0.0], [1.0], [0.0], [0.0]])
    # A motion with the tracking law, if the sweep has one, loads the code that prepares it too.
    kinds = range(len(setting.controls))
    tracked = [kind for kind in kinds if not setting.controls[kind].settings.is_proportional]
    kind = np.array([tracked[0] if tracked else 0])
    return replace(
        cases.of(np.zeros(1, dtype=np.intp), 0),
        parameters=np.array(setting.like, dtype=np.float64)[:, None],
        coefficients=np.zeros((len(LEAKS), 1)),
        motions=Motions(np.zeros((0, 1)), none, flat, level, endless, zero, kind, zero, none),
    )
