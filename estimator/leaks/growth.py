"""The test for leaks that grow over minutes, which no single onset explains.

A leak's coefficient may be another one in each of some stretches of time, and so may the spool's
null, which wanders too. What the leak has grown by since the first stretch is told like the
coefficient of a sudden leak: by its surplus over the dead zone against its standard error.
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
"""Stretches of time with a coefficient each."""
LEAST_BLOCKS: Final = 120
"""Younger leaks are sudden ones: a minute, seven seconds a stretch."""


@dataclass(frozen=True)
class Growth:
    """How much a leak has grown, stretch by stretch, and how sure that is.

    Attributes:
        fault: index into `FAULTS`.
        marks: first mark of every stretch but the first, int64 (stretches - 1,).
        levels: its coefficient in them beside that in the first one, SI, as many.
        deviation: standard error of the last of them.
        explained: what leak and null explain of the weighted sum of squares.
    """

    fault: int
    marks: NDArray[np.int64]
    levels: Array
    deviation: float
    explained: float


def stretches(sums: AccountSums) -> NDArray[np.int64]:
    """Return the marks that part the blocks so far into stretches of like length, at most (7,).

    In a run of more than half an hour early marks are so far apart that stretches have to merge.
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
    """Return what each leak alone would have grown by, the likeliest first.

    Args:
        sums: the blocks, at least `LEAST_BLOCKS`.
        products: the same blocks' `AccountSums.faults_since`.
        recent: the latest of them, which tell whether noise lasts.
        variance: of the noise if there were no leak, to begin with.
        model_error: what part of the usual errors of the model is allowed for.
    """
    marks = stretches(sums)
    _, _, total = sums.nuisances()
    found = []
    for fault in range(len(LEAKS)):
        shapes = [SHIFT] * marks.size + [fault] * marks.size
        fit = JointFit(sums, products, shapes, [*marks, *marks], variance)
        # What is left of the missing flow, beliefs about nuisances included, tells the noise anew.
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
