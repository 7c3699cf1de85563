"""A table holds columns as they were read from a file of any format, before they are checked."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .errors import RecordingProblem
from .recording import Event, FloatArray


def row_number(row: int) -> int:
    """Return the number, from 1, that messages use for a row (from 0) of a file without lines."""
    return row + 1


@dataclass
class Table:
    """The columns that a reader found in a file, with the problems that were found in them so far.

    Attributes:
        path: the file.
        columns: name -> values, float64 of shape (n,).
        problems: problems that the reader and the checks found.
        unreadable: column -> mask (n,) of cells that are NaN as they could not be read; the
            problems report these already. A column without such cells may be missing.
        line_of: returns the line, or the row's number, of row k (from 0), for messages.
        metadata: metadata of the recording.
        events: events of the recording.
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
        """Return the mask (n,) of a column's cells that are reported as unreadable already."""
        found = self.unreadable.get(column)
        return np.zeros(len(self), dtype=np.bool_) if found is None else found

    def report(
        self, name: str, value: str, remedy: str, limit: str = "", row: int | None = None
    ) -> None:
        """Add a problem of a column, `name`, to the table's problems.

        Args:
            name: the column, or another field of the file.
            value: what was found.
            remedy: what is to be done about it.
            limit: the limit that the value breaks; empty if there is none.
            row: row (from 0) at which the problem is; None if it is of the whole column.
        """
        line = None if row is None else self.line_of(row)
        self.problems.append(RecordingProblem(self.path, name, value, remedy, limit, line))
