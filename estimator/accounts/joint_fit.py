"""The joint fit of nuisances and a few faults to the oil accounts, with the last fault's error."""

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .nuisances import NUISANCE_COUNT, NULL_SHIFT
from .sums import SHIFT, AccountSums, FaultProducts, product_weights, square_weights

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
        products: `AccountSums.faults_since` of these sums.
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
        products: FaultProducts,
        faults: Sequence[int],
        marks: Sequence[int],
        variance: float,
        passed_over: Sequence[Stretch] = (),
    ) -> None:
        n = NUISANCE_COUNT
        self._sums, self.faults, self.marks = sums, faults, marks
        self._passed_over = passed_over
        of, since = np.asarray(faults), np.asarray(marks)
        normal = np.empty((n + of.size, n + of.size))
        right = np.empty(n + of.size)
        squares, right[:n], _ = sums.nuisances(passed_over)
        normal[:n, :n] = squares + variance * np.eye(n)
        normal[n:, :n] = self._since(products.crossed, since, of)
        normal[:n, n:] = normal[n:, :n].T
        both = np.maximum.outer(since, since)
        normal[n:, n:] = self._since(products.squares, both, of[:, None], of)
        normal[n:, n:] += np.diag(np.where(of == SHIFT, variance / NULL_SHIFT**2, 0.0))
        right[n:] = self._since(products.products, since, of)
        inverse = inverse_of(normal)
        self._variance, self._inverse = variance, inverse
        self._direction = inverse[-1]
        self._fitted = inverse @ right
        self.explained = float(self._fitted @ right)
        self.nuisances, self.coefficients = self._fitted[:n], self._fitted[n:]
        self.error = variance * float(inverse[-1, -1])

    def _since(self, series: Array, marks: Integers, *of: Integers) -> Array:
        """Return sums from the given marks on, without the blocks that are passed over.

        Args:
            series: sums since each mark, first axis the marks.
            marks: indices of the marks.
            of: indices into the further axes of `series`.
        """
        counted = np.array(_from(series, marks, of))
        for first, last in self._passed_over:
            counted -= _from(series, np.maximum(marks, first), of)
            counted += _from(series, np.maximum(marks, last), of)
        return counted

    def _present(self, mark: int) -> Array:
        """Return 1 for each column that acts between a mark and the next, else 0: (n + faults,)."""
        return np.append(np.ones(NUISANCE_COUNT), [float(m <= mark) for m in self.marks])

    def _influences(self) -> tuple[Array, Array]:
        """Return each block's influence on the last coefficient, and its leverage: (marks,) each.

        Where old marks were thinned out, an entry stands for all blocks between two marks.
        """
        forms = np.empty((self._sums.marks, 2))
        for start in sorted({0, *self.marks}):
            present = self._present(start)
            left, right = self._direction * present, self._fitted * present
            influence = product_weights(left, self.faults)
            influence -= square_weights(left, right, self.faults)
            leverage = square_weights(left, left, self.faults) / self._direction[-1]
            weights = np.column_stack([influence, leverage])
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
        known = self._fitted * self._present(before)
        missing = product_weights(own, self.faults) - square_weights(own, known, self.faults)
        weights = np.column_stack([missing, square_weights(own, own, self.faults)])
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


def _from(series: Array, marks: Integers, of: Sequence[Integers]) -> Array:
    """Return sums from the given marks on, taken from `series`; 0 for a mark beyond its end."""
    there = marks < len(series)
    sums = series[np.minimum(marks, len(series) - 1), *of]
    return np.asarray(
        np.where(there.reshape(there.shape + (1,) * (sums.ndim - there.ndim)), sums, 0.0)
    )


def inverse_of(normal: Array) -> Array:
    """Return the inverse of a normal matrix whose columns differ by many orders of magnitude.

    A fault that shows in no block has a column of zeros; its coefficient will then be zero.
    """
    diagonal = np.diagonal(normal)
    seen = diagonal > 0.0
    scale = 1.0 / np.sqrt(np.where(seen, diagonal, 1.0))
    normal = np.where(np.diag(~seen), 1.0, normal)
    scaled = scale[:, None] * normal * scale
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        # A fault does not show between two of its marks, which then share its coefficient.
        inverse = np.linalg.pinv(scaled, hermitian=True)
    return np.asarray(scale[:, None] * inverse * scale)
