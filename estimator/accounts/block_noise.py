"""Noise of the oil accounts that lasts from block to block, as the last two minutes show it."""

from collections.abc import Sequence
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .nuisances import NUISANCE_COUNT
from .sums import SHAPE_COUNT

Array = NDArray[np.float64]

RECENT: Final = 240
"""Number of blocks (two minutes) whose residuals show whether noise lasts from block to block."""
MOST_LASTING: Final = 0.9
"""Upper bound of the autocorrelation from block to block; a greater estimate is cut to it."""


class RecentBlocks:
    """Keeps missing flow, nuisances and faults of the last `RECENT` blocks.

    All are in units of the expected noise (`noise.whitening`).
    """

    def __init__(self) -> None:
        self._blocks = 0
        self._missing = np.zeros((RECENT, 2))
        self._nuisances = np.zeros((RECENT, 2, NUISANCE_COUNT))
        self._faults = np.zeros((RECENT, 2, SHAPE_COUNT))

    @property
    def kept(self) -> tuple[Array, Array, Array] | None:
        """Return missing flow, nuisances and faults of all blocks that were ever added.

        They are (blocks, 2), (blocks, 2, n) and (blocks, 2, 6), and must not be changed. None if
        some blocks are no longer kept.
        """
        if self._blocks > RECENT:
            return None
        here = slice(self._blocks)
        return self._missing[here], self._nuisances[here], self._faults[here]

    def add(self, missing: Array, nuisances: Array, faults: Array) -> None:
        """Add a block; if there are `RECENT` of them, it replaces the oldest.

        Args:
            missing: missing flow of both chambers, float64 (2,).
            nuisances: signatures of the nuisances, float64 (2, n).
            faults: signatures of the faults and of a shift of the null, float64 (2, 6).
        """
        at = self._blocks % RECENT
        self._missing[at], self._nuisances[at], self._faults[at] = missing, nuisances, faults
        self._blocks += 1

    def residuals(self, nuisances: Array, faults: Sequence[tuple[int, int, float]] = ()) -> Array:
        """Return the missing flow of each kept block less what given nuisances and faults explain.

        Args:
            nuisances: sizes of the nuisances, in standard deviations, float64 (n,).
            faults: for each fault its index, the index of its first block among all blocks that
                were ever added, and its coefficient in SI units.

        Returns:
            float64 (blocks, 2) in units of the expected noise, at most `RECENT` blocks, oldest
            first, one column for each chamber.
        """
        order = np.arange(max(self._blocks - RECENT, 0), self._blocks)
        # Up to `RECENT` blocks lie in their order, so that they need not be copied.
        at = order % RECENT if self._blocks > RECENT else slice(self._blocks)
        left = self._missing[at] - self._nuisances[at] @ nuisances
        if faults:
            of, onsets, coefficients = (np.array(each) for each in zip(*faults, strict=True))
            sizes = (order[:, None] >= onsets) * coefficients
            left -= (self._faults[at][:, :, of] * sizes[:, None, :]).sum(axis=2)
        return np.asarray(left)


def lasting_noise(residuals: Array, model_error: float = 1.0) -> float:
    """Return the factor by which noise that lasts from block to block raises a mean's variance.

    For an autocorrelation rho from block to block it is (1 + rho) / (1 - rho) (Priestley 1981,
    section 5.3.2), with rho limited to 0 .. `MOST_LASTING`, so that it is never less than one. An
    estimate of rho from the residuals of a fit is uncertain and too low. Two of its standard
    errors, 1 / sqrt(2 n) each, are therefore added.

    Args:
        residuals: residuals of both chambers, float64 (n, 2), oldest block first; if all are 0
            or there is none, the factor is 1.
        model_error: factor on the two standard errors that are added.
    """
    power = float((residuals**2).sum())
    if power == 0.0:
        return 1.0
    rho = float((residuals[1:] * residuals[:-1]).sum()) / power + 2.0 * model_error / sqrt(
        residuals.size
    )
    rho = min(max(rho, 0.0), MOST_LASTING)
    return (1.0 + rho) / (1.0 - rho)
