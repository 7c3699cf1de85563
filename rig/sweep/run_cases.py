"""Runs and judges cases on a worker, one group of lanes after another."""

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
from estimator.filters import initial_state
from rig.compile_cache import source_key
from rig.lanes import LANES, aligned

from .drawing import Cases, still_case
from .group import Group, groups_of
from .pattern_lanes import judged_by_pattern
from .setting import Figures, Setting, SweepError
from .ticks import BLOCK, SUMS, Thesis7Lanes, thesis7_cases

Array = NDArray[np.float64]

AHEAD: Final = 2
"""Number of blocks by which plants run ahead of the thesis's filter. This choice was the fastest in
`python -m tools.bench.sweep`."""
_LEAST_BLOCKS: Final = 40
"""Number of blocks after which both detectors have come to a verdict."""


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
        start_s: time that this process took before to load the compiled code, s; 0 if it was
            loaded already.
    """

    chunk: int
    figures: Mapping[str, NDArray[np.generic]]
    process_s: float
    wall_s: float
    source: str
    worker: str
    start_s: float = 0.0


def run_thesis7(group: Group) -> Array:
    """Run a group's cases with the seven-state filter of the thesis, and return its sums.

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
    enough = thesis7_cases(
        AHEAD, group.rigs, group.lanes, filters, setting.loop, setting.like, setting.sensors,
        setting.model.parameters,
    )  # fmt: skip
    if not enough:
        raise SweepError(f"{group.names}: a rig needed too many integration steps throughout")
    return filters.sums


def judge_cases(setting: Setting, cases: Cases) -> Figures:
    """Run and judge cases, and return the columns of `rig.sweep.table.FIGURES`, (n,) each.

    Raises:
        SweepError: a case could not be run.
    """
    found: list[Figures] = []
    for at in groups_of(cases):
        group = Group(setting, cases, at)
        if setting.filter_name == "thesis-7":
            figures = judged_by_pattern(run_thesis7(group), group)
        else:
            from .product_lanes import judged_by_product

            figures = judged_by_product(group)
        found.append(figures)
    count = cases.count
    return {name: np.concatenate([each[name] for each in found])[:count] for name in found[0]}


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
    short = replace(setting, ticks=_LEAST_BLOCKS * BLOCK + 1)
    judge_cases(short, still_case(setting, cases))
    _loaded.add(setting.filter_name)
    return time.perf_counter() - start
