"""Rows are gathered here into batches of samples, whose row numbers show which rows are missing."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from .messages import Channels, Samples


class Batches:
    """A collector of rows that returns them in batches of at most `size` samples.

    All samples of a batch belong to one test and have the same channels, and their row numbers are
    consecutive.

    Args:
        size: most samples in a batch.
        wanted: names of the channels to send; if empty, all are sent.

    Attributes:
        channels: the channels of the batches; their number is 0 before `set_columns` was called.
    """

    def __init__(self, size: int, wanted: Sequence[str] = ()) -> None:
        self._size = size
        self._wanted = frozenset(wanted)
        self._columns: list[int] = []
        self._time_column = 0
        self.channels = Channels(0, (), ())
        self._test = 0
        self._rows = np.empty((0, 0))
        self._first_row = 0
        self._newest_ns = 0

    @property
    def waiting(self) -> int:
        """Number of rows that were added and fill no batch yet."""
        return len(self._rows)

    def set_columns(self, names: Sequence[str], units: Sequence[str], test: int) -> bool:
        """Set the columns of the rows that follow; return whether the channels have changed.

        The rows gathered so far must have been flushed before. Changed channels get a new number.

        Args:
            names: names of the columns, `time_s` among them, which is no channel of the batches.
            units: unit of each column.
            test: number of the test that the rows belong to.
        """
        columns = [
            i for i, name in enumerate(names)
            if name != "time_s" and (not self._wanted or name in self._wanted)
        ]  # fmt: skip
        self._columns, self._time_column, self._test = columns, list(names).index("time_s"), test
        chosen = tuple(names[i] for i in columns), tuple(units[i] for i in columns)
        if chosen == (self.channels.names, self.channels.units):
            return False
        self.channels = Channels(self.channels.number + 1, *chosen)
        return True

    def add(self, first_row: int, rows: NDArray[np.float64], newest_ns: int) -> list[Samples]:
        """Add consecutive rows, and return the batches that are full now, oldest first.

        If the first row does not follow the last row that was added, the rows gathered before come
        first in the list, as a batch of their own. Rows that fill no batch wait for the next call.

        Args:
            first_row: number of the first row.
            rows: float64 (n, columns), SI.
            newest_ns: wall clock at which the last row was taken, ns since 1970.
        """
        done: list[Samples] = []
        if first_row != self._first_row + len(self._rows):
            done += self.flush()
        if not len(self._rows):
            self._first_row, self._rows = first_row, rows[:0]
        self._rows = np.concatenate([self._rows, rows])
        self._newest_ns = newest_ns
        while len(self._rows) >= self._size:
            done.append(self._take(self._size))
        return done

    def flush(self) -> list[Samples]:
        """Take out all rows that still wait, and return them as a list of one batch; [] if none."""
        return [self._take(len(self._rows))] if len(self._rows) else []

    def _take(self, count: int) -> Samples:
        mine, self._rows = self._rows[:count], self._rows[count:]
        with np.errstate(over="ignore"):
            values = mine[:, self._columns].astype(np.float32)
        batch = Samples(
            channels_id=self.channels.number,
            first_row=self._first_row,
            test=self._test,
            newest_ns=self._newest_ns,
            time_s=mine[:, self._time_column].copy(),
            values=values,
        )
        self._first_row += count
        return batch
