"""Scores: how well each fault from each onset explains the accounts, alone or beside another."""

from dataclasses import dataclass
from math import log1p
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import AccountSums, FaultProducts, Intervals, Regression, Scores

from .finding import Finding

Array = NDArray[np.float64]

WITNESSES: Final = 4
"""Fewest blocks with a fault from which it is claimed; the spread of fewer says too little."""
RIVAL_GAIN: Final = 20.0
"""Gain in twice the log likelihood by which another cause must win to be preferred (odds e^10)."""
SETTLED_PART: Final = 0.8
"""If a fault leaves less than this part of the noise variance, the variance is estimated anew.

The noise was then largely the fault itself."""


_ROUNDED: Final = 1.0 - 1e-9
"""Factor that takes more from a gain than rounding does."""


def least_gain(freedom: float, limit: float) -> float:
    """Return the gain below which no candidate's statistic can exceed a limit.

    A statistic t means a gain in twice the log likelihood of f log(1 + t^2 / f) or more: that much
    without a dead zone. So a greatest gain below the result shows that no fault is sure.

    Args:
        freedom: degrees of freedom f of the noise variance.
        limit: what the statistic must exceed.
    """
    return freedom * log1p(max(limit, 0.0) ** 2 / freedom) * _ROUNDED


@dataclass(frozen=True)
class Candidates:
    """Scores of all candidates: each fault, beginning at each mark.

    A candidate is scored alone, or beside a fault that was found before (the known fault). Index i
    of the marks stands for an onset at mark i; index j of the faults is that of `FAULTS`.

    Attributes:
        regression: the regression of the missing flow on the nuisances and on the known fault.
        products: sums of the faults' products since each mark.
        scores: what each candidate would explain in the regression.
        usable: bool (marks, 5), whether `WITNESSES` blocks or more follow the mark, the fault would
            make a flow in them, its coefficient is positive, and it is not the known fault.
        gain: float64 (marks, 5), gain of the candidate in twice the log likelihood; 0 where it is
            not usable.
        change: float64 (marks,), gain of a change of the known fault's own size at the mark; 0 up
            to its onset and in the last blocks, and 0 everywhere without a known fault.
        before: float64 (marks,), gain of a fault of the known fault's kind that began at the mark,
            `WITNESSES` blocks or more before the known fault; 0 elsewhere and without a known
            fault. It finds a leak that has ended: a known fault is then placed at its end.
    """

    regression: Regression
    products: FaultProducts
    scores: Scores
    usable: NDArray[np.bool_]
    gain: Array
    change: Array
    before: Array


def score_faults(sums: AccountSums, least: float, beside: Finding | None = None) -> Candidates:
    """Return the scores of every fault from every mark on.

    Args:
        sums: sums over the blocks so far.
        least: lower bound of the estimated noise variance.
        beside: a known fault, fitted along with each candidate; None to score candidates alone.
    """
    products = sums.faults_since()
    ff, fy, yy = sums.nuisances()
    crossed = products.crossed
    visible = (products.sizes > 0.0) & (products.blocks >= WITNESSES)[:, None]
    mark = 0 if beside is None else sums.mark_of(beside.onset)
    if beside is not None:
        if beside.ramp is None:
            ff, fy, crossed = _fault_as_nuisance(beside, mark, products, ff, fy)
        else:
            ff, fy, crossed = _growth_as_nuisance(beside, sums, products, ff, fy)
        visible[:, beside.fault] = False
    regression = Regression(ff, fy, yy, 2 * sums.blocks, least)
    scores, usable, gain = gains_of(regression, crossed, products, visible)
    change = before = np.zeros(products.blocks.size)
    if beside is not None:
        later = np.arange(change.size) > mark
        testable = later & (products.blocks >= WITNESSES)
        change = np.where(testable, gain[:, beside.fault], 0.0)
        there = products.blocks >= products.blocks[mark] + WITNESSES
        there &= scores.coefficient[:, beside.fault] > 0.0
        before = np.where(there, gain[:, beside.fault], 0.0)
    return Candidates(
        regression, products, scores, usable, np.where(usable, gain, 0.0), change, before
    )


