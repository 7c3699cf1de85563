"""Scores of all faults from all onsets, in compiled code: one call for each block and rig.

The results are those of `estimator.accounts.regression` up to round-off. That module diagonalises
the products of the nuisances, F'F; here F'F + v I is factored by Cholesky anew for each noise
variance v, which takes less time, as the matrix is small and a few variances settle it. With
L L' that matrix and w = L^-1 c for each column c, the scores follow from products of the w. The
noise variance itself is found in axes in which F'F is tridiagonal, where a variance is tried in
a time that is proportional to the number of nuisances.
"""

from math import sqrt
from typing import Final

import numpy as np

from estimator.accounts import LEAST_INFORMATION, NOISE_WEIGHT, NULL_SHIFT
from rig.jit import njit
from rig.plant import inner

_ROUNDS: Final = 100
_SETTLED: Final = 1e-4
_TOGETHER: Final = 16
"""Number of onsets whose columns are solved together; these fit the processor's first cache."""


@njit(cache=True, error_model="numpy", nogil=True)
def factor(matrix, variance, lower):
    """Fill `lower` (m, m) with the Cholesky factor of a matrix (m, m) plus a variance times one."""
    m = matrix.shape[0]
    for i in range(m):
        for j in range(i + 1):
            lower[i, j] = matrix[i, j]
        lower[i, i] += variance
    for j in range(m):
        root = sqrt(lower[j, j])
        lower[j, j] = root
        for i in range(j + 1, m):
            lower[i, j] /= root
        for i in range(j + 1, m):
            part = lower[i, j]
            for k in range(j + 1, i + 1):
                lower[i, k] -= part * lower[k, j]


@inner
def invert_factor(lower, inverse):
    """Fill `inverse` (m, m) with the inverse of a lower triangular matrix."""
    m = lower.shape[0]
    for i in range(m):
        for k in range(m):
            inverse[i, k] = 0.0
        inverse[i, i] = 1.0
        for j in range(i):
            part = lower[i, j]
            for k in range(j + 1):
                inverse[i, k] -= part * inverse[j, k]
        scale = 1.0 / lower[i, i]
        for k in range(i + 1):
            inverse[i, k] *= scale


@inner
def tridiagonalised(matrix, vector):
    """Return a symmetric matrix in axes in which it is tridiagonal, and a vector in these axes.

    The axes follow from Householder's reflections (Golub and Van Loan 2013, section 8.3.1).

    Args:
        matrix: (m, m); overwritten.
        vector: (m,); overwritten by the vector in the new axes.

    Returns:
        The diagonal, (m,), and the elements beside it, (m - 1,).
    """
    m = vector.size
    diagonal, beside = np.empty(m), np.empty(m - 1)
    axis, change = np.empty(m), np.empty(m)
    for k in range(m - 2):
        length = 0.0
        for i in range(k + 1, m):
            axis[i] = matrix[i, k]
            length += axis[i] * axis[i]
        length = sqrt(length)
        diagonal[k] = matrix[k, k]
        beside[k] = -length if axis[k + 1] >= 0.0 else length
        axis[k + 1] -= beside[k]
        square, along = 0.0, 0.0
        for i in range(k + 1, m):
            square += axis[i] * axis[i]
            along += axis[i] * vector[i]
        if square == 0.0:
            continue
        scale = 2.0 / square
        for i in range(k + 1, m):
            vector[i] -= scale * along * axis[i]
            change[i] = 0.0
        for j in range(k + 1, m):
            part = scale * axis[j]
            for i in range(k + 1, m):
                change[i] += part * matrix[j, i]
        middle = 0.0
        for i in range(k + 1, m):
            middle += axis[i] * change[i]
        middle *= 0.5 * scale
        for i in range(k + 1, m):
            change[i] -= middle * axis[i]
        for j in range(k + 1, m):
            of_axis, of_change = axis[j], change[j]
            for i in range(k + 1, m):
                matrix[j, i] -= of_axis * change[i] + of_change * axis[i]
    diagonal[m - 2], diagonal[m - 1] = matrix[m - 2, m - 2], matrix[m - 1, m - 1]
    beside[m - 2] = matrix[m - 1, m - 2]
    return diagonal, beside


