"""The explanations of accounts that change again and again, followed side by side, compiled.

An explanation has one signature with one coefficient, which is there in some blocks and not in
others. It is in one of three states in each block: the coefficient is absent (SHUT), present for a
part of the block (CHANGING), or present throughout (OPEN). The state is a Markov chain; from each
state a mean of the nuisances is kept, and where paths meet again their means are averaged by their
weights (the interacting multiple model, Blom and Bar-Shalom 1988). All explanations share the
covariance of the nuisances, which does not depend on the missing flows.

The weight of an explanation is the statistic of Shiryaev and Roberts: the sum, over all blocks at
which it may have begun, of the likelihood ratio of its prediction to that of a healthy rig.
"""

from math import exp, log, pi
from typing import Final

import numpy as np

from estimator.accounts import NOISE_WEIGHT
from rig.jit import njit
from rig.plant import inner

SHUT: Final = 0
CHANGING: Final = 1
OPEN: Final = 2

OPENS: Final = 0.1
"""Chance that a shut leak opens in a block of 0.5 s, and that an open one shuts: some 5 s of each.

A leak that opens and shuts at another pace costs evidence: 2.3 for each change, 0.1 a block."""
SHUTS_AT_ONCE: Final = 0.3
"""Chance that a leak which opens in a block is shut again in the next one: it was open for less
than two blocks."""
DRIFT_OF_A_BLOCK: Final = 7.5e-6
"""Variance by which each nuisance wanders in a block, in squares of its tolerance.

It is `estimator.accounts.DRIFT` (0.03 of the tolerance) in a minute: 0.03^2 / 120 blocks."""
_PRIOR_SPREAD: Final = 0.35
"""Standard deviation of a coefficient before any data, as a part of the level it begins with.

The levels are a factor of 2.5 apart, so that each flow is within 1.6 standard deviations of one."""
_LAW: Final = 0.05
"""Part of a leak's flow by which the leak law may be wrong (`RELATIVE_DEAD_ZONE`)."""
_LEAST_PART: Final = 0.3
"""Part of its level to which an explanation's coefficient may fall; another level does the rest."""
_MOST: Final = 1e200
"""Upper bound of a weight, so that it can be stored."""

TURNS: Final = np.array(
    [
        [1.0 - OPENS, OPENS, 0.0],
        [SHUTS_AT_ONCE, 0.0, 1.0 - SHUTS_AT_ONCE],
        [0.0, OPENS, 1.0 - OPENS],
    ]
)
"""Chances of the next state (column) after a state (row), if the explanation comes and goes."""
_STAYS: Final = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 1.0]])
"""The same for an explanation that stays once it has begun."""


@njit(cache=True, error_model="numpy")
def product(a0, a1, b0, b1, c):
    """Return a' C^-1 b for vectors of two values; `c` has C's entries 00, 01 and 11."""
    det = c[0] * c[2] - c[1] * c[1]
    return (a0 * b0 * c[2] - (a0 * b1 + a1 * b0) * c[1] + a1 * b1 * c[0]) / det


@inner
def log_density(square, freedom, variance, c):
    """Return the logarithm of Student's density in two dimensions, with scale `variance` x C.

    `square` is r' C^-1 r of the residual r, and `c` has C's entries 00, 01 and 11.
    """
    det = c[0] * c[2] - c[1] * c[1]
    spread = np.log1p(square / (variance * freedom))
    return -log(2.0 * pi * variance) - 0.5 * log(det) - 0.5 * (freedom + 2.0) * spread


@njit(cache=True, error_model="numpy")
def shared_gain(nuisances, covariance):
    """Return gain (n, 2) and covariance entries (3,) of a block; update the nuisances' covariance.

    All are in units of the noise variance: the missing flow of a block has the covariance
    C = I + F P F' about its prediction.

    Args:
        nuisances: F, float64 (2, n).
        covariance: P, float64 (n, n); it grows by the drift of a block and shrinks by what the
            block tells.
    """
    n = covariance.shape[0]
    crossed = np.zeros((n, 2))
    for i in range(n):
        covariance[i, i] += DRIFT_OF_A_BLOCK
    for i in range(n):
        for k in range(n):
            crossed[i, 0] += covariance[i, k] * nuisances[0, k]
            crossed[i, 1] += covariance[i, k] * nuisances[1, k]
    c = np.array([1.0, 0.0, 1.0])
    for i in range(n):
        c[0] += nuisances[0, i] * crossed[i, 0]
        c[1] += nuisances[0, i] * crossed[i, 1]
        c[2] += nuisances[1, i] * crossed[i, 1]
    det = c[0] * c[2] - c[1] * c[1]
    gain = np.empty((n, 2))
    for i in range(n):
        gain[i, 0] = (crossed[i, 0] * c[2] - crossed[i, 1] * c[1]) / det
        gain[i, 1] = (crossed[i, 1] * c[0] - crossed[i, 0] * c[1]) / det
    for i in range(n):
        for k in range(n):
            covariance[i, k] -= gain[i, 0] * crossed[k, 0] + gain[i, 1] * crossed[k, 1]
    return gain, c


@inner
def _residual(missing, nuisances, mean):
    first, second = missing[0], missing[1]
    for i in range(mean.size):
        first -= nuisances[0, i] * mean[i]
        second -= nuisances[1, i] * mean[i]
    return first, second


