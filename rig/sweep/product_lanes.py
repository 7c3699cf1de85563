"""Judges cases by the product filter in lanes, and by a detector for each lane.

A detector without any evidence of a fault is not asked for its verdict: the verdict would name no
fault, and computing it takes longer than all the rest.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.filters import FILTERS, OUTPUTS, FilterRun, ProductLanes
from estimator.leaks import Decision, OilAccountDetector, Samples
from rig.lanes import LANES, empty_lanes
from rig.loop import LANE_READINGS, LOGGED, MOST_STEPS
from rig.plant import TICK

from .case_figures import outcome_columns, true_flow
from .group import Group
from .setting import Figures, SweepError
from .ticks import BLOCK, reading_block

Array = NDArray[np.float64]

_SPOOL: Final = LANE_READINGS.index("spool_m")
_SUPPLY: Final = LANE_READINGS.index("supply_pressure_Pa")
_LEAST_HEALTHY: Final = 1e-12


def judged_by_product(group: Group) -> Figures:
    """Run a group's cases, and return the columns of `rig.sweep.table.FIGURES`, (LANES,) each.

    Raises:
        SweepError: a rig needed more integration steps than are allowed.
    """
    setting = group.setting
    watch = _Watch(group)
    bench = _Bench(group)
    filters = ProductLanes(setting.model, setting.sensors)
    squares = np.zeros(LANES)
    for block in range(setting.blocks):
        first = 0 if block == 0 else block * BLOCK + 1
        readings = bench.readings(first, (block + 1) * BLOCK + 1 - first)
        # The filter's sums are reset with the last sample of a window, and are read before it.
        before = filters.advance(readings[:-1])
        squares += filters.squares
        states = np.concatenate([before, filters.advance(readings[-1:])])
        watch.take(first, readings, states)
    return watch.figures() | {
        "nis": squares / setting.blocks,
        "leak_true_m3_per_s": true_flow(bench.flow[0], group),
        "resets": filters.resets,
        "lost": filters.resets > 0,
    }


class _Bench:
    """The simulated plants and transducers of a group's cases, run block by block.

    Attributes:
        flow: sum of each case's true leak flow at every tenth tick so far, m^3/s, (1, LANES).
    """

    def __init__(self, group: Group) -> None:
        self._group = group
        steps = (BLOCK + 1) * MOST_STEPS
        self._log = empty_lanes(steps * LOGGED).reshape((steps, LOGGED, LANES))
        self.flow = np.zeros((1, LANES))

    def readings(self, first: int, ticks: int) -> Array:
        """Run the plants for some ticks from tick `first` on, and return the readings.

        The readings are `rig.loop.lane_ticks.LANE_READINGS`, (ticks, 6, LANES), in SI; NaN for a
        transducer that the rig does not have.

        Raises:
            SweepError: a rig needed more integration steps than are allowed.
        """
        group, setting = self._group, self._group.setting
        readings = np.empty((ticks, len(LANE_READINGS), LANES))
        enough = reading_block(
            first, group.rigs, group.lanes, setting.loop, setting.like, setting.sensors, self._log,
            readings, self.flow,
        )  # fmt: skip
        if not enough:
            raise SweepError(f"{group.names}: a rig needed too many integration steps throughout")
        if not setting.has_spool:
            readings[:, _SPOOL] = np.nan
        if not setting.has_supply:
            readings[:, _SUPPLY] = np.nan
        return readings


class _Watch:
    """The detectors of a group's cases, with their verdicts after each block."""

    def __init__(self, group: Group) -> None:
        self._group = group
        setting = group.setting
        self._last = setting.ticks - 1
        self._detectors = [
            OilAccountDetector(setting.model, setting.false_alarms_per_day) for _ in range(LANES)
        ]
        self._held: list[list[str]] = []
        self._ends_s: list[float] = []
        self._decisions = [Decision("inconclusive")] * LANES
        self._absolute = np.zeros((2, LANES))
        self._ticks = 0

    def take(self, first: int, readings: Array, states: Array) -> None:
        """Let the detectors judge a block.

        Args:
            first: number of the block's first tick.
            readings: `rig.loop.lane_ticks.LANE_READINGS`, (ticks, 6, LANES).
            states: the filters' estimates, (ticks, 11, LANES).
        """
        ticks = readings.shape[0]
        time_s = np.arange(first, first + ticks, dtype=np.float64) * TICK
        self._ends_s.append(float(time_s[-1]))
        self._held.append([
            self._judge(lane, time_s, readings, states, last=first + ticks > self._last)
            for lane in range(LANES)
        ])  # fmt: skip

    def _judge(
        self, lane: int, time_s: Array, readings: Array, states: Array, *, last: bool
    ) -> str:
        position, p1, p2, spool, supply, command = np.ascontiguousarray(readings[:, :, lane].T)
        outputs = np.full((time_s.size, len(OUTPUTS)), np.nan)
        estimates = np.ascontiguousarray(states[:, :, lane])
        run = FilterRun(FILTERS["product"], time_s, estimates, outputs, np.empty((0, 0)))
        detector = self._detectors[lane]
        detector.update(Samples(time_s, command, position, p1, p2, spool, supply), run)
        held = self._decisions[lane].verdict not in ("healthy", "inconclusive")
        if held or last or detector.accuses:
            self._decisions[lane] = detector.decide()
        return self._decisions[lane].verdict

    def figures(self) -> Figures:
        """Return the columns of the table that follow from the detectors, (LANES,) each."""
        decisions = self._decisions
        healthy = np.array([each.probabilities.get("healthy", np.nan) for each in decisions])
        leak = np.array([_or_nan(each.leak_m3_per_s) for each in decisions])
        ends = [each.interval_m3_per_s or (np.nan, np.nan) for each in decisions]
        nothing = np.full(LANES, np.nan)
        return outcome_columns(self._group, np.array(self._held), np.array(self._ends_s)) | {
            "statistic": np.array([each.statistic for each in decisions]),
            "threshold": np.array([each.threshold for each in decisions]),
            # The log odds of any fault show how likely one is even if the verdict names none.
            "score": np.nan_to_num(_log_odds(healthy), nan=-40.0),
            "probability_healthy": healthy,
            "leak_m3_per_s": leak,
            "leak_low_m3_per_s": np.array([low for low, _ in ends]),
            "leak_high_m3_per_s": np.array([high for _, high in ends]),
            "innovation_1_Pa": nothing,
            "innovation_2_Pa": nothing,
            "nis_position": nothing,
            "nis_pressure_1": nothing,
            "nis_pressure_2": nothing,
        }


def _or_nan(value: float | None) -> float:
    return float("nan") if value is None else value


def _log_odds(healthy: Array) -> Array:
    """Return the log odds of a fault, ln((1 - p) / p), with p the probability of health."""
    bounded = np.clip(healthy, _LEAST_HEALTHY, 1.0 - _LEAST_HEALTHY)
    return np.asarray(np.log1p(-bounded) - np.log(bounded))
