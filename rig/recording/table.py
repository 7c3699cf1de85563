"""Columns as read from a file of any format, before they are judged."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import RecordingProblem
from .recording import Event, FloatArray


def row_number(row: int) -> int:
    """Return the number by which a row (from 0) is named where a file has no lines: from 1."""
    return row + 1


@dataclass
class Table:
    """What a reader found: columns (float64, shape (n,)), and what it could not read.

    Attributes:
        unreadable: by column, which cells hold NaN because their text is reported in `problems`.
        line_of: line (or row number) of row k, for messages.
    """

    path: str
    columns: dict[str, FloatArray]
    problems: list[RecordingProblem] = field(default_factory=list)
    unreadable: dict[str, NDArray[np.bool_]] = field(default_factory=dict)
    line_of: Callable[[int], int] = row_number
    metadata: dict[str, Any] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def unread(self, column: str) -> NDArray[np.bool_]:
        """Return which cells of a column are reported already, shape (n,)."""
        found = self.unreadable.get(column)
        return np.zeros(len(self), dtype=np.bool_) if found is None else found
