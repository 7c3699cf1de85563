"""Scores every fault from every onset in one compiled call, as `score_faults` does."""

from functools import cached_property
from math import exp, log, log1p, pi, sqrt
from typing import Final, NamedTuple

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
from estimator.leaks import RIVAL_GAIN, SETTLED_PART, WITNESSES, Candidates, Finding
from rig.jit import njit

from .scoring import first_nuisance, fit_nuisances, nuisance_belief, score

Array = NDArray[np.float64]

_N: Final = NUISANCE_COUNT
_SHAPES: Final = FAULT_COUNT + 1
_ROUNDS: Final = 3
_FF, _FY, _YY = Places.SQUARES, Places.PRODUCTS, Places.MISSING
_LL, _LF, _LY = Places.FAULT_SQUARES, Places.FAULT_CROSSED, Places.FAULT_PRODUCTS
_SIZE, _SECONDS, _BLOCKS = Places.SIZES, Places.SECONDS, Places.BLOCKS


class Scored(NamedTuple):
    """Scores of all candidates as compiled code returns them."""

    variance: float
    """Noise variance that the nuisances, and a known fault, leave."""
    freedom: float
    """Degrees of freedom of the noise variance once one further column is fitted."""
    null_bias: tuple[float, float]
    """Most likely size of the spool's null bias in its tolerances, and its variance."""
    most: float
    """Greatest gain of a usable candidate in twice the log likelihood."""
    changed: float
    """Greatest gain of a change of the known fault's own size; 0 without a known fault."""
    ff: Array
    """Products of the nuisances, and a known fault, with each other, (m, m)."""
    fy: Array
    """Their products with the missing flow, (m,)."""
    squares: Array
    """Products of the faults and the null's shift with each other, (marks, 6, 6)."""
    crossed: Array
    """Their products with the nuisances, and a known fault, (m, 6, marks)."""
    products: Array
    """Their products with the missing flow, (marks, 6)."""
    sizes: Array
    """Mean absolute flow of each fault per unit coefficient, L/min, (marks, 5)."""
    blocks: Array
    """Number of blocks since each mark, (marks,)."""
    scores: Array
    """The fields of `Scores`, (4, marks, 5)."""
    usable: NDArray[np.bool_]
    """Which candidates are usable, (marks, 5), as in `Candidates`."""
    gain: Array
    """Gain of every candidate, usable or not, (marks, 5)."""