@njit(cache=True, error_model="numpy", nogil=True)
def fit_nuisances(squares, products, total, count, least):
    """Estimate the noise variance, as `regression._noise_variance` does.

    Args:
        squares: F'F, (m, m).
        products: F'y, (m,).
        total: y'y.
        count: number of values in y.
        least: lower bound of the variance.

    Returns:
        The variance, and the degrees of freedom that F takes.
    """
    m = products.size
    vector = products.copy()
    diagonal, beside = tridiagonalised(squares.copy(), vector)
    variance = 1.0
    used = 0.0
    # Pivots of T + v I from its first row on and from its last row on; T is tridiagonal.
    down, up, sizes = np.empty(m), np.empty(m), np.empty(m)
    for _ in range(_ROUNDS):
        down[0] = diagonal[0] + variance
        sizes[0] = vector[0]
        for i in range(1, m):
            ratio = beside[i - 1] / down[i - 1]
            down[i] = diagonal[i] + variance - ratio * beside[i - 1]
            sizes[i] = vector[i] - ratio * sizes[i - 1]
        up[m - 1] = diagonal[m - 1] + variance
        sizes[m - 1] /= down[m - 1]
        trace = 1.0 / down[m - 1]
        for i in range(m - 2, -1, -1):
            up[i] = diagonal[i] + variance - beside[i] * beside[i] / up[i + 1]
            sizes[i] = (sizes[i] - beside[i] * sizes[i + 1]) / down[i]
            trace += 1.0 / (down[i] + up[i] - diagonal[i] - variance)
        explained = 0.0
        again = 0.0
        for i in range(m):
            explained += sizes[i] * vector[i]
            again += sizes[i] * sizes[i]
        used = m - variance * trace
        residual = total - explained - variance * again
        estimate = max((NOISE_WEIGHT + residual) / (NOISE_WEIGHT + count - used), least)
        settled = abs(estimate - variance) < _SETTLED * variance
        variance = estimate
        if settled:
            break
    return variance, used


@njit(cache=True, error_model="numpy", nogil=True)
def first_nuisance(squares, products, variance):
    """Return the most likely size of the first nuisance, and its variance."""
    m = products.size
    lower = np.empty((m, m))
    factor(squares, variance, lower)
    white, unit = np.empty(m), np.empty(m)
    mean, square = 0.0, 0.0
    for i in range(m):
        white[i] = products[i]
        unit[i] = 1.0 if i == 0 else 0.0
        for j in range(i):
            white[i] -= lower[i, j] * white[j]
            unit[i] -= lower[i, j] * unit[j]
        white[i] /= lower[i, i]
        unit[i] /= lower[i, i]
        mean += unit[i] * white[i]
        square += unit[i] * unit[i]
    return mean, variance * square


@njit(cache=True, error_model="numpy", nogil=True)
def nuisance_belief(squares, products, variance):
    """Return the nuisances' most likely sizes (m,) and their covariance (m, m)."""
    m = products.size
    lower, inverse = np.empty((m, m)), np.empty((m, m))
    factor(squares, variance, lower)
    invert_factor(lower, inverse)
    mean, covariance = np.zeros(m), np.zeros((m, m))
    for c in range(m):
        for a in range(c + 1):
            part = variance * inverse[c, a]
            for b in range(c + 1):
                covariance[a, b] += part * inverse[c, b]
    for a in range(m):
        for b in range(m):
            mean[a] += covariance[a, b] * products[b]
        mean[a] /= variance
    return mean, covariance


