"""Checks the constants of the alarm threshold by simulation of the leak test on artificial noise.

`python -m tools.studies.alarm_threshold --groups 2` draws up the oil accounts of rigs that are
exactly the model (with drawn motion, friction and load, half an hour each). The signatures of the
nuisances and faults are taken from these accounts; the missing flows are replaced by known noise.
It is normal, has the size of the sensors' noise, is independent from block to block, and is
correlated by -0.9 between the chambers, as spool and encoder make it. For several limits, the
program counts how often the test's statistic, for an exact model, exceeds the limit, and compares
the counts and their exact 95 % intervals with

    rate = DIRECTIONS * crossing_rate(limit),   statistic > t(limit) - LEFT_OUT

(`estimator.accounts.crossings`). After a crossing, the next one counts only if the statistic was
below the limit for 8 s.
"""

import argparse
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table

from estimator.accounts.crossings import crossing_rate, student_quantile
from estimator.accounts.flow import BLOCK_S
from estimator.accounts.noise import sensor_noise
from estimator.filters.registry import FilterRun
from estimator.leaks.fault_scores import WITNESSES
from estimator.leaks.leak_statistic import DIRECTIONS, LEFT_OUT, MINIMUM_BLOCKS, LeakTest
from estimator.leaks.oil_account import OilAccount, Samples
from rig.lanes import LANES
from rig.plant import Model

from .healthy_hours import RUN_S, Setting, poisson_interval, run_group

Array = NDArray[np.float64]

LIMITS: Final = (3.3, 3.55, 3.8, 4.05, 4.3)
_LOWEST: Final = 2.0
"""The threshold that the test uses here; it is below all limits that are studied."""


class _Highest(LeakTest):
    """A leak test whose highest statistic can be read after every block."""

    def threshold(self, freedom: float, part: float = 1.0) -> float:
        """Return `_LOWEST`, which is below all limits that are studied."""
        return _LOWEST

    def highest(self) -> float:
        """Return the statistic of the likeliest fault; -inf if there is no candidate yet."""
        found = self.best() if self.blocks >= MINIMUM_BLOCKS else None
        return -np.inf if found is None else found.statistic


class _NoiseWatcher:
    """Tests the oil accounts of one rig, in which drawn noise replaces the missing flows.

    Attributes:
        verdicts: stays empty; `run_group` expects the attribute.
        statistics: the highest statistic after each block.
    """

    def __init__(self, seed: int) -> None:
        self.verdicts: Counter[str] = Counter()
        self._account = OilAccount(Model().parameters, LeakTest(1.0, model_error=0.0))
        self._test = _Highest(1.0, model_error=0.0)
        self._noise = np.random.default_rng((seed, 2))
        self.statistics: list[float] = []

    def take(self, samples: Samples, run: FilterRun, motion: str) -> None:
        """Draw up the accounts of the next samples, and add their highest statistics."""
        for block in self._account.add(samples, run):
            missing = np.linalg.cholesky(sensor_noise(block)) @ self._noise.standard_normal(2)
            self._test.add(replace(block, missing=missing, doubts=np.zeros(2)))
            self.statistics.append(self._test.highest())


def crossings(statistics: Sequence[Array], limit: float) -> int:
    """Return how often the statistics of runs exceed `limit` without having done so for 8 s.

    Each array of `statistics` has a run's highest statistic by block; the first time that a run
    exceeds the limit counts in any case.
    """
    count = 0
    for series in statistics:
        above = np.flatnonzero(series > limit)
        count += int((np.diff(above, prepend=-MINIMUM_BLOCKS) >= MINIMUM_BLOCKS).sum())
    return count


def expected(limit: float, blocks: int, run_blocks: int) -> float:
    """Return the number of crossings that the constants in use predict.

    Args:
        limit: the limit, in standard deviations of a normal variable.
        blocks: number of blocks of all runs together.
        run_blocks: number of blocks of one run.
    """
    return DIRECTIONS * crossing_rate(limit, WITNESSES, run_blocks) * blocks


def main() -> None:
    """Run the simulation and print, for each limit, the crossings found and those expected."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--groups", type=int, default=1, help=f"of {LANES} rigs (default 1)")
    parser.add_argument("--seconds", type=float, default=RUN_S, help="of each (default 1800)")
    options = parser.parse_args()
    statistics = []
    for number in range(options.groups):
        watchers = [_NoiseWatcher(number * LANES + lane) for lane in range(LANES)]
        run_group(number, Setting(1.0, 0.0, known=True), options.seconds, watchers)
        statistics += [np.array(watcher.statistics) for watcher in watchers]
    run_blocks = max(series.size for series in statistics)
    blocks = sum(series.size for series in statistics)
    table = Table("limit", "a day", "statistic above", "expected", "found", "DIRECTIONS it tells")
    for limit in LIMITS:
        bound = student_quantile(NormalDist().cdf(-limit), 2.0 * run_blocks) - LEFT_OUT
        found, mean = crossings(statistics, bound), expected(limit, blocks, run_blocks)
        low, high = (each / mean * DIRECTIONS for each in poisson_interval(found))
        per_day = mean / (blocks * BLOCK_S) * 86400.0
        table.add_row(f"{limit:.2f}", f"{per_day:.0f}", f"{bound:.2f}", f"{mean:.1f}", str(found),
                      f"{low:.1f} to {high:.1f}")  # fmt: skip
    Console().print(f"{blocks * BLOCK_S / 3600.0:.1f} h of accounts", table)


if __name__ == "__main__":
    main()
