"""The joint fit of nuisances and a few faults to the oil accounts, with the last fault's error."""

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .fit_sums import acting, balanced, influence_weights, normal_equations
from .nuisances import NUISANCE_COUNT
from .sums import AccountSums

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Stretch = tuple[int, int]
"""Indices of two marks: the stretch has the blocks from the first mark up to the second."""

MOST_LEVERAGE: Final = 0.999
"""Upper bound of a block's leverage. A block that alone determines a coefficient has leverage one,
by which could not be divided."""


class JointFit:
    """Least squares of the missing flows on all nuisances and some faults, each from its mark on.

    Args:
        sums: sums over the blocks.
        faults: indices into `FAULTS`, or `SHIFT`, which has a prior of `NULL_SHIFT`.
        marks: index of the mark at which each of them begins.
        variance: noise variance, in units of the expected noise.
        passed_over: stretches whose blocks do not count, in increasing order, without overlap
            (as from `around`).

    Attributes:
        faults, marks: as given.
        nuisances: sizes of the nuisances in standard deviations, float64 (n,).
        coefficients: coefficients of the faults, SI units, float64 (faults,).
        error: variance of the last coefficient if noise is the same in all blocks.
        explained: reduction of the weighted sum of squares by all columns together.
    """

    def __init__(
        self,
        sums: AccountSums,
        faults: Sequence[int],
        marks: Sequence[int],
        variance: float,
        passed_over: Sequence[Stretch] = (),
    ) -> None:
        n = NUISANCE_COUNT
        self._sums, self.faults, self.marks = sums, faults, marks
        self._passed_over = passed_over
        self._of = np.array(faults, dtype=np.int64)
        self._since = np.array(marks, dtype=np.int64)
        left_out = np.array(passed_over, dtype=np.int64).reshape(-1, 2)
        normal, right = normal_equations(
            *sums.packed, self._of, self._since, left_out, float(variance)
        )
        inverse = inverse_of(normal)
        self._variance, self._inverse = variance, inverse
        self._direction = inverse[-1]
        self._fitted = inverse @ right
        self.explained = float(self._fitted @ right)
        self.nuisances, self.coefficients = self._fitted[:n], self._fitted[n:]
        self.error = variance * float(inverse[-1, -1])

    def _influences(self) -> tuple[Array, Array]:
        """Return each block's influence on the last coefficient, and its leverage: (marks,) each.

        Where old marks were thinned out, an entry stands for all blocks between two marks.
        """
        forms = np.empty((self._sums.marks, 2))
        for start in sorted({0, *self.marks}):
            left = acting(self._direction, self._since, start)
            right = acting(self._fitted, self._since, start)
            weights = influence_weights(left, right, self._of, self._direction[-1])
            forms[start:] = self._sums.weighted(weights, start, self._sums.marks)
        for stretch in self._passed_over:
            forms[slice(*stretch)] = 0.0
        return forms[:, 0], np.clip(forms[:, 1], 0.0, MOST_LEVERAGE)

    def error_of_sum(self, count: int) -> float:
        """Return the variance of the sum of the last `count` coefficients.

        It holds, as `error` does, if noise is the same in all blocks.
        """
        return self._variance * float(self._inverse[-count:, -count:].sum())

    def uneven_error(self) -> float:
        """Return the variance of the last coefficient if noise differs from block to block.

        It is the estimate of Eicker, Huber and White, with residuals enlarged by their leverage
        (MacKinnon and White 1985).
        """
        influence, leverage = self._influences()
        return float((influence**2 / (1.0 - leverage)).sum())

    def left_out(self) -> tuple[Array, Array]:
        """Return what the last coefficient would be without the blocks between a mark and the next.

        Entry j leaves out those after mark j up to the next mark or now: one block, or several
        where old marks were thinned out. The other coefficients stay as they are. Leaving out
        blocks that are passed over anyway changes nothing.

        Returns:
            The coefficients and their variances, (marks,) each. A variance is the larger of that
            for noise that is the same in all blocks and that for noise that differs.
        """
        influence, leverage = self._influences()
        kept = 1.0 - leverage
        shares = influence**2 / kept
        uneven = shares.sum() - shares
        return self._fitted[-1] - influence / kept, np.maximum(self.error, uneven) / kept

    def began_before(self) -> float:
        """Return for what part of the interval before its mark the last fault was already present.

        The interval reaches from the previous mark to the last fault's own mark. The result is 0 to
        1, and 0 if there is no previous mark.
        """
        before = self.marks[-1] - 1
        if before < 0:
            return 0.0
        own = np.zeros(self._fitted.size)
        own[-1] = self._fitted[-1]
        known = acting(self._fitted, self._since, before)
        weights = influence_weights(own, known, self._of, 1.0)
        left, whole = self._sums.weighted(weights, before, before + 1)[0]
        return float(np.clip(left / whole, 0.0, 1.0)) if whole > 0.0 else 0.0


def around(marks: Iterable[int], last: int, after: int = 1) -> list[Stretch]:
    """Return the stretches around onsets in which a fault may be present for part of a block.

    A fault that is found at a mark may have begun in the block before the mark or in the one after
    it. Stretches that touch are merged.

    Args:
        marks: indices of the marks at which faults begin or change.
        last: number of marks; no stretch reaches beyond it.
        after: number of intervals between marks that are included after each onset.

    Returns:
        Pairs (first mark, end mark) in increasing order, without overlap.
    """
    stretches: list[Stretch] = []
    for mark in sorted(set(marks)):
        first, end = max(mark - 1, 0), min(mark + after, last)
        if stretches and first <= stretches[-1][1]:
            first, end = stretches[-1][0], max(stretches.pop()[1], end)
        stretches.append((first, end))
    return stretches


def inverse_of(normal: Array) -> Array:
    """Return the inverse of a normal matrix whose columns differ by many orders of magnitude.

    A fault that shows in no block has a column of zeros; its coefficient will then be zero.
    """
    scaled, scale = balanced(normal)
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        # A fault does not show between two of its marks, which then share its coefficient.
        inverse = np.linalg.pinv(scaled, hermitian=True)
    return np.asarray(scale[:, None] * inverse * scale)
