"""Nuisances and a few faults of the oil accounts fitted together, and how sure the last one is."""

from collections.abc import Iterable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .nuisances import NUISANCE_COUNT, NULL_SHIFT
from .sums import SHIFT, AccountSums, FaultProducts, product_weights, square_weights

Array = NDArray[np.float64]
Integers = NDArray[np.int64]
Stretch = tuple[int, int]
"""Blocks from one mark on, up to another mark, before which the stretch ends."""

_MOST_LEVERAGE: Final = 0.999
"""Leverage of a block that settles a coefficient all alone, but for round-off."""


class JointFit:
    """Least squares of missing flows on all nuisances and some faults, each from its mark on.

    Args:
        sums: the blocks.
        products: the same blocks' `AccountSums.faults_since`.
        faults: indices into `FAULTS`, or `SHIFT`, whose size is within `NULL_SHIFT`.
        marks: where each begins.
        variance: of the noise.
        passed_over: stretches whose blocks do not count, each from a mark to another, in their
            order and apart (`around`).

    Attributes:
        nuisances: float64 (n,), in standard deviations.
        coefficients: of the faults, SI, float64 (faults,).
        error: variance of the last coefficient if noise is the same in all blocks.
        explained: drop of the weighted sum of squares by all of them.
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
        self._sums, self._faults, self._marks = sums, faults, marks
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
        inverse = _inverse(normal)
        self._variance, self._inverse = variance, inverse
        self._direction = inverse[-1]
        self._fitted = inverse @ right
        self.explained = float(self._fitted @ right)
        self.nuisances, self.coefficients = self._fitted[:n], self._fitted[n:]
        self.error = variance * float(inverse[-1, -1])

    def _since(self, series: Array, marks: Integers, *of: Integers) -> Array:
        """Return sums since marks, of which `series` has all, less what is passed over."""
        counted = np.array(_from(series, marks, of))
        for first, last in self._passed_over:
            counted -= _from(series, np.maximum(marks, first), of)
            counted += _from(series, np.maximum(marks, last), of)
        return counted

    def _present(self, mark: int) -> Array:
        """Return which columns there are between a mark and the next: float64 (n + faults,)."""
        return np.append(np.ones(NUISANCE_COUNT), [float(m <= mark) for m in self._marks])

    def _influences(self) -> tuple[Array, Array]:
        """Return what each block pulled the last coefficient by, and its leverage (marks,) each."""
        forms = np.empty((self._sums.marks, 2))
        for start in sorted({0, *self._marks}):
            present = self._present(start)
            left, right = self._direction * present, self._fitted * present
            influence = product_weights(left, self._faults)
            influence -= square_weights(left, right, self._faults)
            leverage = square_weights(left, left, self._faults) / self._direction[-1]
            weights = np.column_stack([influence, leverage])
            forms[start:] = self._sums.weighted(weights, start, self._sums.marks)
        for stretch in self._passed_over:
            forms[slice(*stretch)] = 0.0
        return forms[:, 0], np.clip(forms[:, 1], 0.0, _MOST_LEVERAGE)

    def error_of_sum(self, count: int) -> float:
        """Return the variance of the sum of the last coefficients."""
        return self._variance * float(self._inverse[-count:, -count:].sum())

    def uneven_error(self) -> float:
        """Return the variance of the last coefficient if noise differs from block to block.

        After Eicker, Huber and White; residuals grown by their leverage (MacKinnon and White 1985).
        """
        influence, leverage = self._influences()
        return float((influence**2 / (1.0 - leverage)).sum())

    def left_out(self) -> tuple[Array, Array]:
        """Return the last coefficient as it would be without the blocks after each mark.

        These are the blocks up to the next mark: one, or several where old marks were thinned out.
        Nothing is fitted anew: what the other columns explain stays as in the whole fit. Blocks
        that are passed over change nothing.

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
        """Return for what part of the time since the mark before the last fault was there."""
        before = self._marks[-1] - 1
        if before < 0:
            return 0.0
        own = np.zeros(self._fitted.size)
        own[-1] = self._fitted[-1]
        known = self._fitted * self._present(before)
        missing = product_weights(own, self._faults) - square_weights(own, known, self._faults)
        weights = np.column_stack([missing, square_weights(own, own, self._faults)])
        left, whole = self._sums.weighted(weights, before, before + 1)[0]
        return float(np.clip(left / whole, 0.0, 1.0)) if whole > 0.0 else 0.0


def around(marks: Iterable[int], last: int, after: int = 1) -> list[Stretch]:
    """Return the stretches around onsets whose blocks belong neither before them nor after.

    A fault begins somewhere in a block: in that before its mark, or in that after it.

    Args:
        marks: where faults begin or change.
        last: number of marks.
        after: marks after an onset that are passed over.
    """
    stretches: list[Stretch] = []
    for mark in sorted(set(marks)):
        first, end = max(mark - 1, 0), min(mark + after, last)
        if stretches and first <= stretches[-1][1]:
            first, end = stretches[-1][0], max(stretches.pop()[1], end)
        stretches.append((first, end))
    return stretches


def _from(series: Array, marks: Integers, of: Sequence[Integers]) -> Array:
    """Return sums from marks on, of which `series` has all; there is none from the last mark on."""
    there = marks < len(series)
    sums = series[np.minimum(marks, len(series) - 1), *of]
    return np.asarray(
        np.where(there.reshape(there.shape + (1,) * (sums.ndim - there.ndim)), sums, 0.0)
    )


def _inverse(normal: Array) -> Array:
    """Invert a normal matrix whose columns differ by many orders of magnitude.

    A fault of which nothing was to be seen has a column of zeros; its coefficient is left at zero.
    """
    diagonal = np.diagonal(normal)
    seen = diagonal > 0.0
    scale = 1.0 / np.sqrt(np.where(seen, diagonal, 1.0))
    normal = np.where(np.diag(~seen), 1.0, normal)
    scaled = scale[:, None] * normal * scale
    try:
        inverse = np.linalg.inv(scaled)
    except np.linalg.LinAlgError:
        # Nothing was to be seen of a fault between two of its marks: they share its coefficient.
        inverse = np.linalg.pinv(scaled, hermitian=True)
    return np.asarray(scale[:, None] * inverse * scale)
