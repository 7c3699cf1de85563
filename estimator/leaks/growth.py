"""The test for leaks that grow over minutes, which no single onset explains.

The blocks so far are divided into stretches of time. The leak's coefficient may differ from stretch
to stretch, and so may the spool's null, which wanders too. The growth of the leak since the first
stretch is tested like the coefficient of a sudden leak: the surplus over the dead zone is compared
with its standard error.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    SHIFT,
    AccountSums,
    FaultProducts,
    JointFit,
    RecentBlocks,
    lasting_noise,
    least_variance,
)
from rig.plant import LEAKS

Array = NDArray[np.float64]

STRETCHES: Final = 8
"""Number of stretches of time, each with a coefficient of its own."""
LEAST_BLOCKS: Final = 120
"""Fewest blocks for this test: one minute, so that a stretch lasts at least seven seconds."""


@dataclass(frozen=True)
class Growth:
    """How much a leak has grown in each stretch, with the standard error of the last growth.

    Attributes:
        fault: index into `FAULTS`.
        marks: mark at which each stretch but the first begins, int64 (stretches - 1,).
        levels: coefficient in each of these stretches less that in the first one, SI units,
            float64 (stretches - 1,).
        deviation: standard error of the last of the levels.
        explained: reduction of the weighted sum of squares by nuisances, leak and null shifts.
    """

    fault: int
    marks: NDArray[np.int64]
    levels: Array
    deviation: float
    explained: float


def stretches(sums: AccountSums) -> NDArray[np.int64]:
    """Return the marks that divide the blocks so far into stretches of about equal length.

    Returns:
        int64, increasing, at most `STRETCHES` - 1 marks. In a run of more than half an hour the
        early marks are sparse, so that some stretches merge and there are fewer.
    """
    blocks = np.arange(1, STRETCHES) * sums.blocks // STRETCHES
    return np.unique([sums.mark_of(int(block)) for block in blocks])


def growths(
    sums: AccountSums,
    products: FaultProducts,
    recent: RecentBlocks,
    variance: float,
    model_error: float = 1.0,
) -> list[Growth]:
    """Return the growth of each leak if it were the only fault, likeliest leak first.

    Args:
        sums: sums over the blocks, at least `LEAST_BLOCKS` of them.
        products: `AccountSums.faults_since` of these sums.
        recent: the latest blocks, which show whether noise lasts from block to block.
        variance: noise variance if there were no leak; it is estimated anew where the fit leaves
            less than half or more than twice of it.
        model_error: factor on what is allowed for errors of the model.
    """
    marks = stretches(sums)
    _, _, total = sums.nuisances()
    found = []
    for fault in range(len(LEAKS)):
        shapes = [SHIFT] * marks.size + [fault] * marks.size
        fit = JointFit(sums, products, shapes, [*marks, *marks], variance)
        # The residual, with the priors of the nuisances counted in, gives the noise variance anew.
        left = (total - fit.explained) / (2 * sums.blocks - marks.size)
        if not 0.5 < left / variance < 2.0:
            left = max(left, least_variance(model_error))
            fit = JointFit(sums, products, shapes, [*marks, *marks], left)
        onsets = [int(sums.mark_blocks[mark]) for mark in (*marks, *marks)]
        present = list(zip(shapes, onsets, fit.coefficients, strict=True))
        lasting = lasting_noise(recent.residuals(fit.nuisances, present), model_error)
        levels = np.cumsum(fit.coefficients[marks.size :])
        deviation = sqrt(fit.error_of_sum(marks.size) * lasting)
        found.append(Growth(fault, marks, levels, deviation, fit.explained))
    return sorted(found, key=lambda growth: -growth.explained)
