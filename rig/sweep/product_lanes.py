"""Judges cases by the product filter and its detector in lanes (`estimator.leak_lanes`).

A detector without any evidence of a fault is not asked for its verdict: the verdict would name no
fault, and computing it takes longer than all the rest.
"""

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.filters import FILTERS, ProductLanes
from estimator.leak_lanes import CompiledDetector, LaneDetectors
from estimator.leaks import Decision
from rig.lanes import LANES, empty_lanes
from rig.loop import LANE_READINGS, LOGGED, MOST_STEPS
from rig.plant import TICK

from .group import Figures, Group, SweepError
from .ticks import BLOCK, reading_block

Array = NDArray[np.float64]

_LEAST_HEALTHY: Final = 1e-12
_STATES: Final = len(FILTERS["product"].states)


def judged_by_product(group: Group) -> Figures:
    """Run a group's cases with the product filter, judge them, and return the columns of results.

    These are the columns of `rig.sweep.table.FIGURES` that the product filter can fill, (LANES,)
    each.

    Raises:
        SweepError: a rig needed more integration steps than are allowed.
    """
    setting = group.setting
    detectors = LaneDetectors(setting.model, setting.false_alarms_per_day)
    decisions = [Decision("inconclusive")] * LANES
    verdicts: list[list[str]] = []
    ends_s: list[float] = []
    filters = ProductLanes(setting.model, setting.sensors)
    squares, flow = np.zeros(LANES), np.zeros((1, LANES))
    kept = group.room()
    wanted = [LANE_READINGS.index(name) for name in setting.kept]
    room = empty_lanes((BLOCK + 1) * _STATES).reshape((BLOCK + 1, _STATES, LANES))
    for time_s, readings in _blocks(group, flow):
        if wanted:
            first = round(time_s[0] / TICK)
            kept[first : first + time_s.size] = readings[:, wanted]
        # The filter's sums are reset with the last sample of a window, and are read before it.
        states = room[: time_s.size]
        filters.advance(readings[:-1], states[:-1])
        squares += filters.squares
        filters.advance(readings[-1:], states[-1:])
        ends_s.append(float(time_s[-1]))
        last = len(ends_s) == setting.blocks
        detectors.update(time_s, readings, states)
        decisions = [
            _decided(detector, held, last=last)
            for detector, held in zip(detectors.each, decisions, strict=True)
        ]
        verdicts.append([each.verdict for each in decisions])
    healthy = np.array([each.probabilities.get("healthy", np.nan) for each in decisions])
    bounded = np.clip(healthy, _LEAST_HEALTHY, 1.0 - _LEAST_HEALTHY)
    flows = [(each.leak_m3_per_s, *(each.interval_m3_per_s or (None, None))) for each in decisions]
    leak, low, high = np.array(flows, dtype=np.float64).T
    outcomes = group.outcome_columns(np.array(verdicts), np.array(ends_s))
    asked = group.asked_columns(kept, leak, outcomes["latency_s"].astype(np.float64))
    return (
        outcomes
        | asked
        | {
            "leak_true_m3_per_s": group.true_flow(flow[0]),
            "statistic": np.array([each.statistic for each in decisions]),
            "threshold": np.array([each.threshold for each in decisions]),
            # The log odds of any fault, ln((1 - p) / p) with p the probability of health, show how
            # likely one is even if the verdict names none.
            "score": np.nan_to_num(np.log1p(-bounded) - np.log(bounded), nan=-40.0),
            "probability_healthy": healthy,
            "leak_m3_per_s": leak,
            "leak_low_m3_per_s": low,
            "leak_high_m3_per_s": high,
            "nis": squares / setting.blocks,
            "resets": filters.resets,
            "lost": filters.resets > 0,
        }
    )


def _blocks(group: Group, flow: Array) -> Iterator[tuple[Array, Array]]:
    """Run the simulated plants and transducers of a group's cases block by block.

    Args:
        group: the group of the cases.
        flow: sum of each case's true leak flow at every tenth tick so far, m^3/s, (1, LANES);
            updated.

    Yields:
        The times of a block's ticks, s, (ticks,), and the readings at these ticks, as in
        `rig.loop.lane_ticks.LANE_READINGS`, (ticks, 6, LANES), in SI; NaN for a transducer that
        the rig does not have. The next block overwrites them.

    Raises:
        SweepError: a rig needed more integration steps than are allowed.
    """
    setting = group.setting
    steps = (BLOCK + 1) * MOST_STEPS
    log = empty_lanes(steps * LOGGED).reshape((steps, LOGGED, LANES))
    width = len(LANE_READINGS)
    room = empty_lanes((BLOCK + 1) * width).reshape((BLOCK + 1, width, LANES))
    for block in range(setting.blocks):
        first = 0 if block == 0 else block * BLOCK + 1
        ticks = np.arange(first, (block + 1) * BLOCK + 1, dtype=np.float64)
        readings = room[: ticks.size]
        enough = reading_block(
            first, group.rigs, group.lanes, setting.loop, setting.like, setting.sensors, log,
            readings, flow,
        )  # fmt: skip
        if not enough:
            raise SweepError(f"{group.names}: a rig needed too many integration steps throughout")
        for row, indicated, corrections in setting.corrections:
            readings[:, row] += np.interp(readings[:, row], indicated, corrections)
        if not setting.has_spool:
            readings[:, LANE_READINGS.index("spool_m")] = np.nan
        if not setting.has_supply:
            readings[:, LANE_READINGS.index("supply_pressure_Pa")] = np.nan
        yield ticks * TICK, readings


def _decided(detector: CompiledDetector, held: Decision, *, last: bool) -> Decision:
    """Return the decision of a case after a block that its detector has taken.

    The detector is only asked for a new decision if it sees a sign of a fault, if the decision
    before named a fault, or in the last block; else the decision before is returned.

    Args:
        detector: the detector; updated.
        held: the decision before this block.
        last: whether this is the last block, after which there is always a decision.
    """
    return detector.decide() if last or held.names_a_fault or detector.accuses else held
