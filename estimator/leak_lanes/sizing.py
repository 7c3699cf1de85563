"""Sizes of sudden faults in compiled code, as `FaultSizes.sudden` estimates them.

The code reads the blocks themselves where that function reads their sums between marks. It can
therefore only be used while every block has its mark and is still kept: for the first two minutes.
"""

from math import sqrt
from typing import Final

import numpy as np

from estimator.accounts import (
    MOST_LASTING,
    MOST_LEVERAGE,
    NUISANCE_COUNT,
    SHIFT,
    Places,
    normal_equations,
)
from estimator.leaks import GREAT_FLOW, SETTLING_BLOCKS, WITNESSES
from rig.jit import njit
from rig.plant import inner

from .scoring import factor, invert_factor

_N: Final = NUISANCE_COUNT
_SIZE, _SECONDS, _BLOCKS = Places.SIZES, Places.SECONDS, Places.BLOCKS
_LEAST_PIVOT: Final = 1e-13
"""Least diagonal element of the Cholesky factor of a normal matrix that is scaled to ones on its
diagonal. A smaller one means that the columns depend on one another up to round-off."""


@njit(cache=True, error_model="numpy", nogil=True)
def _since(total, before, mark, place):
    return total[place] - before[mark, place] if mark < before.shape[0] else 0.0


@inner
def _joint_fit(total, before, faults, marks, variance, stretches, inverse, fitted):
    """Fit all nuisances and some faults together, as `JointFit` does; return whether that is sound.

    Args:
        total: packed sums over all blocks, (width,).
        before: packed sums before each mark, (marks, width).
        faults: indices of the faults, or `SHIFT`, int64 (f,).
        marks: mark at which each of them begins, int64 (f,).
        variance: noise variance, in units of the expected noise.
        stretches: first and end mark of each stretch that is passed over, int64 (s, 2).
        inverse: is filled with the inverse of the normal matrix, (n + f, n + f).
        fitted: is filled with the sizes of nuisances and faults, (n + f,).
    """
    size = _N + faults.size
    normal, right = normal_equations(total, before, faults, marks, stretches, variance)
    scale = np.empty(size)
    for a in range(size):
        if not normal[a, a] > 0.0:
            return False
        scale[a] = 1.0 / sqrt(normal[a, a])
    for a in range(size):
        for b in range(size):
            normal[a, b] *= scale[a] * scale[b]
    lower, inverted = np.empty((size, size)), np.empty((size, size))
    factor(normal, 0.0, lower)
    for a in range(size):
        if not lower[a, a] > _LEAST_PIVOT:
            return False
    invert_factor(lower, inverted)
    for a in range(size):
        for b in range(size):
            inverse[a, b] = 0.0
    for c in range(size):
        for a in range(c + 1):
            part = inverted[c, a]
            for b in range(c + 1):
                inverse[a, b] += part * inverted[c, b]
    for a in range(size):
        fitted[a] = 0.0
        for b in range(size):
            inverse[a, b] *= scale[a] * scale[b]
            fitted[a] += inverse[a, b] * right[b]
    return True


@njit(cache=True, error_model="numpy", nogil=True)
def _influences(blocks, faults, marks, inverse, fitted, stretches, influence, leverage):
    """Fill in each block's influence on the last coefficient, and its leverage, (blocks,) each.

    Args:
        blocks: missing flow (blocks, 2), nuisances (blocks, 2, n) and faults (blocks, 2, 6) of all
            blocks, in units of the expected noise.
        faults: as for `_joint_fit`.
        marks: as for `_joint_fit`.
        inverse: from `_joint_fit`.
        fitted: from `_joint_fit`.
        stretches: as for `_joint_fit`.
        influence: is filled.
        leverage: is filled.
    """
    missing, nuisances, shapes = blocks
    size = fitted.size
    direction = inverse[size - 1]
    for j in range(influence.size):
        influence[j] = leverage[j] = 0.0
        for c in range(2):
            along, left = 0.0, missing[j, c]
            for a in range(_N):
                along += direction[a] * nuisances[j, c, a]
                left -= fitted[a] * nuisances[j, c, a]
            for i in range(faults.size):
                if marks[i] <= j:
                    along += direction[_N + i] * shapes[j, c, faults[i]]
                    left -= fitted[_N + i] * shapes[j, c, faults[i]]
            influence[j] += along * left
            leverage[j] += along * along
        leverage[j] = min(max(leverage[j] / direction[size - 1], 0.0), MOST_LEVERAGE)
    for s in range(stretches.shape[0]):
        for j in range(stretches[s, 0], stretches[s, 1]):
            influence[j] = leverage[j] = 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def lasting(left, model_error):
    """Return `lasting_noise` of residuals (n, k), oldest block first."""
    power, both = 0.0, 0.0
    count, width = left.shape
    for j in range(count):
        for c in range(width):
            power += left[j, c] * left[j, c]
            if j:
                both += left[j, c] * left[j - 1, c]
    if power == 0.0:
        return 1.0
    rho = both / power + 2.0 * model_error / sqrt(float(count * width))
    rho = min(max(rho, 0.0), MOST_LASTING)
    return (1.0 + rho) / (1.0 - rho)


@inner
def _lasting_of_fit(blocks, count, faults, marks, fitted, model_error):
    missing, nuisances, shapes = blocks
    left = np.empty((count, 2))
    for j in range(count):
        for c in range(2):
            value = missing[j, c]
            for a in range(_N):
                value -= fitted[a] * nuisances[j, c, a]
            for i in range(faults.size):
                if marks[i] <= j:
                    value -= fitted[_N + i] * shapes[j, c, faults[i]]
            left[j, c] = value
    return lasting(left, model_error)


