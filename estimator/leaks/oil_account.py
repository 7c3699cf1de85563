"""The oil account together with its test, which supplies the null bias for the next block."""

from collections.abc import Iterator
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import FROZEN_SAMPLES, AccountBlock, FlowAccount
from estimator.filters import FilterRun
from rig.plant import Parameters

from .leak_statistic import LeakTest

Array = NDArray[np.float64]

_MOST_DEPARTURE: Final = 2e-5
"""Greatest departure of a spool's reading from its estimate that counts, m: ten times the 2 um by
which the filter expects the valve's model to be off. One beyond is no reading of this spool, such
as one at the end of the transducer's range, which the filter passes over."""
_ESTIMATES: Final = ("spool_m", "pressure_1_Pa", "pressure_2_Pa", "position_m")


class Samples(NamedTuple):
    """Successive samples of a detector: float64 (n,) each, SI; a value not measured is NaN."""

    time_s: Array
    command: Array
    position: Array
    pressure_1: Array
    pressure_2: Array
    spool: Array
    supply_pressure: Array


class OilAccount:
    """Keeps the account of both chambers and passes every finished block to a test.

    Which edges of the valve are open depends on the spool's null bias. It is taken from the test,
    which fits a constant to all blocks so far and knows its uncertainty; the filter's estimate
    would start from nothing and follow leaks. The result does not depend on how samples are
    batched, except that runs of equal readings are looked for in each batch alone.

    Args:
        parameters: the parameters of the rig that are assumed.
        test: the test that takes every block.

    Attributes:
        flow: the running block of the account.
    """

    def __init__(self, parameters: Parameters, test: LeakTest) -> None:
        self.test = test
        self.flow = FlowAccount(parameters)
        self._assumed_bias = parameters.spool_null_bias
        self._further_bias = test.null_bias()

    def add(self, samples: Samples, run: FilterRun) -> Iterator[AccountBlock]:
        """Add samples with the product filter's estimates of them; yield each block once tested.

        The samples are added while the blocks are iterated over. Incomplete blocks, which the test
        ignores, are yielded too.
        """
        fresh = np.isfinite(samples.position + samples.pressure_1 + samples.pressure_2)
        fresh &= _alive(samples.pressure_1) & _alive(samples.pressure_2)
        estimates = [run.state(name) for name in _ESTIMATES]
        departures = samples.spool - estimates[0]
        departures[np.abs(departures) > _MOST_DEPARTURE] = np.nan
        rows = np.array([run.time_s, *estimates, fresh, samples.supply_pressure, departures])
        first = 0
        while first < run.time_s.size:
            end = first + self.flow.samples_left
            part = np.ascontiguousarray(rows[:, first:end])
            for block in self.flow.add(part, self.null):
                self.take(block)
                yield block
            first = end

    @property
    def null(self) -> tuple[float, float]:
        """Return the null bias of the rig's spool and its standard deviation, m."""
        further_bias, spread = self._further_bias
        return self._assumed_bias + further_bias, spread

    def take(self, block: AccountBlock) -> None:
        """Pass a finished block to the test, and take the null bias for the next one from it."""
        self.test.add(block)
        self._further_bias = self.test.null_bias()


def _alive(values: Array) -> NDArray[np.bool_]:
    """Return for each value whether the transducer seems to measure: bool (n,).

    It does not in a run of `FROZEN_SAMPLES` or more equal values.
    """
    changed = values[1:] - values[:-1] != 0.0
    if changed.all():
        return np.ones(values.size, dtype=np.bool_)
    starts = np.flatnonzero(np.concatenate([[True], changed]))
    lengths = np.diff([*starts, values.size])
    return np.repeat(lengths < FROZEN_SAMPLES, lengths)
