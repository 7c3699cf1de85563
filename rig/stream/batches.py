"""Rows are gathered here into batches of samples, whose row numbers show which rows are missing."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .messages import Channels, Samples

Array = NDArray[np.float64]

_UNKNOWN_TEST: Final = 0


class Batches:
    """A collector of rows that returns them in batches of at most `size` samples.

    All samples of a batch belong to one test and have the same channels, and their row numbers are
    consecutive.

    Args:
        size: most samples in a batch.
        wanted: names of the channels to send; if empty, all are sent.
    """

    def __init__(self, size: int, wanted: Sequence[str] = ()) -> None:
        self._size = size
        self._wanted = frozenset(wanted)
        self._columns: list[int] = []
        self._time_column = 0
        self._channels = Channels(0, (), ())
        self._test = _UNKNOWN_TEST
        self._rows: list[Array] = []
        self._count = 0
        self._first_row = 0
        self._newest_ns = 0

    @property
    def channels(self) -> Channels:
        """The channels of the batches; their number is 0 before `set_columns` was called."""
        return self._channels

    def set_columns(self, names: Sequence[str], units: Sequence[str], test: int) -> bool:
        """Set the columns of the rows that follow; return whether the channels have changed.

        The rows gathered so far must have been flushed before.

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
        if chosen == (self._channels.names, self._channels.units):
            return False
        self._channels = Channels(self._channels.number + 1, *chosen)
        return True

    def add(self, first_row: int, rows: Array, newest_ns: int) -> list[Samples]:
        """Add consecutive rows, and return the batches that are full.

        If they do not continue the rows before, those are returned as a batch first.

        Args:
            first_row: number of the first row.
            rows: float64 (n, columns), SI.
            newest_ns: wall clock at which the last row was taken, ns since 1970.
        """
        done: list[Samples] = []
        if self._count and first_row != self._first_row + self._count:
            done += self.flush()
        if not self._count:
            self._first_row = first_row
        self._rows.append(rows)
        self._count += len(rows)
        self._newest_ns = newest_ns
        while self._count >= self._size:
            done.append(self._take(self._size))
        return done

    def flush(self) -> list[Samples]:
        """Return a list with one batch of all rows that are left; [] if there are none."""
        return [self._take(self._count)] if self._count else []

    def _take(self, count: int) -> Samples:
        rows = self._rows[0] if len(self._rows) == 1 else np.concatenate(self._rows)
        mine, rest = rows[:count], rows[count:]
        with np.errstate(over="ignore"):
            values = mine[:, self._columns].astype(np.float32)
        batch = Samples(
            channels_id=self._channels.number,
            first_row=self._first_row,
            test=self._test,
            newest_ns=self._newest_ns,
            time_s=mine[:, self._time_column].copy(),
            values=values,
        )
        self._rows, self._count = ([rest] if len(rest) else []), len(rest)
        self._first_row += count
        return batch
