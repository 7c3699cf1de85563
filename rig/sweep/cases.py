"""Runs cases, a group of lanes at a time, and judges them: what a worker does."""

import os
import socket
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

import rig
from estimator.thesis import initial_state
from rig.compile_cache import source_key
from rig.configuration.sweep_plan import Sweep, SweepFilter
from rig.plant import NO_FAULT, Model, Parameters
from rig.plant.dynamics import rest_state
from rig.plant.lanes import LANES, aligned
from rig.plant.lanes.normal import start_streams
from rig.plant.sensors import SensorParameters

from .drawing import Cases, still_case
from .motions import AMPLITUDE, PHASE, SINE_ROWS, Motions
from .pattern_lanes import judged_by_pattern
from .ticks import BLOCK, SUMS, scale_sines, thesis7_cases

Array = NDArray[np.float64]
Figures = dict[str, NDArray[np.generic]]

AHEAD: Final = 2
"""Half seconds that plants run ahead of the thesis's filter (`python -m tools.bench_sweep`)."""
_LEAST_BLOCKS: Final = 40
"""Half seconds that both detectors need to come to a verdict."""


class SweepError(RuntimeError):
    """Cases that could not be run."""


@dataclass(frozen=True)
class Setting:
    """What all cases of a sweep share, as a worker needs it.

    Attributes:
        like: the rig that every case starts from.
        middle: where open loops begin, m.
        has_spool, has_supply: which of these the rig measures.
    """

    like: Parameters
    sensors: SensorParameters
    model: Model
    filter_name: SweepFilter
    false_alarms_per_day: float
    ticks: int
    gain: float
    limit: float
    longest_step_s: float
    middle: float
    has_spool: bool
    has_supply: bool

    @property
    def blocks(self) -> int:
        """Half seconds of a case."""
        return (self.ticks - 1) // BLOCK


@dataclass(frozen=True)
class Judged:
    """What came of some cases.

    Attributes:
        chunk: number of the chunk that they are.
        figures: by column of the table, (n,) each.
        process_s: processor seconds that it took.
        wall_s: seconds that it took.
        source: digest of the sources that it was computed by.
        worker: which process did it.
        start_s: seconds that this process took to load the compiled code, if it was its first.
    """

    chunk: int
    figures: Mapping[str, NDArray[np.generic]]
    process_s: float
    wall_s: float
    source: str
    worker: str
    start_s: float = 0.0


def setting_of(sweep: Sweep) -> Setting:
    """Return what all cases of a sweep share."""
    base = sweep.rig
    return Setting(
        like=base.plant.parameters,
        sensors=base.sensors,
        model=sweep.model,
        filter_name=sweep.filter_name,
        false_alarms_per_day=sweep.false_alarms_per_day,
        ticks=sweep.ticks,
        gain=base.gain_V_per_m,
        limit=base.limits.command_V,
        longest_step_s=sweep.longest_step_s,
        middle=0.5 * (base.limits.position_min_m + base.limits.position_max_m),
        has_spool=base.has_spool_sensor,
        has_supply=base.has_supply_pressure_sensor,
    )


@dataclass
class Group:
    """The cases of all lanes, in the arrays that compiled code takes.

    Args:
        setting: of the sweep.
        cases: of which lanes are taken.
        at: (LANES,) which of them.
    """

    setting: Setting
    cases: Cases
    at: NDArray[np.intp]
    motions: Motions = field(init=False)

    def __post_init__(self) -> None:
        cases, at = self.cases, self.at
        self.motions = cases.motions.of(at)
        scale_sines(self.motions.sines, self.motions.peak[None, :].copy(), self.setting.ticks)
        self.parameters = aligned(cases.parameters[:, at])
        self.faults = np.zeros((len(NO_FAULT), LANES))
        self.faults[: cases.coefficients.shape[0]] = cases.coefficients[:, at]
        self.onset = cases.onset_tick[at][None, :].copy()
        self.noise = cases.noise[at][None, :].copy()
        self.open_loop = self.motions.open_loop[None, :].copy()
        rigs = [Parameters(*map(float, column)) for column in self.parameters.T]
        at_rest = [rest_state(rig, x) for rig, x in zip(rigs, self._starts(), strict=True)]
        self.plant = aligned(np.transpose(at_rest))

    def _starts(self) -> Array:
        """Return where each ram rests at first: where its setpoint begins, m."""
        sines = self.motions.sines.reshape(-1, SINE_ROWS, LANES)
        waves = sines[:, AMPLITUDE] * np.sin(2.0 * np.pi * sines[:, PHASE])
        begins = self.motions.levels[0] + waves.sum(axis=0)
        return np.where(self.motions.open_loop != 0.0, self.setting.middle, begins)

    def stream(self, row: int) -> NDArray[np.uint64]:
        """Return the start of a stream of noise, of which `Cases.seeds` has a row."""
        return start_streams([int(seed) for seed in self.cases.seeds[row, self.at]])

    @property
    def names(self) -> str:
        """Which cases these are, for messages."""
        return f"cases {', '.join(map(str, np.unique(self.cases.numbers[self.at])))}"


