"""Size and onset of a fault in the accounts, sudden or growing, with the size's standard error.

No single onset explains a leak that grows over minutes. The blocks so far are therefore divided
into stretches of time. The leak's coefficient may differ from stretch to stretch, and so may the
spool's null, which wanders too. The growth of the leak since the first stretch is tested like the
coefficient of a sudden leak: the surplus over the dead zone is compared with its standard error.
"""

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
    least_variance,
)
from rig.plant import LEAKS

from .fault_scores import WITNESSES
from .finding import Finding

Array = NDArray[np.float64]
Sudden = tuple[int, int, tuple[int, int] | None, float, float]
"""A sudden fault to be sized: its index and mark, index and onset of another fault beside it or
None, the dead zone in L/min, and the noise variance."""

GREAT_FLOW: Final = 0.5
"""Flow in L/min above which a leak that opens lets pressures fall too far for a linear account."""
SETTLING_BLOCKS: Final = 2
"""Blocks after the onset that are left out when a leak above `GREAT_FLOW` is claimed and sized.

They are left out once twice `WITNESSES` blocks have the leak."""
STRETCHES: Final = 8
"""Number of stretches of time, each with a coefficient of its own for a leak that grows."""
LEAST_BLOCKS: Final = 120
"""Fewest blocks for a leak that grows: one minute, so that a stretch lasts at least seven seconds.
"""


def stretches(sums: AccountSums) -> NDArray[np.int64]:
    """Return indices of the marks that divide the blocks so far into about equal stretches.

    Returns:
        int64, increasing, at most `STRETCHES` - 1 marks. In a run of more than half an hour the
        early marks are sparse, so that some stretches merge and there are fewer.
    """
    blocks = np.arange(1, STRETCHES) * sums.blocks // STRETCHES
    return np.unique([sums.mark_of(int(block)) for block in blocks])


@dataclass(frozen=True)
class Course:
    """A fit of a leak and of the spool's null that may both change from stretch to stretch.

    Attributes:
        fit: the fit; its last columns are the changes of the leak's coefficient.
        marks: indices of the marks at which they change, int64 (changes,).
        levels: the leak's coefficient in each stretch less that in the first one, float64
            (changes,), SI units.
        variance: noise variance by which the fit weighs what is known of the nuisances, in units
            of the expected noise.
    """

    fit: JointFit
    marks: NDArray[np.int64]
    levels: Array
    variance: float


def course_of(sums: AccountSums, leak: int, variance: float, model_error: float) -> Course:
    """Return the course of a leak over the run, in about `STRETCHES` equal stretches.

    Args:
        sums: sums over the blocks.
        leak: index into `FAULTS`.
        variance: noise variance to begin with, in units of the expected noise; it is estimated anew
            twice.
        model_error: factor on what is allowed for errors of the model.
    """
    marks = stretches(sums)
    fit, left = _changing(sums, leak, marks, variance)
    for _ in range(2):
        variance = max(left, least_variance(model_error))
        fit, left = _changing(sums, leak, marks, variance)
    return Course(fit, marks, np.cumsum(fit.coefficients[marks.size :]), variance)


def _changing(
    sums: AccountSums,
    leak: int,
    marks: NDArray[np.int64],
    variance: float,
) -> tuple[JointFit, float]:
    """Return the fit of a leak and of the null, which may both change at every mark.

    The second value is the noise variance that the fit leaves, in units of the expected noise. The
    residual that it follows from counts in what is known of the nuisances beforehand.
    """
    shapes = [SHIFT] * marks.size + [leak] * marks.size
    fit = JointFit(sums, shapes, [*marks, *marks], variance)
    _, _, total = sums.nuisances()
    return fit, (total - fit.explained) / (2 * sums.blocks - marks.size)


