"""Signals and details of the same samples are put beside each other here, by the rows' numbers."""

from collections import deque
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class NumberedRows:
    """Rows (n, n_channels) of consecutive numbers, of which `first` is that of the first row.

    `log_times` are those of the rows' messages, (n,), ns; of details it has none, as many rows have
    one message.
    """

    first: int
    rows: NDArray[np.float64]
    log_times: NDArray[np.uint64] = field(default_factory=lambda: np.empty(0, np.uint64))

    @property
    def end(self) -> int:
        """Number of the row behind the last one."""
        return self.first + len(self.rows)

    def between(self, first: int, end: int) -> NDArray[np.float64]:
        """Return the rows of these numbers, which it must have."""
        return self.rows[first - self.first : end - self.first]

    def part(self, first: int, end: int) -> "NumberedRows":
        """Return the rows of these numbers, which it must have, with their log times."""
        times = self.log_times[first - self.first : end - self.first]
        return NumberedRows(first, self.between(first, end), times)


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
    ) -> list[NumberedRows]:
        """Take more signals or details; return the whole rows that can be made now.

        They come in blocks, with the log times of their signals; in a row the details come first.
        """
        self._signals.extend([signals] if signals else [])
        self._details.extend([details] if details else [])
        blocks = []
        while self._signals and self._details:
            left, right = self._signals.popleft(), self._details.popleft()
            first, end = max(left.first, right.first), min(left.end, right.end)
            if first < end:
                part = left.part(first, end)
                whole = np.hstack((right.between(first, end), part.rows))
                blocks.append(NumberedRows(first, whole, part.log_times))
            # The other half of what lies before can come no more.
            self._unmatched += max(0, min(first, left.end) - left.first)
            if left.end > right.end:
                begin = max(end, left.first)
                self._signals.appendleft(left.part(begin, left.end))
            elif right.end > left.end:
                begin = max(end, right.first)
                self._details.appendleft(right.part(begin, right.end))
        return blocks
