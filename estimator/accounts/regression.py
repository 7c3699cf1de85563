"""Bayesian linear regression of missing flows on nuisances, with scores of one further column.

    y = F theta + k u + e,      theta ~ N(0, 1),      e ~ N(0, v)

with y the missing flows of all blocks, F the nuisances per standard deviation and u the signature
of a fault from an onset on, whose coefficient k has no prior. Marginally y - k u ~ N(0, v + F F'),
so k and its variance follow by generalised least squares; the matrix inversion lemma leaves
matrices of the size of F'F (Bishop 2006, Pattern Recognition and Machine Learning, sections 3.3 and
3.5).
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit

from .nuisances import NULL_SHIFT
from .sums import FaultProducts

Array = NDArray[np.float64]

NOISE_WEIGHT: Final = 8.0
"""Weight of the prior noise variance, which is one, in the estimate: it counts like this many
values."""
LEAST_VARIANCE: Final = 0.25
"""Lower bound of the estimated noise variance for a model with the usual errors."""
LEAST_INFORMATION: Final = 1e-6
"""If the nuisances leave a column less than this part of its information, they explain it entirely,
up to round-off."""


def least_variance(model_error: float) -> float:
    """Return the lower bound of the estimated noise variance, in units of the expected noise.

    It is 1 for an exact model (`model_error` 0), as sensors are no quieter than on their data
    sheets. It falls to `LEAST_VARIANCE` at 1, as errors of the model may be smaller than usual.
    """
    return 1.0 - (1.0 - LEAST_VARIANCE) * min(model_error, 1.0)


@dataclass(frozen=True)
class Scores:
    """What each fault's column would explain beside the nuisances, float64 (marks, 5) each.

    Attributes:
        coefficient: estimated coefficient of the fault.
        information: information on the coefficient, whose variance is `variance / information`; 0
            for a column that the nuisances explain entirely.
        explained: reduction of the weighted sum of squares if the column is included.
        variance: noise variance that would be left.
    """

    coefficient: Array
    information: Array
    explained: Array
    variance: Array


@njit(cache=True, error_model="numpy")
def _noise_variance(values, projected, squares, count, least):
    """Return the noise variance by fixed-point iteration (MacKay 1992), and F's degrees of freedom.

    Args:
        values: eigenvalues of F'F, (m,).
        projected: F'y in the axes of the eigenvectors, (m,).
        squares: y'y.
        count: number of values in y.
        least: lower bound of the variance.
    """
    variance = 1.0
    used = 0.0
    for _ in range(100):
        residual = squares
        used = 0.0
        for a in range(values.size):
            kept = 1.0 / (values[a] + variance)
            residual -= projected[a] * projected[a] * kept * (2.0 - values[a] * kept)
            used += values[a] * kept
        estimate = (NOISE_WEIGHT + residual) / (NOISE_WEIGHT + count - used)
        estimate = max(estimate, least)
        settled = abs(estimate - variance) < 1e-4 * variance
        variance = estimate
        if settled:
            break
    return variance, used


@njit(cache=True, error_model="numpy")
def _score(rotated, squares, products, values, projected, total, freedom, variance, least):
    """Return the fields of `Scores` (4, marks, faults), each fault fitted with a shift of the null.

    Args:
        rotated: products of faults and shift with F, in the axes of the eigenvectors of F'F,
            (marks, faults + 1, m).
        squares: products of faults and shift with each other, (marks, faults + 1, faults + 1).
        products: products of faults and shift with y, (marks, faults + 1).
        values: eigenvalues of F'F, (m,).
        projected: F'y in the axes of the eigenvectors, (m,).
        total: y'y.
        freedom: degrees of freedom of the noise variance that is left.
        variance: noise variance by which nuisances are weighed against noise.
        least: lower bound of the noise variance that is left.
    """
    m = values.size
    faults = products.shape[1] - 1
    out = np.empty((4, products.shape[0], faults))
    weighted = total
    kept = np.empty(m)
    for a in range(m):
        kept[a] = 1.0 / (values[a] + variance)
        weighted -= projected[a] * projected[a] * kept[a]
    prior = variance / (NULL_SHIFT * NULL_SHIFT)
    for mark in range(products.shape[0]):
        shift = rotated[mark, faults]
        shift_square = squares[mark, faults, faults] + prior
        shift_product = products[mark, faults]
        for a in range(m):
            shift_square -= kept[a] * shift[a] * shift[a]
            shift_product -= kept[a] * shift[a] * projected[a]
        alone = shift_product / shift_square
        for i in range(faults):
            information = squares[mark, i, i]
            projection = products[mark, i]
            crossed = squares[mark, i, faults]
            for a in range(m):
                part = rotated[mark, i, a] * kept[a]
                information -= part * rotated[mark, i, a]
                projection -= part * projected[a]
                crossed -= part * shift[a]
            information -= crossed * crossed / shift_square
            projection -= crossed * alone
            out[:, mark, i] = 0.0
            out[3, mark, i] = variance
            if information > LEAST_INFORMATION * squares[mark, i, i]:
                coefficient = projection / information
                explained = coefficient * projection
                shifted = alone - coefficient * crossed / shift_square
                beliefs = prior / variance * shifted * shifted
                for a in range(m):
                    size = projected[a] - coefficient * rotated[mark, i, a] - shifted * shift[a]
                    beliefs += size * size * kept[a] * kept[a]
                residual = weighted - alone * shift_product - explained - variance * beliefs
                out[0, mark, i] = coefficient
                out[1, mark, i] = information
                out[2, mark, i] = explained
                out[3, mark, i] = max((NOISE_WEIGHT + residual) / freedom, least)
    return out


class Regression:
    """The Bayesian regression of y on F, computed from their products.

    Each coefficient is N(0, 1) before the data, so that a column of F is in standard deviations of
    what it stands for. The noise variance is 1 before the data, with the weight of `NOISE_WEIGHT`
    values.

    Args:
        squares: F'F, float64 (m, m).
        products: F'y, float64 (m,).
        total: y'y.
        count: number of values in y.
        least: lower bound of the noise variance.

    Attributes:
        variance: the estimated noise variance.
        freedom: degrees of freedom of the noise variance once one further column is fitted.
    """

    def __init__(
        self,
        squares: Array,
        products: Array,
        total: float,
        count: int,
        least: float = LEAST_VARIANCE,
    ) -> None:
        values, self._vectors = np.linalg.eigh(squares)
        self._values = np.maximum(values, 0.0)  # Round-off may leave F'F short of semidefinite.
        self._projected = self._vectors.T @ products
        self._total, self._least = total, least
        self.variance, used = _noise_variance(self._values, self._projected, total, count, least)
        self.freedom = NOISE_WEIGHT + count - used - 1.0

    @property
    def axes(self) -> tuple[Array, Array, Array]:
        """Return eigenvectors (m, m) and eigenvalues (m,) of F'F, and F'y in their axes (m,)."""
        return self._vectors, self._values, self._projected

    def score(self, crossed: Array, products: FaultProducts, variance: float) -> Scores:
        """Return the scores of every fault from every mark on, as one further column each.

        Args:
            crossed: products of faults and null shift with F, float64 (marks, 6, m).
            products: products of faults and null shift with each other and with y.
            variance: noise variance by which nuisances are weighed against noise.
        """
        rotated = (crossed.reshape(-1, self._values.size) @ self._vectors).reshape(crossed.shape)
        whole = np.ascontiguousarray
        return Scores(*_score(
            rotated, whole(products.squares), whole(products.products), self._values,
            self._projected, self._total, self.freedom, variance, self._least,
        ))  # fmt: skip

    def nuisances(self) -> tuple[Array, Array]:
        """Return the nuisances' most likely sizes (m,) and their covariance (m, m).

        Both are in the units of F's columns: standard deviations of the nuisances.
        """
        kept = 1.0 / (self._values + self.variance)
        covariance = (self._vectors * (self.variance * kept)) @ self._vectors.T
        return self._vectors @ (self._projected * kept), covariance
