"""Setpoints of straight lines between points, which are given or read from a CSV file.

A file's errors are reported with their lines.
"""

import csv
import gzip
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from math import isfinite, nan
from pathlib import Path
from typing import Final, TextIO

import numpy as np

from ..request import RequestProblem
from .protocol import Quantity, Samples, SetpointChecks, SetpointError, Times

_COLUMNS: Final[dict[Quantity, str]] = {"position": "position_m", "command": "command_V"}

# A file with a wrong export has a problem in every row; the first problems are enough to show.
_PROBLEMS_SHOWN: Final = 20
_MOST_FOUND: Final = 10_000
"""Most problems that are counted; a compressed file may have any number of rows."""
MOST_ROWS: Final = 20_000_000
"""Most rows of a setpoint file: five and a half hours at 1 kHz, which take 1.3 GB while they are
read; it is interpolated between rows, so that longer motions need fewer of them."""
_LONGEST_LINE: Final = 1 << 20
"""Most characters of a line; the longest field that csv takes has 131072."""


class SetpointFileError(SetpointError):
    """The error of a setpoint file that is missing or unusable.

    Each problem names file:line, or the file alone if it belongs to no line.
    """


@dataclass(frozen=True)
class Polyline:
    """Straight lines from corner to corner, in metres or volts.

    Before the first corner the setpoint has the first value, after the last corner the last one.

    Attributes:
        times_s: times of the corners in s, increasing, at least two.
        values: setpoint at each corner.
        quantity: "position" (metres) or "command" (volts).

    Raises:
        SetpointError: there are fewer than two corners or unequally many values, a number is not
            finite, the times do not increase, or the quantity is neither of the two.
    """

    times_s: tuple[float, ...]
    values: tuple[float, ...]
    quantity: Quantity = "position"

    def __post_init__(self) -> None:
        object.__setattr__(self, "times_s", tuple(float(time) for time in self.times_s))
        object.__setattr__(self, "values", tuple(float(value) for value in self.values))
        with SetpointChecks(self) as checks:
            times, values = len(self.times_s), len(self.values)
            limit = f"do not fit {times} times, or are fewer than two"
            remedy = "give a value for each of at least two times"
            checks.require(times == values >= 2, "values", limit, remedy, values)
            increase = all(later > earlier for earlier, later in pairwise(self.times_s))
            remedy = "give the corners in the order of time"
            checks.require(increase, "times_s", "do not increase", remedy)
            for index, (time, value) in enumerate(zip(self.times_s, self.values, strict=False)):
                checks.finite("s", **{f"times_s[{index}]": time})
                checks.finite(checks.unit, **{f"values[{index}]": value})

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        return np.interp(np.asarray(time_s, dtype=np.float64), self.times_s, self.values)

    def peak_rate(self, duration_s: float) -> float:
        """Return the greatest |slope| of the lines in m/s or V/s within 0 to `duration_s`.

        A line counts if any part of it lies within. The result is 0 if none does.
        """
        return _greatest_slope(np.asarray(self.times_s), np.asarray(self.values), duration_s)


@dataclass(frozen=True)
class FromFile:
    """A setpoint from a CSV file (.csv or .csv.gz), interpolated linearly between its rows.

    The file has a header with the columns `time_s` and `position_m` (quantity "position") or
    `command_V` (quantity "command"); further columns are ignored. Times are in s and must increase.
    Before the first row the setpoint has the first value, after the last row the last one. The file
    is read once, when the setpoint is made.

    Raises:
        SetpointError: the quantity is neither "position" nor "command".
        SetpointFileError: the file is missing or unusable; it lists the first 20 problems with
            file:line, and the number of the others.
    """

    path: Path
    quantity: Quantity = "position"
    _time: Samples = field(init=False, repr=False, compare=False)
    _value: Samples = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        SetpointChecks(self).finish()
        time, value = _read_file(Path(self.path), self.quantity)
        object.__setattr__(self, "path", Path(self.path))
        object.__setattr__(self, "_time", time)
        object.__setattr__(self, "_value", value)

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        return np.interp(np.asarray(time_s, dtype=np.float64), self._time, self._value)

    @property
    def last_time_s(self) -> float:
        """Time of the last row, s, after which the setpoint keeps its value."""
        return float(self._time[-1])

    def peak_rate(self, duration_s: float) -> float:
        """Return the greatest |slope| between rows in m/s or V/s within 0 to `duration_s`.

        A stretch between rows counts if any part of it lies within. The result is 0 if none does.
        """
        return _greatest_slope(self._time, self._value, duration_s)


