"""The constants of the alarm threshold, by simulation of the leak test on made-up noise.

`python -m tools.studies.alarm_threshold --groups 2` takes the nuisances' and faults' signatures
from oil accounts of rigs that are the model (drawn motion, friction and load, half an hour each),
and draws their missing flows as noise that is known: normal, of the sensors' size, independent from
block to block, correlated by -0.9 between the chambers as spool and encoder make it. What the
test's statistic, for an exact model, does there is compared with

    rate = DIRECTIONS * crossing_rate(limit),   statistic > t(limit) - LEFT_OUT

(`estimator.accounts.crossings`), limit by limit, with the counts' exact 95 % intervals. A
crossing counts once until the statistic has stayed below the limit for 8 s.
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
from estimator.leaks.detection import Samples, draw_up
from estimator.leaks.fault_scores import WITNESSES
from estimator.leaks.leak_statistic import DIRECTIONS, LEFT_OUT, MINIMUM_BLOCKS, LeakTest
from estimator.leaks.oil_account import OilAccount
from rig.lanes import LANES
from rig.plant import Model

from .healthy_hours import RUN_S, Setting, poisson_interval, run_group

Array = NDArray[np.float64]

LIMITS: Final = (3.3, 3.55, 3.8, 4.05, 4.3)
_LOWEST: Final = 2.0
"""Statistics below it are not looked at closely."""


class _Highest(LeakTest):
    """Tells its highest statistic, as of every block."""

    def threshold(self, freedom: float) -> float:
        """Return a limit that is low enough for all that matters."""
        return _LOWEST

    def highest(self) -> float:
        """Return the statistic of the likeliest fault; -inf where none is likely."""
        found = self.best() if self.blocks >= MINIMUM_BLOCKS else None
        return -np.inf if found is None else found.statistic


class _NoiseWatcher:
    """Tests the accounts of a rig with noise in the place of what is missing from them."""

    def __init__(self, seed: int) -> None:
        self.verdicts: Counter[str] = Counter()
        self._account = OilAccount(Model().parameters, LeakTest(1.0, model_error=0.0))
        self._test = _Highest(1.0, model_error=0.0)
        self._noise = np.random.default_rng((seed, 2))
        self.statistics: list[float] = []

    def take(self, samples: Samples, run: FilterRun, motion: str) -> None:
        """Take the next block."""
        for block in draw_up(self._account, samples, run):
            missing = np.linalg.cholesky(sensor_noise(block)) @ self._noise.standard_normal(2)
            self._test.add(replace(block, missing=missing, doubts=np.zeros(2)))
            self.statistics.append(self._test.highest())


def crossings(statistics: Sequence[Array], limit: float) -> int:
    """Count how often runs' statistics go over a limit, having been below it for 8 s."""
    count = 0
    for series in statistics:
        above = np.flatnonzero(series > limit)
        count += int((np.diff(above, prepend=-MINIMUM_BLOCKS) >= MINIMUM_BLOCKS).sum())
    return count


def expected(limit: float, blocks: int, run_blocks: int) -> float:
    """Return how many crossings the constants in use make it in so many blocks."""
    return DIRECTIONS * crossing_rate(limit, WITNESSES, run_blocks) * blocks


def main() -> None:
    """Run the simulation and print crossings found and expected, limit by limit."""
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
