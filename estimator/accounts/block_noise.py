"""Noise of the oil accounts that lasts from block to block, told from the last two minutes."""

from collections.abc import Sequence
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .nuisances import NUISANCE_COUNT
from .sums import SHAPE_COUNT

Array = NDArray[np.float64]

RECENT: Final = 240
"""Blocks whose residuals tell whether noise lasts from block to block: two minutes."""
MOST_LASTING: Final = 0.9
"""Greatest autocorrelation from block to block that is believed."""


class RecentBlocks:
    """The last `RECENT` blocks: missing flow, nuisances and faults, in units of their noise."""

    def __init__(self) -> None:
        self._blocks = 0
        self._missing = np.zeros((RECENT, 2))
        self._nuisances = np.zeros((RECENT, 2, NUISANCE_COUNT))
        self._faults = np.zeros((RECENT, 2, SHAPE_COUNT))

    def add(self, missing: Array, nuisances: Array, faults: Array) -> None:
        """Add a block: float64 (2,), (2, n) and (2, 6); the oldest goes."""
        at = self._blocks % RECENT
        self._missing[at], self._nuisances[at], self._faults[at] = missing, nuisances, faults
        self._blocks += 1

    def residuals(self, nuisances: Array, faults: Sequence[tuple[int, int, float]] = ()) -> Array:
        """Return what given nuisances and faults leave of the missing flow, block by block.

        Args:
            nuisances: their sizes, float64 (n,).
            faults: index, first block and coefficient of each.

        Returns:
            float64 (n, 2), by chamber.
        """
        order = np.arange(max(self._blocks - RECENT, 0), self._blocks)
        at = order % RECENT
        left = self._missing[at] - self._nuisances[at] @ nuisances
        if faults:
            of, onsets, coefficients = (np.array(each) for each in zip(*faults, strict=True))
            sizes = (order[:, None] >= onsets) * coefficients
            left -= (self._faults[at][:, :, of] * sizes[:, None, :]).sum(axis=2)
        return np.asarray(left)


def lasting_noise(residuals: Array, model_error: float = 1.0) -> float:
    """Return by how much noise that lasts from block to block raises the variance of a mean.

    Args:
        residuals: of the two chambers, float64 (n, 2), block by block.
        model_error: of the two standard errors below, the part that is allowed for.

    For an autocorrelation of rho from block to block it is (1 + rho) / (1 - rho) (Priestley 1981,
    section 5.3.2). Few residuals tell rho badly, and being what a fit has left they tell it too
    low: two standard errors, 1 / sqrt(2 n) each, are added. Never less than one.
    """
    power = float((residuals**2).sum())
    if power == 0.0:
        return 1.0
    rho = float((residuals[1:] * residuals[:-1]).sum()) / power + 2.0 * model_error / sqrt(
        residuals.size
    )
    rho = min(max(rho, 0.0), MOST_LASTING)
    return (1.0 + rho) / (1.0 - rho)
