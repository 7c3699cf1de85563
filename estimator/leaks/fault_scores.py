"""How well each fault from each onset on explains the accounts, alone or beside one found."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import AccountSums, FaultProducts, Regression, Scores

from .finding import Finding

Array = NDArray[np.float64]

WITNESSES: Final = 4
"""Blocks that must speak for a fault: from fewer, their spread cannot be told."""
_SETTLED_PART: Final = 0.8
"""Noise that a fault explains this much of was mostly that fault: it is estimated anew."""


@dataclass(frozen=True)
class Candidates:
    """Every fault from every mark on.

    Attributes:
        regression: of the missing flow on nuisances, and on the fault that was found, if any.
        products: sums of the faults' products since each mark.
        scores: what each fault would do for the regression.
        usable: bool (marks, 5), whether it can be told at all.
        gain: float64 (marks, 5), its gain in twice the log likelihood; 0 where it is not usable.
        change: float64 (marks,), that of a change of the fault beside which these are.
        before: float64 (marks,), that of the same fault having begun before, where what these are
            beside is its end.
    """

    regression: Regression
    products: FaultProducts
    scores: Scores
    usable: NDArray[np.bool_]
    gain: Array
    change: Array
    before: Array


def score_faults(sums: AccountSums, least: float, beside: Finding | None = None) -> Candidates:
    """Score every fault from every mark on.

    Args:
        sums: the blocks.
        least: noise variance that is believed at least.
        beside: a fault that was found, which the others are scored beside.
    """
    products = sums.faults_since()
    ff, fy, yy = sums.nuisances()
    crossed = products.crossed
    visible = (products.sizes > 0.0) & (products.blocks >= WITNESSES)[:, None]
    mark = 0 if beside is None else sums.mark_of(beside.onset)
    if beside is not None:
        ff, fy, crossed = _fault_as_nuisance(beside, mark, products, ff, fy)
        visible[:, beside.fault] = False
    regression = Regression(ff, fy, yy, 2 * sums.blocks, least)
    variance = regression.variance
    for _ in range(3):
        scores = regression.score(crossed, products, variance)
        usable = visible & (scores.coefficient > 0.0)
        left = scores.variance.min(where=usable, initial=variance)
        if left > _SETTLED_PART * variance:
            break
        variance = float(left)
    freedom = regression.freedom
    gain = freedom * np.log1p(scores.explained / (freedom * scores.variance))
    change = before = np.zeros(products.blocks.size)
    if beside is not None:
        later = np.arange(change.size) > mark
        told = later & (products.blocks >= WITNESSES)
        change = np.where(told, gain[:, beside.fault], 0.0)
        there = products.blocks >= products.blocks[mark] + WITNESSES
        there &= scores.coefficient[:, beside.fault] > 0.0
        before = np.where(there, gain[:, beside.fault], 0.0)
    return Candidates(
        regression, products, scores, usable, np.where(usable, gain, 0.0), change, before
    )


def _fault_as_nuisance(
    finding: Finding, mark: int, products: FaultProducts, ff: Array, fy: Array
) -> tuple[Array, Array, Array]:
    """Return products of nuisances of which a fault found is one more.

    Its prior is a hundred times what was found, which is as good as none.

    Returns:
        Its products with n nuisances (n + 1, n + 1), with missing flow (n + 1,), with faults
        (marks, 5, n + 1).
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
