"""The blocks that are kept to tell when a leak was open: at most half an hour of them."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import NUISANCE_COUNT, SUPPLY_LEAKAGE, AccountBlock

Array = NDArray[np.float64]

KEPT: Final = 3600
"""Greatest number of blocks that are kept: half an hour. Then the older half is dropped."""


class KeptBlocks:
    """Columns of the blocks so far, oldest first; each has one row for each block.

    Attributes:
        count: number of blocks that are kept.
    """

    def __init__(self) -> None:
        leaks = SUPPLY_LEAKAGE
        self.count = 0
        self._missing = np.zeros((KEPT, 2))
        self._nuisances = np.zeros((KEPT, 2, NUISANCE_COUNT))
        self._leaks = np.zeros((KEPT, 2, leaks))
        self._sizes = np.zeros((KEPT, leaks))
        self._times = np.zeros((KEPT, 2))
        self._positions = np.zeros(KEPT)

    @property
    def is_full(self) -> bool:
        """Return whether half of the blocks have to be dropped before another one is added."""
        return self.count == KEPT

    def add(self, block: AccountBlock, missing: Array, nuisances: Array, leaks: Array) -> None:
        """Add a block, with its columns in units of the expected noise.

        Args:
            block: the block.
            missing: missing flows, float64 (2,).
            nuisances: signatures of the nuisances, float64 (2, n).
            leaks: signatures of the leaks, float64 (2, 3).
        """
        at = self.count
        self._missing[at], self._nuisances[at], self._leaks[at] = missing, nuisances, leaks
        self._sizes[at] = block.sizes[: self._sizes.shape[1]]
        self._times[at] = block.start_s, block.end_s
        self._positions[at] = 0.5 * sum(block.position_range)
        self.count += 1

    def drop_older_half(self) -> None:
        """Drop the older half of the blocks."""
        half = self.count // 2
        for column in (self._missing, self._nuisances, self._leaks, self._sizes, self._times,
                       self._positions):  # fmt: skip
            column[: self.count - half] = column[half : self.count]
        self.count -= half

    @property
    def missing(self) -> Array:
        """Return the missing flows, (count, 2)."""
        return self._missing[: self.count]

    @property
    def nuisances(self) -> Array:
        """Return the signatures of the nuisances, (count, 2, n)."""
        return self._nuisances[: self.count]

    def leak(self, leak: int) -> Array:
        """Return the signature of a leak, (count, 2)."""
        return self._leaks[: self.count, :, leak]

    def sizes(self, leak: int) -> Array:
        """Return the mean absolute flow of a leak per unit coefficient, (count,), SI."""
        return self._sizes[: self.count, leak]

    @property
    def start_s(self) -> Array:
        """Return when each block starts, (count,), s."""
        return self._times[: self.count, 0]

    @property
    def end_s(self) -> Array:
        """Return when each block ends, (count,), s."""
        return self._times[: self.count, 1]

    def motion(self) -> dict[str, Array]:
        """Return what a leak may go with, by name, (count,) each.

        The position is the middle of the block's range, m; the direction is the speed by the
        positions of the neighbouring blocks, m/s; the pressures are the squares of what the leaks
        out of the chambers would flow per unit coefficient, Pa above the return line.
        """
        position = self._positions[: self.count]
        middle = 0.5 * (self.start_s + self.end_s)
        speed = np.gradient(position, middle) if self.count > 1 else np.zeros(self.count)
        return {
            "position": position,
            "direction": np.asarray(speed),
            "pressure_1": self.sizes(0) ** 2,
            "pressure_2": self.sizes(1) ** 2,
        }