@njit(cache=True, error_model="numpy")
def follow(block, gain, c, healthy, setting, levels, weights, means, sizes, squares):
    """Let all explanations take a block, and the healthy rig's prediction too.

    Args:
        block: missing flow (2,), nuisances (2, n), signatures (2, m), and the signatures of 1 L/min
            (2, m), in units of the expected noise.
        gain: gain of the nuisances, (n, 2), from `shared_gain`.
        c: entries 00, 01 and 11 of the covariance of the missing flow.
        healthy: mean of the nuisances (n,), and (4,): the sum of squares of the healthy rig's
            residuals, the number of values in the sums of squares, the sum of products of residuals
            in successive blocks, and what forgetting leaves of the sums in a block. All but the
            last are updated.
        setting: least noise variance, greatest gain in log likelihood that one block may give, and
            the factor on all gains that lasting noise leaves.
        levels: float64 (h, 4): index of the signature, coefficient that it begins with, dead zone
            in L/min, and 1 if it stays once it has begun.
        weights: float64 (h, 3) by explanation and state, updated.
        means: float64 (h, 3, n) of the nuisances, updated.
        sizes: float64 (h, 2): coefficient and its information, updated.
        squares: float64 (h,): sums of squares of the residuals, updated.
    """
    missing, nuisances, shapes, unit_flows = block
    mean, sums = healthy
    least, most_gain, tempering = setting
    n = mean.size
    freedom = NOISE_WEIGHT + sums[1]
    bare0, bare1 = _residual(missing, nuisances, mean)
    variance = max(sums[0] / freedom, least)
    square = product(bare0, bare1, bare0, bare1, c)
    plain = log_density(square, freedom, variance, c)
    merged, state = np.empty((3, n)), np.empty(3)
    residuals, spread = np.empty((3, 3)), np.empty(3)
    count = levels.shape[0]
    for h in range(count):
        of, begins = int(levels[h, 0]), levels[h, 1]
        turns = _STAYS if levels[h, 3] != 0.0 else TURNS
        s0, s1 = shapes[0, of], shapes[1, of]
        # What a healthy rig's model may be wrong by counts for the healthy rig.
        lenient = plain
        if levels[h, 2] > 0.0:
            d0, d1 = unit_flows[0, of], unit_flows[1, of]
            along = product(d0, d1, d0, d1, c)
            if along > 0.0:
                off = product(d0, d1, bare0, bare1, c) / along
                off = min(max(off, -levels[h, 2]), levels[h, 2])
                left0, left1 = bare0 - off * d0, bare1 - off * d1
                lenient = log_density(product(left0, left1, left0, left1, c), freedom, variance, c)
        # The explanation may begin in this block, as the healthy rig is up to now.
        before = weights[h, 0] + weights[h, 1] + weights[h, 2]
        fresh = 1.0 / (before + 1.0)
        own = (1.0 - fresh) * squares[h] + fresh * sums[0]
        size = (1.0 - fresh) * sizes[h, 0] + fresh * begins
        information = (1.0 - fresh) * sizes[h, 1] + fresh / (_PRIOR_SPREAD * begins) ** 2
        information = min(information, 1.0 / (_LAW * size) ** 2)
        own_variance = max(own / freedom, least)
        total = 0.0
        learnt, pulled = 0.0, 0.0
        for s in range(3):
            weight = 1.0 if s == CHANGING else 0.0
            for i in range(n):
                merged[s, i] = weight * mean[i]
            for u in range(3):
                part = weights[h, u] * turns[u, s]
                if part > 0.0:
                    weight += part
                    for i in range(n):
                        merged[s, i] += part * means[h, u, i]
            if weight > 0.0:
                for i in range(n):
                    merged[s, i] /= weight
            else:
                merged[s] = mean
            r0, r1 = _residual(missing, nuisances, merged[s])
            wide, present = 0.0, 0.0
            if s == OPEN:
                wide, present = 1.0 / information, 1.0
            elif s == CHANGING:
                # The coefficient is there for a part of the block that may be any.
                wide, present = 0.25 / information + size * size / 12.0, 0.5
            r0 -= present * size * s0
            r1 -= present * size * s1
            wide /= own_variance
            spread[0] = c[0] + wide * s0 * s0
            spread[1] = c[1] + wide * s0 * s1
            spread[2] = c[2] + wide * s1 * s1
            residuals[s, 0], residuals[s, 1] = r0, r1
            residuals[s, 2] = product(r0, r1, r0, r1, spread)
            likely = log_density(residuals[s, 2], freedom, own_variance, spread)
            ratio = tempering * (likely - (plain if s == SHUT else lenient))
            state[s] = weight * exp(min(ratio, most_gain))
            total += state[s]
            if s == OPEN:
                learnt = product(s0, s1, s0, s1, c) / own_variance
                pulled = product(s0, s1, r0, r1, c) / own_variance
        expected = 0.0
        for s in range(3):
            share = state[s] / total if total > 0.0 else 0.0
            expected += share * residuals[s, 2]
            weights[h, s] = share * min(total, _MOST)
            # A block in which the coefficient is there for a part tells nothing of the nuisances.
            for i in range(n):
                means[h, s, i] = merged[s, i]
                if s != CHANGING:
                    means[h, s, i] += gain[i, 0] * residuals[s, 0] + gain[i, 1] * residuals[s, 1]
        there = state[OPEN] / total if total > 0.0 else 0.0
        sizes[h, 1] = information + there * learnt
        size += there * pulled / sizes[h, 1]
        smallest = _LEAST_PART * begins
        sizes[h, 0] = max(size, smallest) if begins > 0.0 else min(size, smallest)
        squares[h] = NOISE_WEIGHT + (own - NOISE_WEIGHT) * sums[3] + expected
    for i in range(n):
        mean[i] += gain[i, 0] * bare0 + gain[i, 1] * bare1
    sums[0] = NOISE_WEIGHT + (sums[0] - NOISE_WEIGHT) * sums[3] + square
    sums[1] = sums[1] * sums[3] + 2.0
