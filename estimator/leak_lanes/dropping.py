"""The search for a drop of the supply pressure in compiled code, as `SupplyTest` makes it.

That code inverts a matrix of five unknowns for each onset. Here the three unknowns that are the
same for all onsets are eliminated once, and two are left for each onset.
"""

from math import sqrt
from typing import Final

import numpy as np

from estimator.leaks import SIGNS, SUPPLY_SIGMA
from rig.jit import njit
from rig.plant import inner

from .sizing import lasting

_CONSTANT: Final = 3
"""Number of unknowns that do not depend on the onset; they come first in a row."""


@inner
def _inverse_of_three(matrix):
    """Return the inverse of a symmetric positive definite matrix (3, 3), by its cofactors."""
    a, b, c = matrix[0, 0], matrix[0, 1], matrix[0, 2]
    d, e, f = matrix[1, 1], matrix[1, 2], matrix[2, 2]
    found = np.empty((3, 3))
    found[0, 0] = d * f - e * e
    found[0, 1] = found[1, 0] = c * e - b * f
    found[0, 2] = found[2, 0] = b * e - c * d
    found[1, 1] = a * f - c * c
    found[1, 2] = found[2, 1] = b * c - a * e
    found[2, 2] = a * d - b * b
    determinant = a * found[0, 0] + b * found[0, 1] + c * found[0, 2]
    return found / determinant


@njit(cache=True, error_model="numpy", nogil=True)
def searched(rows, before, later, first, end, blocks, settings):
    """Return the likeliest drop of the supply pressure.

    Args:
        rows: rows of the blocks that are kept, oldest first, (n, 4).
        before: products of older rows before a found drop, (4, 4).
        later: products of older rows since it, (4, 4).
        first: index of the earliest onset that is tried.
        end: index after the latest one.
        blocks: number of blocks.
        settings: `SupplyTest.settings`.

    Returns:
        Whether the pressure dropped at all, the onset's index, the drop, its standard error, both
        in Pa, the statistic, and the factor by which noise raises the variance.
    """
    noise, weight, most_rounds, converged, unit, wander, proportional, droop, model_error = settings
    count = rows.shape[0]
    since = np.zeros((count + 1, 4, 4))
    for j in range(count - 1, -1, -1):
        for a in range(4):
            for b in range(4):
                since[j, a, b] = since[j + 1, a, b] + rows[j, a] * rows[j, b]
    total = before + later + since[0]
    for j in range(count):
        since[j] += later
    variance, best = noise, first
    falls = False
    u, w = np.zeros(_CONSTANT), np.zeros(2)
    spread_of_drop, explained_best = 0.0, 0.0
    for _ in range(int(most_rounds)):
        inverse = np.empty((_CONSTANT, _CONSTANT))
        for a in range(_CONSTANT):
            for b in range(_CONSTANT):
                inverse[a, b] = total[a, b] / variance
            inverse[a, a] += 1.0
        inverse = _inverse_of_three(inverse)
        alone = np.zeros(_CONSTANT)
        base = 0.0
        for a in range(_CONSTANT):
            for b in range(_CONSTANT):
                alone[a] += inverse[a, b] * total[b, 3] / variance
            base += alone[a] * total[a, 3] / variance
        explained_best, explained_first, falls = -np.inf, 0.0, False
        for j in range(first, end):
            at = since[j]
            crossed = np.empty((_CONSTANT, 2))
            carried = np.zeros((_CONSTANT, 2))
            for a in range(_CONSTANT):
                for e in range(2):
                    crossed[a, e] = at[a, e] * SIGNS[e] / variance
            for a in range(_CONSTANT):
                for e in range(2):
                    for b in range(_CONSTANT):
                        carried[a, e] += inverse[a, b] * crossed[b, e]
            s00 = at[0, 0] * SIGNS[0] * SIGNS[0] / variance + SUPPLY_SIGMA * SUPPLY_SIGMA
            s01 = at[0, 1] * SIGNS[0] * SIGNS[1] / variance
            s11 = at[1, 1] * SIGNS[1] * SIGNS[1] / variance + 1.0
            r0 = at[0, 3] * SIGNS[0] / variance
            r1 = at[1, 3] * SIGNS[1] / variance
            for a in range(_CONSTANT):
                s00 -= crossed[a, 0] * carried[a, 0]
                s01 -= crossed[a, 0] * carried[a, 1]
                s11 -= crossed[a, 1] * carried[a, 1]
                r0 -= crossed[a, 0] * alone[a]
                r1 -= crossed[a, 1] * alone[a]
            determinant = s00 * s11 - s01 * s01
            d = (s11 * r0 - s01 * r1) / determinant
            e = (s00 * r1 - s01 * r0) / determinant
            of_e = -SIGNS[1] * unit * at[0, 1] / at[0, 0]
            explained = base + r0 * d + r1 * e
            if j == first:
                explained_first = explained
            if unit * d + of_e * e > 0.0 and explained > explained_best:
                falls, best, explained_best = True, j, explained
                w[0], w[1] = d, e
                for a in range(_CONSTANT):
                    u[a] = alone[a] - carried[a, 0] * d - carried[a, 1] * e
                spread_of_drop = (
                    unit * unit * s11 - 2.0 * unit * of_e * s01 + of_e * of_e * s00
                ) / determinant
        if not falls:
            best, explained_best = first, explained_first
        left = weight * noise + total[3, 3] - explained_best * variance
        before = variance
        variance = left / (weight + blocks)
        if abs(variance - before) < converged * variance:
            break
    failed = False, 0, 0.0, 0.0, 0.0, 0.0
    if not falls:
        return failed
    at = since[best]
    drop = unit * w[0] - SIGNS[1] * unit * at[0, 1] / at[0, 0] * w[1]
    left_over = np.empty((count, 1))
    power = 0.0
    for j in range(count):
        value = rows[j, 3]
        for a in range(_CONSTANT):
            value -= rows[j, a] * u[a]
        if j >= best:
            value -= rows[j, 0] * SIGNS[0] * w[0] + rows[j, 1] * SIGNS[1] * w[1]
            power += value * value
        left_over[j, 0] = value
    uneven = power / (count - best - 2) / variance
    spread = max(uneven, 1.0) * lasting(left_over, model_error)
    deviation = sqrt(spread_of_drop * spread)
    earlier = total - at
    slope = (at[0, 1] / at[0, 0] - earlier[0, 1] / earlier[0, 0]) * unit
    change = (at[0, 2] / at[0, 0] - earlier[0, 2] / earlier[0, 0]) * unit
    dead = wander + proportional * abs(slope * u[1]) + droop * abs(change * u[2])
    statistic = (drop - model_error * dead) / deviation
    return True, best, drop, deviation, statistic, spread
