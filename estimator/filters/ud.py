"""Covariances stored as the factors of P = U D U^T, so that rounding cannot make them indefinite.

U is unit upper triangular; D is diagonal and never negative (Bierman 1977, Factorization Methods
for Discrete Sequential Estimation). One array `factors` (n, n) holds both: `factors[j, i]` is
U[i, j] for i < j, and `factors[j, j]` is D[j]. A column of U is thus a row of the array, so that
the innermost loops run along memory. Elements above the diagonal are neither read nor written.
"""

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.lanes import select
from rig.plant import inlined

from .fused import fma

Array = NDArray[np.float64]


def dense_covariance(factors: Array) -> Array:
    """Return the covariance P (n, n) that `factors` (n, n) stand for."""
    upper = np.tril(factors, -1).T + np.eye(len(factors))
    return np.asarray((upper * np.diag(factors)) @ upper.T)


@inlined
def variance_of(factors, index):
    """Return the variance P[index, index] of one state from the factors of P."""
    total = factors[index, index]
    for j in range(index + 1, factors.shape[0]):
        u = factors[j, index]
        total = fma(u * u, factors[j, j], total)
    return total


@inlined
def add_rank_one(factors, size, vector, weight):
    """Add weight a a^T to the leading (size, size) part of P, in place (Agee and Turner 1972).

    `vector` holds a in its first `size` elements and is overwritten; the weight must not be
    negative.
    """
    for k in range(size - 1, -1, -1):
        d, a = factors[k, k], vector[k]
        raised = fma(weight * a, a, d)
        # If both are zero, a direction without variance stays without variance.
        inverse = select(raised > 0.0, 1.0 / raised, 0.0)
        share = weight * a * inverse
        weight = select(raised > 0.0, weight * (d * inverse), weight)
        factors[k, k] = raised
        for i in range(k):
            u = factors[k, i]
            rest = fma(-a, u, vector[i])
            vector[i] = rest
            factors[k, i] = fma(share, rest, u)


@inlined
def add_noises(factors, variances, scratch):
    """Add variances, not negative, to the last diagonal elements of P, in place.

    Each is one column of U that is taken apart, and one addition of rank one to what is before it.
    An addition works its way from its last row to its first, and needs of each row only what the
    additions before it have made of that row. So each row takes all additions before the next row
    does: the divisions of one row then do not wait for each other.

    Args:
        factors: (n, n), updated.
        variances: of the last states, in their order; m of them.
        scratch: array of m + 1 rows or more, with n - 1 columns or more, and m or more.
    """
    n, count = factors.shape[0], len(variances)
    first = n - count
    for k in range(n - 1, -1, -1):
        for s in range(max(k - first, 0), count):
            d = factors[k, k]
            if first + s == k:
                raised = d + variances[s]
                kept = select(raised > 0.0, d / raised, 1.0)
                scratch[count, s] = variances[s] * kept
                for i in range(k):
                    u = factors[k, i]
                    scratch[s, i] = u
                    factors[k, i] = u * kept
            else:
                a, weight = scratch[s, k], scratch[count, s]
                raised = fma(weight * a, a, d)
                # As in `add_rank_one`.
                inverse = select(raised > 0.0, 1.0 / raised, 0.0)
                share = weight * a * inverse
                scratch[count, s] = select(raised > 0.0, weight * (d * inverse), weight)
                for i in range(k):
                    u = factors[k, i]
                    rest = fma(-a, u, scratch[s, i])
                    scratch[s, i] = rest
                    factors[k, i] = fma(share, rest, u)
            factors[k, k] = raised


@inlined
def correct(x, factors, index, measured, variance, gain):
    """Correct state and covariance, in place, by one measurement of a state (Bierman 1977, ch. 5).

    Args:
        x: state (n,), updated.
        factors: factors of its covariance (n, n), updated.
        index: index of the measured state.
        measured: measured value of that state.
        variance: variance of the measurement, above zero.
        gain: scratch (n,).

    Returns:
        The squared innovation divided by its variance: chi-square with one degree of freedom.
    """
    n = factors.shape[0]
    expected = variance
    inverse = 1.0 / variance
    for i in range(n):
        gain[i] = 0.0
    for j in range(index, n):
        f = 1.0 if j == index else factors[j, index]
        d = factors[j, j]
        g = d * f
        slope = -f * inverse
        before = expected
        expected = fma(f, g, before)
        inverse = 1.0 / expected
        factors[j, j] = d * before * inverse
        for i in range(j):
            u = factors[j, i]
            factors[j, i] = fma(slope, gain[i], u)
            gain[i] = fma(g, u, gain[i])
        gain[j] = g
    innovation = measured - x[index]
    step = innovation * inverse
    for i in range(n):
        x[i] = fma(gain[i], step, x[i])
    return innovation * step


@inlined
def forget(factors, index, variance, vector):
    """Give one state a new variance without correlation to the others, in place.

    The covariance of the other states does not change. `vector` is scratch (n,).
    """
    weight = factors[index, index]
    for i in range(index):
        vector[i] = factors[index, i]
        factors[index, i] = 0.0
    factors[index, index] = variance
    for j in range(index + 1, factors.shape[0]):
        factors[j, index] = 0.0
    # The column's contribution to the covariance of the states before it is added back.
    add_rank_one(factors, index, vector, weight)


@njit(cache=True, error_model="numpy", forceinline=True)
def orthogonalise(rows, weights, factors, size):
    """Write the factors of W D W^T to the leading (size, size) part of `factors`.

    The method is modified weighted Gram-Schmidt (Thornton 1976).

    Args:
        rows: W (size, columns), overwritten.
        weights: diagonal of D (columns,), none negative.
        factors: array (n, n) whose leading part is overwritten.
        size: number of rows of W.
    """
    columns = rows.shape[1]
    for j in range(size - 1, -1, -1):
        total = 0.0
        for k in range(columns):
            total = fma(rows[j, k] * weights[k], rows[j, k], total)
        factors[j, j] = total
        inverse = select(total > 0.0, 1.0 / total, 0.0)
        for i in range(j):
            product = 0.0
            for k in range(columns):
                product = fma(rows[i, k], rows[j, k] * weights[k], product)
            u = product * inverse
            factors[j, i] = u
            for k in range(columns):
                rows[i, k] = fma(-u, rows[j, k], rows[i, k])
