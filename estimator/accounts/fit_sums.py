"""Compiled pieces of the joint fit: its normal equations, and the weights of sums over blocks.

They are short sums over few columns, of which a search makes thousands. All products are those of
the packed sums, whose order is that of `Places`.
"""

from math import sqrt
from typing import Final

import numpy as np

from rig.jit import njit
from rig.plant import inner

from .nuisances import NUISANCE_COUNT, NULL_SHIFT
from .sums import SHAPE_COUNT, SHIFT, WIDTH, Places

_N: Final = NUISANCE_COUNT
_M: Final = SHAPE_COUNT
_FF, _FY = Places.SQUARES, Places.PRODUCTS
_LL, _LF, _LY = Places.FAULT_SQUARES, Places.FAULT_CROSSED, Places.FAULT_PRODUCTS


@njit(cache=True, error_model="numpy")
def _counted(total, before, place, mark, passed_over):
    """Return a sum from a mark on, without the blocks that are passed over."""
    marks = before.shape[0]
    counted = total[place] - before[mark, place] if mark < marks else 0.0
    for k in range(passed_over.shape[0]):
        first, last = max(mark, passed_over[k, 0]), max(mark, passed_over[k, 1])
        if first < marks:
            counted -= total[place] - before[first, place]
        if last < marks:
            counted += total[place] - before[last, place]
    return counted


@inner
def _of_all(total, before, place, passed_over):
    """Return a sum over all blocks but those that are passed over."""
    marks = before.shape[0]
    counted = total[place]
    for k in range(passed_over.shape[0]):
        first, last = passed_over[k, 0], passed_over[k, 1]
        counted -= total[place] if last == marks else before[last, place]
        counted += total[place] if first == marks else before[first, place]
    return counted


@njit(cache=True, error_model="numpy")
def normal_equations(total, before, faults, marks, passed_over, variance):
    """Return matrix and right side of the normal equations of nuisances and faults.

    Args:
        total: packed sums over all blocks, (width,).
        before: packed sums before each mark, (marks, width).
        faults: index of each fault, or `SHIFT`, int64 (faults,).
        marks: mark at which each begins, int64 (faults,).
        passed_over: pairs of marks; the blocks between those of a pair do not count, int64 (s, 2).
        variance: noise variance, by which what is known beforehand is weighed.

    Returns:
        Float64 (n + faults, n + faults) and (n + faults,), the nuisances first.
    """
    width = _N + faults.size
    matrix, right = np.empty((width, width)), np.empty(width)
    for a in range(_N):
        right[a] = _of_all(total, before, _FY + a, passed_over)
        for b in range(_N):
            matrix[a, b] = _of_all(total, before, _FF + a * _N + b, passed_over)
        matrix[a, a] += variance
    for c in range(faults.size):
        i, since = faults[c], marks[c]
        right[_N + c] = _counted(total, before, _LY + i, since, passed_over)
        for a in range(_N):
            crossed = _counted(total, before, _LF + i * _N + a, since, passed_over)
            matrix[_N + c, a] = matrix[a, _N + c] = crossed
        for d in range(faults.size):
            both = max(since, marks[d])
            place = _LL + i * _M + faults[d]
            matrix[_N + c, _N + d] = _counted(total, before, place, both, passed_over)
        if i == SHIFT:
            matrix[_N + c, _N + c] += variance / NULL_SHIFT**2
    return matrix, right


@njit(cache=True, error_model="numpy")
def balanced(normal):
    """Return a normal matrix with ones on its diagonal, and the scales of its columns.

    A column of zeros has a scale of one, and only its one on the diagonal.
    """
    size = normal.shape[0]
    scale, scaled = np.ones(size), normal.copy()
    for i in range(size):
        if normal[i, i] > 0.0:
            scale[i] = 1.0 / sqrt(normal[i, i])
        else:
            scaled[i, i] = 1.0
    for i in range(size):
        for j in range(size):
            scaled[i, j] = scale[i] * scaled[i, j] * scale[j]
    return scaled, scale


@njit(cache=True, error_model="numpy")
def acting(vector, marks, mark):
    """Return a vector of all columns with 0 for the faults that begin after a mark."""
    found = vector.copy()
    for c in range(marks.size):
        if marks[c] > mark:
            found[_N + c] = 0.0
    return found


@inner
def product_weights(left, faults):
    """Return weights (width,) with which the packed sums add up to left' X'y.

    The columns of X are the nuisances and the given faults, int64 (faults,); `left` is float64
    (n + faults,), and y is the missing flow.
    """
    weights = np.zeros(WIDTH)
    for a in range(_N):
        weights[_FY + a] = left[a]
    for c in range(faults.size):
        weights[_LY + faults[c]] += left[_N + c]
    return weights


@inner
def square_weights(left, right, faults):
    """Return weights (width,) with which the packed sums add up to left' X'X right.

    The columns of X are the nuisances and the given faults, int64 (faults,); `left` and `right` are
    float64 (n + faults,).
    """
    weights = np.zeros(WIDTH)
    for a in range(_N):
        for b in range(_N):
            weights[_FF + a * _N + b] = left[a] * right[b]
    for c in range(faults.size):
        at = _LF + faults[c] * _N
        for a in range(_N):
            weights[at + a] += left[_N + c] * right[a] + right[_N + c] * left[a]
        for d in range(faults.size):
            weights[_LL + faults[c] * _M + faults[d]] += left[_N + c] * right[_N + d]
    return weights


@njit(cache=True, error_model="numpy")
def influence_weights(left, right, faults, divisor):
    """Return weights (width, 2) of left' X'(y - X right) and of left' X'X left over a divisor."""
    squares = square_weights(left, left, faults)
    of_right = square_weights(left, right, faults)
    products = product_weights(left, faults)
    weights = np.empty((WIDTH, 2))
    for k in range(WIDTH):
        weights[k, 0] = products[k] - of_right[k]
        weights[k, 1] = squares[k] / divisor
    return weights


def compile_fits() -> None:
    """Compile what a joint fit needs, on tiny inputs; see `rig.runner.campaign.compiled_pieces`."""
    total, before = np.zeros(WIDTH), np.zeros((1, WIDTH))
    ones, none = np.zeros(1, dtype=np.int64), np.empty((0, 2), dtype=np.int64)
    matrix, right = normal_equations(total, before, ones, ones, none, 1.0)
    balanced(matrix)
    influence_weights(acting(right, ones, 0), right, ones, 1.0)