@inner
def _began_before(blocks, faults, marks, fitted):
    """Return `JointFit.began_before` where every block has its mark."""
    missing, nuisances, shapes = blocks
    last = faults.size - 1
    j = marks[last] - 1
    part, whole = 0.0, 0.0
    for c in range(2):
        own = fitted[_N + last] * shapes[j, c, faults[last]]
        left = missing[j, c]
        for a in range(_N):
            left -= fitted[a] * nuisances[j, c, a]
        for i in range(faults.size):
            if marks[i] <= j:
                left -= fitted[_N + i] * shapes[j, c, faults[i]]
        part += own * left
        whole += own * own
    return min(max(part / whole, 0.0), 1.0) if whole > 0.0 else 0.0


@inner
def _around(marks, last, after):
    """Return `joint_fit.around` of marks as an array, int64 (s, 2)."""
    # Compiling numpy's sort takes as long as all the rest.
    ordered = marks.copy()
    for k in range(1, ordered.size):
        for i in range(k, 0, -1):
            if ordered[i - 1] > ordered[i]:
                ordered[i - 1], ordered[i] = ordered[i], ordered[i - 1]
    stretches = np.empty((marks.size, 2), np.int64)
    count = 0
    for k in range(ordered.size):
        if k and ordered[k] == ordered[k - 1]:
            continue
        first, end = max(ordered[k] - 1, 0), min(ordered[k] + after, last)
        if count and first <= stretches[count - 1, 1]:
            stretches[count - 1, 1] = max(stretches[count - 1, 1], end)
            continue
        stretches[count, 0], stretches[count, 1] = first, end
        count += 1
    return stretches[:count].copy()


@njit(cache=True, error_model="numpy", nogil=True)
def sized(total, before, blocks, fault, mark, other, other_mark, dead_zone, variance, model_error):
    """Size a sudden fault that begins at a mark.

    Args:
        total: packed sums over all blocks, (width,).
        before: packed sums before each mark, (marks, width); every block has its mark.
        blocks: as for `_influences`.
        fault: index of the fault.
        mark: mark at which it begins.
        other: index of another fault that is fitted along; negative without one.
        other_mark: mark at which the other fault begins.
        dead_zone: flow in L/min that must be exceeded.
        variance: noise variance, in units of the expected noise.
        model_error: factor on what is allowed for errors of the model.

    Returns:
        Whether the columns are independent (else the rest is of no use), the coefficient, its
        standard error, the statistic, the factor by which lasting noise raises the variance, and
        the part of the block before the mark in which the fault was already present.
    """
    count = before.shape[0]
    if other < 0:
        faults, marks = np.array([SHIFT, fault]), np.array([mark, mark])
    else:
        faults, marks = np.array([SHIFT, other, fault]), np.array([mark, other_mark, mark])
    width = _N + faults.size
    again = other == fault
    size = _since(total, before, mark, _SIZE + fault) / _since(total, before, mark, _SECONDS)
    seen = _since(total, before, mark, _BLOCKS)
    if again and other_mark < count:
        seen -= _since(total, before, other_mark, _BLOCKS)
    after = 1
    settling = np.empty((0, 2), np.int64)
    inverse, fitted = np.empty((width, width)), np.empty(width)
    failed = False, 0.0, 0.0, 0.0, 0.0, 0.0
    if not _joint_fit(total, before, faults, marks, variance, settling, inverse, fitted):
        return failed
    if size * fitted[width - 1] > GREAT_FLOW and seen >= 2 * WITNESSES:
        after = SETTLING_BLOCKS
        settling = np.array([[mark, mark + after]])
        if not _joint_fit(total, before, faults, marks, variance, settling, inverse, fitted):
            return failed
    influence, leverage = np.empty(count), np.empty(count)
    _influences(blocks, faults, marks, inverse, fitted, settling, influence, leverage)
    error = variance * inverse[width - 1, width - 1]
    coefficient = fitted[width - 1]

    # The fault may change its size after each third of its time, as growth must not count as noise.
    long = count - mark
    more, since = faults, marks
    if long >= 3 * WITNESSES:
        more, since = np.empty(faults.size + 2, np.int64), np.empty(faults.size + 2, np.int64)
        more[:2] = fault
        since[0], since[1] = mark + long // 3, mark + 2 * long // 3
        more[2:], since[2:] = faults, marks
    wide = _N + more.size
    inverse_2, fitted_2 = np.empty((wide, wide)), np.empty(wide)
    if not _joint_fit(total, before, more, since, variance, settling, inverse_2, fitted_2):
        return failed
    factor_of_noise = _lasting_of_fit(blocks, count, more, since, fitted_2, model_error)

    total_share = 0.0
    for j in range(count):
        total_share += influence[j] * influence[j] / (1.0 - leverage[j])
    dead = dead_zone / size
    statistic = np.inf
    for j in range(count):
        kept = 1.0 - leverage[j]
        rest = coefficient - influence[j] / kept
        uneven = total_share - influence[j] * influence[j] / kept
        deviation = sqrt(max(error, uneven) / kept * factor_of_noise)
        statistic = min(statistic, (rest - dead) / deviation)

    straddling = _around(marks, count, after)
    if again and straddling.shape[0] == 1:
        straddling = settling
    if not _joint_fit(total, before, faults, marks, variance, straddling, inverse, fitted):
        return failed
    _influences(blocks, faults, marks, inverse, fitted, straddling, influence, leverage)
    uneven = 0.0
    for j in range(count):
        uneven += influence[j] * influence[j] / (1.0 - leverage[j])
    error = variance * inverse[width - 1, width - 1]
    began = _began_before(blocks, faults, marks, fitted) if mark else 0.0
    deviation = sqrt(max(error, uneven) * factor_of_noise)
    return True, fitted[width - 1], deviation, statistic, factor_of_noise, began
