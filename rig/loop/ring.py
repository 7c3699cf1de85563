"""Reads the board's ring: every row once, in order, while the loop goes on writing."""

import numpy as np
from numpy.typing import NDArray

from .board import RING_ROWS, Board, Word

Array = NDArray[np.float64]

_MARGIN = 256
"""Number of oldest rows that a reader counts as lost, as the loop may overwrite them meanwhile."""


class RingReader:
    """One reader of the ring, which does not disturb the loop or other readers.

    It begins with the next row that is written.

    Attributes:
        lost: number of rows that were overwritten, or about to be, before they were read; a caller
            may set it to 0.
    """

    def __init__(self, board: Board) -> None:
        self._words, self._ring = board.words, board.ring
        self._next = int(board.words[Word.ROWS])
        self.lost = 0

    def go_on_from(self, row: int) -> None:
        """Read on from row number `row` of the session; rows that are overwritten count as lost."""
        self._next = min(row, int(self._words[Word.ROWS]))

    @property
    def next_row(self) -> int:
        """Number in the session of the row that is read next."""
        return self._next

    @property
    def waiting(self) -> int:
        """Number of rows that are written and not yet read, with those that are lost already."""
        return int(self._words[Word.ROWS]) - self._next

    def skip_to_end(self) -> None:
        """Skip all rows written so far, so that the next row that is written is read next."""
        self._next = int(self._words[Word.ROWS])

    def take(self, most: int = RING_ROWS) -> Array:
        """Return the rows that were not yet read, at most `most`, float64 (n, columns).

        It does not wait: n is 0 if there is none. Rows that were overwritten before that, or may be
        at any moment, are left out and counted in `lost`.
        """
        end = int(self._words[Word.ROWS])
        oldest = end - RING_ROWS + _MARGIN
        if self._next < oldest:
            self.lost += oldest - self._next
            self._next = oldest
        end = min(end, self._next + most)
        rows = self._ring[np.arange(self._next, end) % RING_ROWS]
        self._next = end
        return rows

    def latest(self, count: int) -> Array:
        """Return the last rows written, at most `count`; `take` still returns those unread."""
        end = int(self._words[Word.ROWS])
        return self._ring[np.arange(max(end - count, 0), end) % RING_ROWS]