class CompiledRegression(Regression):
    """The regression of the missing flow on the nuisances, which compiled code has made."""

    def __init__(self, scored: Scored) -> None:
        self.variance, self.freedom = scored.variance, scored.freedom
        self._scored = scored

    def nuisances(self) -> tuple[Array, Array]:
        """Return the nuisances' most likely sizes (m,) and their covariance (m, m)."""
        scored = self._scored
        mean, covariance = nuisance_belief(scored.ff, scored.fy, self.variance)
        return mean, covariance


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
        The fields of `Scored`.
    """
    marks = before.shape[0]
    m = _N + 1 if fault >= 0 else _N
    squares = np.empty((marks, _SHAPES, _SHAPES))
    crossed = np.empty((m, _SHAPES, marks))
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
                crossed[a, i, j] = total[place] - at[place]
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
            ff[_N, a] = ff[a, _N] = unit * crossed[a, fault, mark]
        ff[_N, _N] = unit * unit * squares[mark, fault, fault]
        fy[_N] = unit * products[mark, fault]
        for j in range(marks):
            later = max(j, mark)
            for i in range(_SHAPES):
                crossed[_N, i, j] = unit * squares[later, i, fault]
    variance, used = fit_nuisances(ff, fy, total[_YY], 2.0 * blocks, least)
    freedom = NOISE_WEIGHT + 2.0 * blocks - used - 1.0
    null_bias = first_nuisance(ff, fy, variance)
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
    most = changed = 0.0
    for j in range(marks):
        for i in range(FAULT_COUNT):
            gain[j, i] = freedom * log1p(scores[2, j, i] / (freedom * scores[3, j, i]))
            if usable[j, i]:
                most = max(most, gain[j, i])
        if fault >= 0 and j > mark and number[j] >= WITNESSES:
            changed = max(changed, gain[j, fault])
    return (
        variance, freedom, null_bias, most, changed, ff, fy, squares, crossed, products, sizes,
        number, scores, usable, gain,
    )  # fmt: skip


@njit(cache=True, error_model="numpy", nogil=True)
def standing_out(scores, sizes, usable, gain, most, limit, dead_zone):
    """Return the greatest gain of each fault among its candidates that stand out, and its mark.

    As in `LeakTest`, a candidate stands out if its coefficient is surely above the dead zone and no
    other cause explains far more.

    Args:
        scores: as in `Scored`.
        sizes: as in `Scored`.
        usable: as in `Scored`.
        gain: as in `Scored`.
        most: greatest gain of any usable candidate, and of a change of a known fault.
        limit: value that the statistic must exceed.
        dead_zone: flow in L/min that each fault must exceed, (5,).

    Returns:
        The gains, 0 where no candidate stands out, and the marks, (5,) each.
    """
    greatest, marks = np.zeros(FAULT_COUNT), np.zeros(FAULT_COUNT, np.int64)
    for j in range(sizes.shape[0]):
        for i in range(FAULT_COUNT):
            if usable[j, i] and gain[j, i] >= most - RIVAL_GAIN and gain[j, i] > greatest[i]:
                error = scores[3, j, i] / scores[1, j, i]
                if scores[0, j, i] > limit * sqrt(error) + dead_zone[i] / sizes[j, i]:
                    greatest[i], marks[i] = gain[j, i], j
    return greatest, marks


@njit(cache=True, error_model="numpy", nogil=True)
def log_evidence(scores, sizes, usable, dead_zone, lasting, greatest_flow):
    """Return `LeakTest.log_evidence`, (5,).

    Args:
        scores: as in `Scored`.
        sizes: as in `Scored`.
        usable: as in `Scored`.
        dead_zone: flow in L/min that each fault must exceed, (5,).
        lasting: as for `LeakTest.log_evidence`.
        greatest_flow: as for `LeakTest.log_evidence`.
    """
    found = np.full(FAULT_COUNT, -np.inf)
    for i in range(FAULT_COUNT):
        for j in range(sizes.shape[0]):
            if usable[j, i]:
                error = sqrt(scores[3, j, i] * lasting / scores[1, j, i])
                surplus = max(scores[0, j, i] - dead_zone[i] / sizes[j, i], 0.0) / error
                width = log(sqrt(2.0 * pi) / greatest_flow * sizes[j, i] * error)
                one = 0.5 * surplus * surplus + min(width, 0.0)
                above, below = max(found[i], one), min(found[i], one)
                found[i] = above + log1p(exp(below - above))
    return found


def scored_blocks(sums: AccountSums, least: float, beside: Finding | None) -> Scored:
    """Return the scores of every fault from every mark on.

    Args:
        sums: sums over the blocks so far.
        least: lower bound of the estimated noise variance.
        beside: a known fault, fitted along with each candidate; None to score candidates alone.
    """
    total, before = sums.packed
    known = (-1, 0, 0.0)
    if beside is not None:
        known = beside.fault, sums.mark_of(beside.onset), 100.0 * beside.coefficient
    return Scored(*_scored(total, before, sums.blocks, least, *known))


class CompiledCandidates(Candidates):
    """Scores as `LeakTest` takes them; the gains, which are rarely asked for, are made when needed.

    Args:
        scored: the scores.
        known: index and mark of the known fault; None without one.
    """

    def __init__(self, scored: Scored, known: tuple[int, int] | None) -> None:
        crossed = scored.crossed[:NUISANCE_COUNT].T
        self.__dict__.update(
            regression=CompiledRegression(scored),
            products=FaultProducts(
                scored.squares, crossed, scored.products, scored.sizes, scored.blocks
            ),
            scores=Scores(*scored.scores),
            usable=scored.usable,
            _scored=scored,
            _known=known,
        )

    @cached_property
    def gain(self) -> Array:
        """Return the gain of each candidate, 0 where it is not usable, (marks, 5)."""
        scored: Scored = self.__dict__["_scored"]
        return np.where(scored.usable, scored.gain, 0.0)

    @cached_property
    def change(self) -> Array:
        """Return the gain of a change of the known fault at each mark, (marks,)."""
        scored, known = self.__dict__["_scored"], self.__dict__["_known"]
        if known is None:
            return np.zeros(scored.blocks.size)
        fault, mark = known
        testable = (np.arange(scored.blocks.size) > mark) & (scored.blocks >= WITNESSES)
        return np.where(testable, scored.gain[:, fault], 0.0)

    @cached_property
    def before(self) -> Array:
        """Return the gain of a fault of the known one's kind that began earlier, (marks,)."""
        scored, known = self.__dict__["_scored"], self.__dict__["_known"]
        if known is None:
            return np.zeros(scored.blocks.size)
        fault, mark = known
        there = (scored.blocks >= scored.blocks[mark] + WITNESSES) & (
            scored.scores[0, :, fault] > 0.0
        )
        return np.where(there, scored.gain[:, fault], 0.0)