def _greatest_slope(times: Samples, values: Samples, duration_s: float) -> float:
    """Return the greatest |slope| in m/s or V/s within 0 to `duration_s` of lines through points.

    A line counts if any part of it lies within. The result is 0 if none does.

    Args:
        times: times (n,) of the points in s, increasing.
        values: values (n,) of the points in m or V.
        duration_s: end of the stretch in s.
    """
    slopes = np.abs(np.diff(values) / np.diff(times))
    reached = (times[:-1] < duration_s) & (times[1:] > 0.0)
    return float(np.max(slopes, where=reached, initial=0.0))


def _read_file(path: Path, quantity: Quantity) -> tuple[Samples, Samples]:
    """Return (time in s, setpoint in m or V) of a .csv or .csv.gz file, both float64 (rows,).

    Raises:
        SetpointFileError: the file is missing, no regular file, or not CSV text; a column is
            missing; a field is no finite number; times do not increase; there are no rows, or more
            than `MOST_ROWS`.
    """
    if path.exists() and not path.is_file():
        # A device such as /dev/zero has no end.
        problem = RequestProblem(
            str(path), "file", "unreadable", "(no regular file)", "give a CSV file"
        )
        raise SetpointFileError([problem])
    open_text = gzip.open if path.suffix == ".gz" else open
    try:
        with open_text(path, "rt", encoding="utf-8-sig", newline="") as text:
            return _read(path, text, quantity)
    except (OSError, EOFError, UnicodeDecodeError, csv.Error, zlib.error) as error:
        reason = getattr(error, "strerror", None) or error
        problem = RequestProblem(str(path), "file", "unreadable", f"({reason})", "give a CSV file")
        raise SetpointFileError([problem]) from error


def _read(path: Path, text: TextIO, quantity: Quantity) -> tuple[Samples, Samples]:
    reader = csv.DictReader(_lines(text))
    reader.fieldnames = [name.strip() for name in reader.fieldnames or ()]
    _require_columns(path, reader.fieldnames, quantity)
    times: list[float] = []
    values: list[float] = []
    problems: list[RequestProblem] = []
    for row in reader:
        where = f"{path}:{reader.line_num}"
        time = _number(where, "time_s", row, problems)
        values.append(_number(where, _COLUMNS[quantity], row, problems))
        if times and time <= times[-1]:
            limit = f"is not after {times[-1]}"
            problems.append(RequestProblem(where, "time_s", time, limit, "sort the rows by time"))
        times.append(time)
        if len(times) > MOST_ROWS:
            remedy = "is it the right file? Give fewer points, between which it is interpolated"
            limit = f"more than {MOST_ROWS}"
            problems.append(RequestProblem(where, "rows", "too many", f"({limit})", remedy))
        if len(problems) > _MOST_FOUND or len(times) > MOST_ROWS:
            break
    if not times:
        remedy = "add the samples"
        problems.append(RequestProblem(f"{path}:1", "rows", "none", "below the header", remedy))
    if problems:
        raise SetpointFileError(_first(path, problems))
    return np.array(times), np.array(values)


def _lines(text: TextIO) -> Iterator[str]:
    """Yield the lines of a text, of which none is read that is longer than `_LONGEST_LINE`.

    Raises:
        csv.Error: a line is longer; a compressed file may have one that fills the memory.
    """
    while line := text.readline(_LONGEST_LINE):
        if len(line) == _LONGEST_LINE:
            raise csv.Error(f"a line is longer than {_LONGEST_LINE} characters")
        yield line


def _require_columns(path: Path, present: list[str], quantity: Quantity) -> None:
    among = f"among {', '.join(present)}" if present else "in an empty file"
    problems = [
        RequestProblem(f"{path}:1", name, "no such column", among, _remedy(name, present))
        for name in ("time_s", _COLUMNS[quantity])
        if name not in present
    ]
    if problems:
        raise SetpointFileError(problems)


def _remedy(missing: str, present: list[str]) -> str:
    for quantity, column in _COLUMNS.items():
        if missing in _COLUMNS.values() and column in present:
            return f'name it in the header, or set quantity to "{quantity}" to read {column}'
    return "name it in the header"


def _number(where: str, column: str, row: dict[str, str], problems: list[RequestProblem]) -> float:
    # If a row is shorter than the header, csv gives None here, against the annotated type.
    entry = (row[column] or "").strip()
    try:
        number = float(entry)
    except ValueError:
        number = nan
    if not isfinite(number):
        limit, remedy = "is not a finite number", "fill it in or drop the row"
        problems.append(RequestProblem(where, column, entry or "nothing", limit, remedy))
    return number


def _first(path: Path, problems: list[RequestProblem]) -> list[RequestProblem]:
    rest = len(problems) - _PROBLEMS_SHOWN
    if rest <= 0:
        return problems
    remedy = "mend those above first"
    count = f"{rest}" if len(problems) <= _MOST_FOUND else f"more than {rest}"
    more = RequestProblem(str(path), "rows", f"{count} more problems", "follow", remedy)
    return [*problems[:_PROBLEMS_SHOWN], more]
