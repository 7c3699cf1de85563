"""Nuisances and a few faults of the oil accounts fitted together, and how sure the last one is."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .account_sums import AccountSums, FaultProducts, product_weights, square_weights
from .flow_account import NUISANCE_COUNT

Array = NDArray[np.float64]


class JointFit:
    """Least squares of missing flows on all nuisances and some faults, each from its mark on.

    Args:
        sums: the blocks.
        products: the same blocks' `AccountSums.faults_since`.
        faults: indices into `FAULTS`.
        marks: where each begins.
        variance: of the noise.

    Attributes:
        nuisances: float64 (15,), in standard deviations.
        coefficients: of the faults, SI, float64 (faults,).
        error: variance of the last coefficient if noise is the same in all blocks.
    """

    def __init__(
        self,
        sums: AccountSums,
        products: FaultProducts,
        faults: Sequence[int],
        marks: Sequence[int],
        variance: float,
    ) -> None:
        n = NUISANCE_COUNT
        self._sums, self._faults, self._marks = sums, faults, marks
        normal = np.zeros((n + len(faults), n + len(faults)))
        right = np.zeros(n + len(faults))
        squares, right[:n], _ = sums.nuisances()
        normal[:n, :n] = squares + variance * np.eye(n)
        columns = list(enumerate(zip(faults, marks, strict=True), start=n))
        for c, (i, mark) in columns:
            normal[:n, c] = normal[c, :n] = products.crossed[mark, i]
            right[c] = products.products[mark, i]
            for d, (j, other) in columns:
                normal[c, d] = products.squares[max(mark, other), i, j]
        inverse = _inverse(normal)
        self._direction = inverse[-1]
        self._fitted = inverse @ right
        self.nuisances, self.coefficients = self._fitted[:n], self._fitted[n:]
        self.error = variance * float(inverse[-1, -1])

    def _present(self, mark: int) -> Array:
        """Return which columns there are between a mark and the next: float64 (15 + faults,)."""
        return np.append(np.ones(NUISANCE_COUNT), [float(m <= mark) for m in self._marks])

    def jackknife(self) -> float:
        """Return the variance of the last coefficient if noise differs from mark to mark.

        Jackknife form of Eicker, Huber and White. It is large when little speaks for the fault, so
        that no block can raise an alarm alone.
        """
        last = np.zeros(self._fitted.size)
        last[-1] = 1.0
        left_out = np.empty(self._sums.marks)
        for start in sorted({0, *self._marks}):
            present = self._present(start)
            left, right = self._direction * present, self._fitted * present
            influence = product_weights(left, self._faults)
            influence -= square_weights(left, right, self._faults)
            leverage = square_weights(left, last * present, self._faults)
            weights = np.column_stack([influence, leverage])
            forms = self._sums.weighted(weights, start, self._sums.marks)
            left_out[start:] = forms[:, 0] / (1.0 - np.minimum(forms[:, 1], 0.999))
        return float((left_out**2).sum())

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
        return float(np.clip(left / whole, 0.0, 1.0))


def _inverse(normal: Array) -> Array:
    """Invert a normal matrix whose columns differ by many orders of magnitude."""
    scale = 1.0 / np.sqrt(np.diagonal(normal))
    return np.asarray(scale[:, None] * np.linalg.inv(scale[:, None] * normal * scale) * scale)