@dataclass(frozen=True)
class FaultSizes:
    """Estimates the sizes of faults from the blocks so far.

    Attributes:
        sums: sums over the blocks.
        products: `AccountSums.faults_since` of these sums.
        recent: the latest blocks, which show whether noise lasts from block to block.
        model_error: factor on what is allowed for errors of the model.
        known: the sudden faults that were sized since the last block, filled here; a search asks
            for the same one several times.
    """

    sums: AccountSums
    products: FaultProducts
    recent: RecentBlocks
    model_error: float
    known: dict[Sudden, Finding]

    def sudden(
        self,
        fault: int,
        mark: int,
        beside: Finding | None,
        dead_zone: float,
        variance: float,
    ) -> Finding:
        """Return a finding for a fault that begins suddenly, at a mark.

        The standard error also covers noise that differs or lasts from block to block. The
        statistic is computed without the block that supports the fault most. The size is estimated
        without the blocks around the onset, in which the fault is only partly present. The
        finding's `likelihood` and `limit` are left at 0 for the caller to set.

        Args:
            fault: index into `FAULTS`.
            mark: mark at which the fault begins.
            beside: another fault that is fitted along, or None.
            dead_zone: flow in L/min that must be exceeded before the fault is claimed.
            variance: noise variance, in units of the expected noise.
        """
        other = None if beside is None else (beside.fault, beside.onset)
        key = fault, mark, other, float(dead_zone), variance
        if key not in self.known:
            self.known[key] = self._sudden(fault, mark, beside, float(dead_zone), variance)
        return self.known[key]

    def _sudden(
        self, fault: int, mark: int, beside: Finding | None, dead_zone: float, variance: float
    ) -> Finding:
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
        fit = JointFit(self.sums, faults, marks, variance)
        if size * fit.coefficients[-1] > GREAT_FLOW and blocks >= 2 * WITNESSES:
            after = SETTLING_BLOCKS
            settling = [(mark, mark + after)]
            fit = JointFit(self.sums, faults, marks, variance, settling)
        lasting = self._lasting(faults, marks, variance, settling)
        dead = dead_zone / size
        # The fault must stand out whichever single block is left out.
        rest, error = fit.left_out()
        statistic = float(((rest - dead) / np.sqrt(error * lasting)).min())
        straddling = around(marks, self.sums.marks, after)
        if again and len(straddling) == 1:
            # The fault ended so soon that no block has it throughout.
            straddling = settling
        fit = JointFit(self.sums, faults, marks, variance, straddling)
        coefficient = float(fit.coefficients[-1])
        deviation = sqrt(max(fit.error, fit.uneven_error()) * lasting)
        onset_s = self.sums.start_s(mark)
        if mark:
            onset_s -= fit.began_before() * self.sums.seconds(mark - 1, mark)
        return Finding(
            fault,
            int(self.sums.mark_blocks[mark]),
            coefficient,
            deviation,
            statistic,
            0.0,
            onset_s,
            lasting,
        )

    def grown(self, variance: float, dead_zone: Array, limit: float) -> Finding | None:
        """Return the likeliest leak that grows over minutes; None if its statistic is too small.

        There must be `LEAST_BLOCKS` blocks or more. Each leak is fitted as if it were the only
        fault. The finding's `coefficient` is the mean since the leak exceeded the dead zone. Its
        `limit` is left at 0 for the caller to set.

        Args:
            variance: noise variance if there were no leak, in units of the expected noise.
            dead_zone: flow in L/min that each fault must exceed to be claimed, float64 (5,).
            limit: value that the statistic must exceed; a healthy rig does so at the stated rate.
        """
        marks = stretches(self.sums)
        fits = [self._growth(leak, marks, variance) for leak in range(len(LEAKS))]
        fault = max(range(len(LEAKS)), key=lambda leak: fits[leak].explained)
        levels = np.cumsum(fits[fault].coefficients[marks.size :])
        lasting = self._noise_left(fits[fault])
        deviation = sqrt(fits[fault].error_of_sum(marks.size) * lasting)
        size = float(self.products.sizes[marks[-1], fault])
        dead = dead_zone[fault] / size if size > 0.0 else inf
        statistic = (float(levels[-1]) - dead) / deviation
        if not statistic > limit:
            return None
        below = np.flatnonzero(levels <= dead)
        first = int(below[-1]) + 1 if below.size else 0
        mark = int(marks[first])
        return Finding(
            fault, int(self.sums.mark_blocks[mark]), float(levels[first:].mean()), deviation,
            statistic, statistic**2, self.sums.start_s(mark), 1.0, float(levels[-1]),
        )  # fmt: skip

    def _growth(self, leak: int, marks: NDArray[np.int64], variance: float) -> JointFit:
        """Return the fit of a leak and of the null, which may both change at every mark.

        The noise variance is estimated anew where the fit leaves less than half or more than twice
        of the given one.
        """
        fit, left = _changing(self.sums, leak, marks, variance)
        if 0.5 < left / variance < 2.0:
            return fit
        left = max(left, least_variance(self.model_error))
        return _changing(self.sums, leak, marks, left)[0]

    def _lasting(
        self, faults: list[int], marks: list[int], variance: float, settling: list[Stretch]
    ) -> float:
        """Return the factor by which lasting noise raises the variance of the last coefficient.

        Growth of the fault must not count as noise, so a fault that is long enough may change its
        size after the first and second third of its time.

        Args:
            faults: indices into `FAULTS` (or `SHIFT`), the fault in question last.
            marks: mark at which each of them begins.
            variance: noise variance, in units of the expected noise.
            settling: stretches of marks whose blocks are left out.
        """
        since, blocks = marks[-1], self.sums.marks - marks[-1]
        if blocks >= 3 * WITNESSES:
            changes = [since + blocks // 3, since + 2 * blocks // 3]
            faults = [faults[-1], faults[-1], *faults]
            marks = [*changes, *marks]
        return self._noise_left(JointFit(self.sums, faults, marks, variance, settling))

    def _noise_left(self, fit: JointFit) -> float:
        """Return `lasting_noise` of what a fit leaves unexplained of the latest blocks."""
        onsets = [int(self.sums.mark_blocks[mark]) for mark in fit.marks]
        present = list(zip(fit.faults, onsets, fit.coefficients, strict=True))
        return lasting_noise(self.recent.residuals(fit.nuisances, present), self.model_error)