@njit(cache=True, error_model="numpy", nogil=True)
def score(crossed, squares, products, ff, fy, total, freedom, variance, least, out):
    """Fill `out` with the fields of `regression.Scores`, (4, marks, faults).

    Args:
        crossed: products of F with faults and null shift, (m, faults + 1, marks). Marks come last,
            as they are what the innermost loops run along.
        squares: products of faults and shift with each other, (marks, faults + 1, faults + 1).
        products: products of faults and shift with y, (marks, faults + 1).
        ff: F'F, (m, m).
        fy: F'y, (m,).
        total: y'y.
        freedom: degrees of freedom of the noise variance that is left.
        variance: noise variance by which nuisances are weighed against noise.
        least: lower bound of the noise variance that is left.
        out: (4, marks, faults), filled.
    """
    m, marks, shapes = fy.size, products.shape[0], products.shape[1]
    faults = shapes - 1
    lower = np.empty((m, m))
    factor(ff, variance, lower)
    white = np.empty(m)
    weighted = total
    for i in range(m):
        part = fy[i]
        for j in range(i):
            part -= lower[i, j] * white[j]
        white[i] = part / lower[i, i]
        weighted -= white[i] * white[i]
    prior = variance / (NULL_SHIFT * NULL_SHIFT)
    columns = np.empty((m, shapes * _TOGETHER))
    left = np.empty((m, faults * _TOGETHER))
    own, with_y = np.empty(shapes * _TOGETHER), np.empty(shapes * _TOGETHER)
    with_shift, shifted = np.empty(shapes * _TOGETHER), np.empty(faults * _TOGETHER)
    sizes, beliefs = np.empty(faults * _TOGETHER), np.empty(faults * _TOGETHER)
    for first in range(0, marks, _TOGETHER):
        # Column i of the onset with index k is at q = i count + k.
        count = min(_TOGETHER, marks - first)
        width, fault_width = shapes * count, faults * count
        for i in range(shapes):
            for k in range(count):
                q = i * count + k
                own[q] = squares[first + k, i, i]
                with_y[q] = products[first + k, i]
                with_shift[q] = squares[first + k, i, faults]
        for a in range(m):
            for i in range(shapes):
                # Slices begin where they begin: an index that might be negative is no vector's.
                here, there = columns[a, i * count : (i + 1) * count], crossed[a, i, first:]
                for k in range(count):
                    here[k] = there[k]
        for a in range(m):
            here = columns[a]
            for b in range(a):
                part, there = lower[a, b], columns[b]
                for q in range(width):
                    here[q] -= part * there[q]
            scale, of_y, shift_here = 1.0 / lower[a, a], white[a], here[fault_width:]
            for q in range(width):
                here[q] *= scale
                own[q] -= here[q] * here[q]
                with_y[q] -= here[q] * of_y
            for i in range(shapes):
                own_here, crossing = here[i * count :], with_shift[i * count :]
                for k in range(count):
                    crossing[k] -= own_here[k] * shift_here[k]
        for i in range(faults):
            for k in range(count):
                q, mark = i * count + k, first + k
                shift_square = own[fault_width + k] + prior
                alone = with_y[fault_width + k] / shift_square
                crossing = with_shift[q]
                information = own[q] - crossing * crossing / shift_square
                projection = with_y[q] - crossing * alone
                known = information > LEAST_INFORMATION * squares[mark, i, i]
                coefficient = projection / information if known else 0.0
                out[0, mark, i] = coefficient
                out[1, mark, i] = information if known else 0.0
                out[2, mark, i] = coefficient * projection
                sizes[q] = coefficient
                shifted[q] = alone - coefficient * crossing / shift_square
                beliefs[q] = prior / variance * shifted[q] * shifted[q]
        for a in range(m):
            here, there, of_y = left[a], columns[a], white[a]
            for i in range(faults):
                for k in range(count):
                    q = i * count + k
                    here[q] = of_y - sizes[q] * there[q] - shifted[q] * there[fault_width + k]
        # What is left, in the axes of F: the sizes of the nuisances beside the fault.
        for at in range(m):
            a = m - 1 - at
            here = left[a]
            for b in range(a + 1, m):
                part, there = lower[b, a], left[b]
                for q in range(fault_width):
                    here[q] -= part * there[q]
            scale = 1.0 / lower[a, a]
            for q in range(fault_width):
                here[q] *= scale
                beliefs[q] += here[q] * here[q]
        for i in range(faults):
            for k in range(count):
                q, mark = i * count + k, first + k
                if out[1, mark, i] == 0.0:
                    out[3, mark, i] = variance
                    continue
                of_shift = with_y[fault_width + k]
                explained = of_shift / (own[fault_width + k] + prior) * of_shift + out[2, mark, i]
                residual = weighted - explained - variance * beliefs[q]
                out[3, mark, i] = max((NOISE_WEIGHT + residual) / freedom, least)
