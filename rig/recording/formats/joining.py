"""Signals and details of the same samples are put beside each other here, by the rows' numbers."""

from collections import deque
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class NumberedRows:
    """Rows (n, n_channels) of consecutive numbers, of which `first` is that of the first row."""

    first: int
    rows: NDArray[np.float64]

    @property
    def end(self) -> int:
        """Number of the row behind the last one."""
        return self.first + len(self.rows)

    def between(self, first: int, end: int) -> NDArray[np.float64]:
        """Return the rows of these numbers, which it must have."""
        return self.rows[first - self.first : end - self.first]


class Halves:
    """Signals and details that still wait for their other half.

    Both must come in the order of their numbers, in pieces of any length: another program that
    rewrites a file may cut its chunks elsewhere.
    """

    def __init__(self) -> None:
        self._signals: deque[NumberedRows] = deque()
        self._details: deque[NumberedRows] = deque()
        self._unmatched = 0

    @property
    def unmatched(self) -> int:
        """Number of rows of signals whose details are missing, or did not come yet."""
        return self._unmatched + sum(len(each.rows) for each in self._signals)

    def forget(self) -> None:
        """Forget all that waits."""
        self._signals.clear()
        self._details.clear()

    def joined(
        self, signals: NumberedRows | None = None, details: NumberedRows | None = None
    ) -> list[NDArray[np.float64]]:
        """Take more signals or details; return the whole rows that can be made now.

        They come in blocks; in a row the details come first.
        """
        self._signals.extend([signals] if signals else [])
        self._details.extend([details] if details else [])
        blocks = []
        while self._signals and self._details:
            left, right = self._signals.popleft(), self._details.popleft()
            first, end = max(left.first, right.first), min(left.end, right.end)
            if first < end:
                blocks.append(np.hstack((right.between(first, end), left.between(first, end))))
            # The other half of what lies before can come no more.
            self._unmatched += max(0, min(first, left.end) - left.first)
            if left.end > right.end:
                begin = max(end, left.first)
                self._signals.appendleft(NumberedRows(begin, left.between(begin, left.end)))
            elif right.end > left.end:
                begin = max(end, right.first)
                self._details.appendleft(NumberedRows(begin, right.between(begin, right.end)))
        return blocks