def groups_of(cases: Cases) -> Iterator[NDArray[np.intp]]:
    """Yield the lanes' cases (LANES,), each case in one group; the last is filled with its last."""
    numbers = np.arange(cases.count)
    for first in range(0, cases.count, LANES):
        yield np.minimum(numbers[first] + np.arange(LANES), cases.count - 1)


def run_thesis7(group: Group) -> Array:
    """Run a group's cases with the seven-state filter of the thesis.

    Returns:
        float64 (blocks, 6, LANES), `rig.sweep.ticks.SUMS` of each block.

    Raises:
        SweepError: a rig needed more integration steps than there may be.
    """
    setting, motions = group.setting, group.motions
    x, covariance = initial_state(with_load=True)
    sums = aligned(np.zeros((setting.blocks, len(SUMS), LANES)))
    enough = thesis7_cases(
        setting.ticks, AHEAD, motions.sines, motions.levels, motions.ends, group.open_loop,
        setting.gain, setting.limit, setting.longest_step_s, group.plant, group.parameters,
        setting.like, setting.sensors, group.faults, group.onset, group.noise, group.stream(0),
        aligned(np.repeat(x[:, None], LANES, axis=1)),
        aligned(np.repeat(covariance[:, :, None], LANES, axis=2)),
        setting.model.parameters, sums,
    )  # fmt: skip
    if not enough:
        raise SweepError(f"{group.names}: a rig needed too many integration steps throughout")
    return sums


def judge_cases(setting: Setting, cases: Cases) -> Figures:
    """Run and judge cases; return what the table tells of each, (n,) by column.

    Raises:
        SweepError: a case could not be run.
    """
    found: list[Figures] = []
    for at in groups_of(cases):
        group = Group(setting, cases, at)
        if setting.filter_name == "thesis-7":
            figures = judged_by_pattern(run_thesis7(group), group, setting)
        else:
            from .product_lanes import judged_by_product

            figures = judged_by_product(group)
        found.append(figures)
    count = cases.count
    return {name: np.concatenate([each[name] for each in found])[:count] for name in found[0]}


def run_chunk(setting: Setting, cases: Cases) -> Judged:
    """Run and judge a chunk of cases on this process, and tell what it took."""
    start_s = _load(setting)
    wall, process = time.perf_counter(), time.thread_time()
    figures = judge_cases(setting, cases)
    took = time.thread_time() - process, time.perf_counter() - wall
    worker = f"{socket.gethostname()}:{os.getpid()}"
    return Judged(cases.chunk, figures, *took, sources(), worker, start_s)


@cache
def sources() -> str:
    """Return a digest of the sources that figures are computed by."""
    return source_key(Path(rig.__file__).parents[1])


_loaded: set[str] = set()


def _load(setting: Setting) -> float:
    """Load or compile what cases are run by, once in a process; return the seconds it took."""
    if setting.filter_name in _loaded:
        return 0.0
    start = time.perf_counter()
    short = replace(setting, ticks=_LEAST_BLOCKS * BLOCK + 1)
    judge_cases(short, still_case(setting))
    _loaded.add(setting.filter_name)
    return time.perf_counter() - start
