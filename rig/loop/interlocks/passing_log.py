"""The memory of the log of passed limits, for processes that need not load the compiler."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

PASSINGS_KEPT: Final = 64
"""Number of passings that the log holds. A limit is passed again only after its value has come
back, and the log is read at least every half second, so that more than this is a value that swings
about its limit; the oldest passings are written over then."""
PASSING_NUMBERS: Final = 4
"""Numbers of one passing: segment, tick, rung, value."""


class PassingLog(NamedTuple):
    """The latest passings; it has one writer, and any number of readers."""

    written: NDArray[np.int64]
    """(1,): number of passings so far; stored after the passing itself (release)."""
    rows: NDArray[np.float64]
    """(PASSINGS_KEPT, PASSING_NUMBERS): passing k is in row k % PASSINGS_KEPT."""
