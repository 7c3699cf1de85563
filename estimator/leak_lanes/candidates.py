"""Scores every fault from every onset in one compiled call, as `score_faults` does."""

from math import log1p
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    FAULT_COUNT,
    NOISE_WEIGHT,
    NUISANCE_COUNT,
    AccountSums,
    FaultProducts,
    Places,
    Regression,
    Scores,
)
from estimator.leaks import SETTLED_PART, WITNESSES, Candidates, Finding
from rig.jit import njit

from .scoring import fit_nuisances, nuisance_belief, score

Array = NDArray[np.float64]

_N: Final = NUISANCE_COUNT
_SHAPES: Final = FAULT_COUNT + 1
_ROUNDS: Final = 3
_FF, _FY, _YY = Places.SQUARES, Places.PRODUCTS, Places.MISSING
_LL, _LF, _LY = Places.FAULT_SQUARES, Places.FAULT_CROSSED, Places.FAULT_PRODUCTS
_SIZE, _SECONDS, _BLOCKS = Places.SIZES, Places.SECONDS, Places.BLOCKS


class CompiledRegression(Regression):
    """The regression of the missing flow on the nuisances, which compiled code has made.

    Args:
        variance: the estimated noise variance.
        freedom: degrees of freedom of the noise variance once one further column is fitted.
        belief: most likely sizes of the nuisances, float64 (m,), and their covariance, (m, m).
    """

    def __init__(self, variance: float, freedom: float, belief: tuple[Array, Array]) -> None:
        self.variance, self.freedom = variance, freedom
        self._belief = belief

    def nuisances(self) -> tuple[Array, Array]:
        """Return the nuisances' most likely sizes (m,) and their covariance (m, m)."""
        return self._belief


@njit(cache=True, error_model="numpy", nogil=True)
def _scored(total, before, blocks, least, fault, mark, unit):
    """Score all faults from all marks on.

    Args:
        total: packed sums over all blocks, (width,), as in `estimator.accounts.sums`.
        before: packed sums before each mark, (marks, width).
        blocks: number of blocks.
        least: lower bound of the noise variance.
        fault: index of the known fault; negative without one.
        mark: index of the mark at which the known fault begins.
        unit: prior standard deviation of the known fault's coefficient, SI.

    Returns:
        Variance and freedom; the nuisances' mean and covariance; products of the faults with each
        other, with nuisances and with missing flow; their sizes and numbers of blocks; the scores;
        usable; and the gain of every candidate, usable or not.
    """
    marks = before.shape[0]
    m = _N + 1 if fault >= 0 else _N
    squares = np.empty((marks, _SHAPES, _SHAPES))
    crossed = np.empty((marks, _SHAPES, m))
    products = np.empty((marks, _SHAPES))
    sizes = np.empty((marks, FAULT_COUNT))
    number = np.empty(marks)
    for j in range(marks):
        at = before[j]
        for i in range(_SHAPES):
            products[j, i] = total[_LY + i] - at[_LY + i]
            for k in range(_SHAPES):
                place = _LL + i * _SHAPES + k
                squares[j, i, k] = total[place] - at[place]
            for a in range(_N):
                place = _LF + i * _N + a
                crossed[j, i, a] = total[place] - at[place]
        seconds = total[_SECONDS] - at[_SECONDS]
        for i in range(FAULT_COUNT):
            sizes[j, i] = (total[_SIZE + i] - at[_SIZE + i]) / seconds
        number[j] = total[_BLOCKS] - at[_BLOCKS]
    ff, fy = np.empty((m, m)), np.empty(m)
    for a in range(_N):
        fy[a] = total[_FY + a]
        for b in range(_N):
            ff[a, b] = total[_FF + a * _N + b]
    if fault >= 0:
        for a in range(_N):
            ff[_N, a] = ff[a, _N] = unit * crossed[mark, fault, a]
        ff[_N, _N] = unit * unit * squares[mark, fault, fault]
        fy[_N] = unit * products[mark, fault]
        for j in range(marks):
            later = max(j, mark)
            for i in range(_SHAPES):
                crossed[j, i, _N] = unit * squares[later, i, fault]
    lower, inverse = np.empty((m, m)), np.empty((m, m))
    variance, used = fit_nuisances(ff, fy, total[_YY], 2.0 * blocks, least, lower, inverse)
    freedom = NOISE_WEIGHT + 2.0 * blocks - used - 1.0
    mean, covariance = nuisance_belief(ff, fy, variance)
    scores = np.empty((4, marks, FAULT_COUNT))
    usable = np.empty((marks, FAULT_COUNT), np.bool_)
    weighed = variance
    for _ in range(_ROUNDS):
        score(crossed, squares, products, ff, fy, total[_YY], freedom, weighed, least, scores)
        left = weighed
        for j in range(marks):
            for i in range(FAULT_COUNT):
                visible = sizes[j, i] > 0.0 and number[j] >= WITNESSES and i != fault
                usable[j, i] = visible and scores[0, j, i] > 0.0
                if usable[j, i]:
                    left = min(left, scores[3, j, i])
        if left > SETTLED_PART * weighed:
            break
        weighed = left
    gain = np.empty((marks, FAULT_COUNT))
    for j in range(marks):
        for i in range(FAULT_COUNT):
            gain[j, i] = freedom * log1p(scores[2, j, i] / (freedom * scores[3, j, i]))
    return (
        variance, freedom, mean, covariance, squares, crossed, products, sizes, number, scores,
        usable, gain,
    )  # fmt: skip


def compiled_candidates(
    sums: AccountSums, least: float, beside: Finding | None = None
) -> Candidates:
    """Return the scores of every fault from every mark on, as `score_faults` does.

    Args:
        sums: sums over the blocks so far.
        least: lower bound of the estimated noise variance.
        beside: a known fault, fitted along with each candidate; None to score candidates alone.
    """
    total, before = sums.packed
    known = (-1, 0, 0.0)
    if beside is not None:
        known = beside.fault, sums.mark_of(beside.onset), 100.0 * beside.coefficient
    (
        variance, freedom, mean, covariance, squares, crossed, products, sizes, blocks, scores,
        usable, gain,
    ) = _scored(total, before, sums.blocks, least, *known)  # fmt: skip
    change = earlier = np.zeros(blocks.size)
    if beside is not None:
        fault, mark, _ = known
        testable = (np.arange(change.size) > mark) & (blocks >= WITNESSES)
        change = np.where(testable, gain[:, fault], 0.0)
        there = (blocks >= blocks[mark] + WITNESSES) & (scores[0, :, fault] > 0.0)
        earlier = np.where(there, gain[:, fault], 0.0)
    return Candidates(
        CompiledRegression(variance, freedom, (mean, covariance)),
        FaultProducts(squares, crossed[:, :, :_N], products, sizes, blocks),
        Scores(*scores),
        usable,
        np.where(usable, gain, 0.0),
        change,
        earlier,
    )
