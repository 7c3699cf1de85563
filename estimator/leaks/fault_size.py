"""A fault of the accounts sized and dated, with its standard error."""

from dataclasses import dataclass
from math import inf, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    SHIFT,
    AccountSums,
    FaultProducts,
    JointFit,
    RecentBlocks,
    Stretch,
    around,
    lasting_noise,
)

from .fault_scores import WITNESSES
from .finding import Finding
from .growth import growths

Array = NDArray[np.float64]

GREAT_FLOW: Final = 0.5
"""L/min: where a greater leak opens, pressures fall by more than straight lines hold for."""
SETTLING_BLOCKS: Final = 2
"""Such a leak is claimed and sized without the first blocks, once twice the witnesses spoke."""


@dataclass(frozen=True)
class FaultSizes:
    """Sizes faults by the blocks so far.

    Attributes:
        sums: the blocks.
        products: the same blocks' `AccountSums.faults_since`.
        recent: the latest of them, which tell whether noise lasts.
        model_error: factor on what is allowed for errors of the model.
    """

    sums: AccountSums
    products: FaultProducts
    recent: RecentBlocks
    model_error: float

    def sudden(
        self,
        fault: int,
        mark: int,
        beside: Finding | None,
        dead_zone: float,
        variance: float,
    ) -> Finding:
        """Return a fault from a mark on as a finding, fitted together with one beside it.

        Its standard error also holds for noise that differs or lasts from block to block, and the
        statistic is that without the block that speaks most for the fault. The size is by blocks
        that have the fault throughout, and those that have none of it: that in which it begins is
        not among them.

        Args:
            fault: index into `FAULTS`.
            mark: where it begins.
            beside: a fault that was found.
            dead_zone: flow in L/min that it is not claimed for.
            variance: of the noise.
        """
        products = self.products
        faults, marks = [SHIFT, fault], [mark, mark]
        if beside is not None:
            other = self.sums.mark_of(beside.onset)
            faults, marks = [SHIFT, beside.fault, fault], [mark, other, mark]
        size, after = float(products.sizes[mark, fault]), 1
        blocks = products.blocks[mark]
        again = beside is not None and beside.fault == fault
        if again and marks[1] < self.sums.marks:
            blocks -= products.blocks[marks[1]]
        settling: list[Stretch] = []
        fit = JointFit(self.sums, products, faults, marks, variance)
        if size * fit.coefficients[-1] > GREAT_FLOW and blocks >= 2 * WITNESSES:
            after = SETTLING_BLOCKS
            settling = [(mark, mark + after)]
            fit = JointFit(self.sums, products, faults, marks, variance, settling)
        lasting = self._lasting(faults, marks, variance, settling)
        dead = dead_zone / size
        # Whatever block is left out, the rest must speak for the fault.
        rest, error = fit.left_out()
        statistic = float(((rest - dead) / np.sqrt(error * lasting)).min())
        straddling = around(marks, self.sums.marks, after)
        if again and len(straddling) == 1:
            # It went again so soon that no block is left which it was there throughout.
            straddling = settling
        fit = JointFit(self.sums, products, faults, marks, variance, straddling)
        coefficient = float(fit.coefficients[-1])
        deviation = sqrt(max(fit.error, fit.uneven_error()) * lasting)
        fraction = fit.began_before()
        onset_s = self.sums.start_s(mark)
        if mark:
            onset_s -= fraction * self.sums.seconds(mark - 1, mark)
        return Finding(
            fault,
            int(self.sums.mark_blocks[mark]),
            fraction,
            coefficient,
            deviation,
            statistic,
            0.0,
            onset_s,
            lasting,
        )

    def grown(self, variance: float, dead_zone: Array, limit: float) -> Finding | None:
        """Return the leak that grows over minutes, if its statistic exceeds the limit.

        Args:
            variance: of the noise if there were no leak.
            dead_zone: flow in L/min that no fault is claimed for, by fault, float64 (5,).
            limit: what a healthy rig exceeds at the stated rate.
        """
        likeliest = growths(self.sums, self.products, self.recent, variance, self.model_error)[0]
        fault, levels = likeliest.fault, likeliest.levels
        size = float(self.products.sizes[likeliest.marks[-1], fault])
        dead = dead_zone[fault] / size if size > 0.0 else inf
        statistic = (float(levels[-1]) - dead) / likeliest.deviation
        if not statistic > limit:
            return None
        below = np.flatnonzero(levels <= dead)
        first = int(below[-1]) + 1 if below.size else 0
        mark = int(likeliest.marks[first])
        return Finding(
            fault, int(self.sums.mark_blocks[mark]), 0.0, float(levels[first:].mean()),
            likeliest.deviation, statistic, statistic**2, self.sums.start_s(mark), 1.0,
            float(levels[-1]),
        )  # fmt: skip

    def _lasting(
        self, faults: list[int], marks: list[int], variance: float, settling: list[Stretch]
    ) -> float:
        """Return by how much noise that lasts raises the variance of the last fault's coefficient.

        That the fault grows or shrinks is no noise: it may change at each third of its time.
        """
        since, blocks = marks[-1], self.sums.marks - marks[-1]
        if blocks >= 3 * WITNESSES:
            changes = [since + blocks // 3, since + 2 * blocks // 3]
            faults = [faults[-1], faults[-1], *faults]
            marks = [*changes, *marks]
        fit = JointFit(self.sums, self.products, faults, marks, variance, settling)
        onsets = [int(self.sums.mark_blocks[m]) for m in marks]
        present = list(zip(faults, onsets, fit.coefficients, strict=True))
        return lasting_noise(self.recent.residuals(fit.nuisances, present), self.model_error)
