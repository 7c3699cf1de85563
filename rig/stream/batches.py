"""Gathers rows into batches of samples, and shows which rows are missing between them."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .messages import Channels, Samples

Array = NDArray[np.float64]

_UNKNOWN_TEST: Final = 0


class Batches:
    """Rows as they come, given back in batches of at most `size`.

    A batch belongs to one test and one set of channels, and has no hole in it.

    Args:
        size: samples in a batch.
        wanted: channels to send; all, if none is named.
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
        """Return what the columns are; number 0 before any are known."""
        return self._channels

    def set_columns(self, names: Sequence[str], units: Sequence[str], test: int) -> bool:
        """Take rows of such columns from now on; return whether the channels are others.

        What was gathered must have been flushed.
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
        """Take rows without a hole, float64 (n, columns); return the batches that are full."""
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
        """Return what is gathered so far, if anything, as a batch."""
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