def gains_of(
    regression: Regression,
    crossed: Array,
    products: FaultProducts,
    visible: NDArray[np.bool_],
) -> tuple[Scores, NDArray[np.bool_], Array]:
    """Return scores, usable candidates, and each candidate's gain in twice the log likelihood.

    All are (candidates, faults). A candidate is usable if it is visible and its coefficient is
    positive. If usable candidates leave much less noise, the variance is estimated anew.

    Args:
        regression: the regression of the missing flow on the nuisances.
        crossed: products of faults and null shift with these nuisances.
        products: products of faults and null shift with each other and with the missing flow.
        visible: which candidates show at all.
    """
    variance = regression.variance
    for _ in range(3):
        scores = regression.score(crossed, products, variance)
        usable = visible & (scores.coefficient > 0.0)
        left = scores.variance.min(where=usable, initial=variance)
        if left > SETTLED_PART * variance:
            break
        variance = float(left)
    freedom = regression.freedom
    return scores, usable, freedom * np.log1p(scores.explained / (freedom * scores.variance))


def _fault_as_nuisance(
    finding: Finding, mark: int, products: FaultProducts, ff: Array, fy: Array
) -> tuple[Array, Array, Array]:
    """Return products of the n nuisances with the found fault appended as nuisance n + 1.

    The fault's prior standard deviation is a hundred times its coefficient, which is as good as
    no prior.

    Args:
        finding: the fault that was found.
        mark: the mark at which it begins.
        products: sums of the faults' products since each mark.
        ff: products of the nuisances with each other, (n, n).
        fy: products of the nuisances with the missing flow, (n,).

    Returns:
        The products of these n + 1 columns with each other (n + 1, n + 1), with the missing flow
        (n + 1,), and with the faults and the null shift (marks, 6, n + 1).
    """
    i, unit = finding.fault, 100.0 * finding.coefficient
    n = fy.size
    squares = np.empty((n + 1, n + 1))
    squares[:n, :n] = ff
    squares[n, :n] = squares[:n, n] = unit * products.crossed[mark, i]
    squares[n, n] = unit**2 * products.squares[mark, i, i]
    later = np.maximum(np.arange(products.blocks.size), mark)
    crossed = np.concatenate([products.crossed, unit * products.squares[later, :, i, None]], axis=2)
    return squares, np.append(fy, unit * products.products[mark, i]), crossed


def _growth_as_nuisance(
    finding: Finding, sums: AccountSums, products: FaultProducts, ff: Array, fy: Array
) -> tuple[Array, Array, Array]:
    """Return what `_fault_as_nuisance` returns, for a fault that grows.

    Args:
        finding: the fault that was found; it must have a `ramp`.
        sums: sums over the blocks so far.
        products: sums of the faults' products since each mark.
        ff: products of the nuisances with each other, (n, n).
        fy: products of the nuisances with the missing flow, (n,).
    """
    assert finding.ramp is not None
    i, unit, n = finding.fault, 100.0 * finding.coefficient, fy.size
    intervals = Intervals(sums)
    level = unit * intervals.level(finding.ramp)
    squares = np.empty((n + 1, n + 1))
    squares[:n, :n] = ff
    squares[n, :n] = squares[:n, n] = level @ intervals.crossed[:, i]
    squares[n, n] = level**2 @ intervals.squares[:, i, i]
    each = level[:, None] * intervals.squares[:, :, i]
    since = np.cumsum(each[::-1], axis=0)[::-1]
    crossed = np.concatenate([products.crossed, since[:, :, None]], axis=2)
    return squares, np.append(fy, level @ intervals.products[:, i]), crossed
