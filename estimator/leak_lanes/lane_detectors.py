"""Detectors of the cases in lanes, which take the half seconds of all cases in common."""

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import LaneAccounts
from estimator.filters import FILTERS, OUTPUTS, FilterRun
from estimator.leaks import Samples
from rig.lanes import LANES
from rig.plant import Model

from .compiled_tests import CompiledDetector

Array = NDArray[np.float64]


class LaneDetectors:
    """One detector by oil accounts for each lane, all of the same model.

    Args:
        model: the model that the filters assume.
        false_alarms_per_day: alarms a healthy rig may raise in a day of running.

    Raises:
        ValueError: the rate is not above 0 and at most 10000.

    Attributes:
        each: the detector of each lane.
    """

    def __init__(self, model: Model, false_alarms_per_day: float) -> None:
        self.each = [
            CompiledDetector(model, false_alarms_per_day, returning=False) for _ in range(LANES)
        ]
        accounts = [detector.account.flow for detector in self.each]
        self._accounts = LaneAccounts(model.parameters, accounts)

    def update(self, time_s: Array, readings: Array, states: Array) -> None:
        """Give each detector the next half second of its rig.

        Args:
            time_s: time of each sample, s, (ticks,). The first call has one sample more than half a
                second.
            readings: float64 (ticks, 6, LANES), SI: position, pressures 1 and 2, spool, supply
                pressure and command of each sample; NaN for what is not measured.
            states: float64 (ticks, 11, LANES), the product filter's estimates after each sample.
        """
        nulls = np.array([detector.account.null for detector in self.each]).T
        blocks = self._accounts.add(float(time_s[-1]), readings, states, nulls)
        for lane, (detector, block) in enumerate(zip(self.each, blocks, strict=True)):
            if block is not None:
                detector.take(block, time_s, readings[:, 0, lane])
                continue
            samples, run = samples_of_lane(time_s, readings, states, lane)
            detector.update(samples, run)
            self._accounts.joined_by(lane)


def samples_of_lane(
    time_s: Array, readings: Array, states: Array, lane: int
) -> tuple[Samples, FilterRun]:
    """Return the samples and the filter's estimates of one lane; arguments as in `update`."""
    position, p1, p2, spool, supply, command = np.ascontiguousarray(readings[:, :, lane].T)
    samples = Samples(time_s, command, position, p1, p2, spool, supply)
    estimates = np.ascontiguousarray(states[:, :, lane])
    outputs = np.full((len(states), len(OUTPUTS)), np.nan)
    return samples, FilterRun(FILTERS["product"], time_s, estimates, outputs, np.empty((0, 0)))
