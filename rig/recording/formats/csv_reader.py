"""CSV and gzipped CSV are read here, fast if all cells are numbers, else with line numbers."""

import csv
import gzip
import re
import zlib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
from numpy.typing import NDArray

from rig.recording.errors import RecordingError, RecordingProblem
from rig.recording.recording import REPLAY_CHANNELS, FloatArray
from rig.recording.table import Table

_GZIP_MAGIC: Final = b"\x1f\x8b"
_MISSING: Final = ("", "nan", "NaN", "NAN", "-nan")
_DELIMITERS: Final = {";": "semicolons", "\t": "tabs", "|": "bars", " ": "spaces"}


def read_csv(path: str) -> Table:
    """Return the table in a .csv or .csv.gz file: a header line, then numbers.

    An empty cell is NaN. Cells that are not numbers, and all cells of a row with too many or too
    few, become NaN too and are reported as problems. A column without a name is left out, and of
    columns with the same name only the first is read; both are problems.

    Raises:
        RecordingError: the file cannot be read as a table at all: it is empty, not compressed as
            its name says, not UTF-8, without a header, or not separated by commas.
    """
    text = _text(path)
    names, problems = _header(path, text)
    kept = {name: names.index(name) for name in names if name}
    table = Table(path, {}, problems, line_of=_line_numbers(text))
    try:
        columns = _fast_columns(text, len(names))
    except pa.ArrowInvalid:
        columns, unreadable, found = _careful_columns(path, text, names)
        table.problems += found
        table.unreadable = {name: unreadable[index] for name, index in kept.items()}
    table.columns = {name: columns[index] for name, index in kept.items()}
    return table


def _text(path: str) -> bytes:
    data = Path(path).read_bytes()
    compressed = path.lower().endswith(".gz")
    if not data:
        remedy = "record again or fetch the file again"
        raise RecordingError.of_file(path, "empty (0 bytes)", remedy)
    if data.startswith(_GZIP_MAGIC) != compressed:
        value = "not gzip-compressed" if compressed else "gzip-compressed"
        wanted = path[: -len(".gz")] if compressed else f"{path}.gz"
        limit = "its extension says otherwise"
        raise RecordingError.of_file(path, value, f"rename to {wanted}", limit)
    if not compressed:
        return data
    try:
        return gzip.decompress(data)
    except (EOFError, OSError, zlib.error) as error:
        cut = isinstance(error, EOFError)
        value = "gzip data is cut off" if cut else f"gzip data is corrupt ({error})"
        remedy = f"fetch the file again, or keep what is readable: zcat {path} > salvaged.csv"
        raise RecordingError.of_file(path, value, remedy) from None


def _header(path: str, text: bytes) -> tuple[list[str], list[RecordingProblem]]:
    try:
        line = _first_line(text).decode("utf-8-sig")
    except UnicodeDecodeError:
        remedy = "save the file as CSV in UTF-8"
        raise RecordingError(
            [RecordingProblem(path, 1, "header", "not text", "UTF-8 column names", remedy)]
        ) from None
    names = _cells(line)
    _refuse_other_delimiter(path, line, names)
    if all(_is_number(name) for name in names):
        limit = f"line 1 must name the columns: {', '.join(REPLAY_CHANNELS)}, ..."
        raise RecordingError(
            [RecordingProblem(path, 1, "header", "has numbers only", limit, "insert a header line")]
        )
    problems = []
    for position, name in enumerate(names):
        if not name:
            remedy = "name the column or delete it (pandas: to_csv(index=False))"
            problems.append(
                RecordingProblem(path, 1, f"column {position + 1}", "has no name", "", remedy)
            )
        elif name in names[:position]:
            value = f"columns {names.index(name) + 1} and {position + 1} have this name"
            problems.append(RecordingProblem(path, 1, name, value, "", "rename or delete one"))
    return names, problems


def _first_line(text: bytes) -> bytes:
    found = re.match(rb"[^\r\n]*", text)
    return found[0] if found else b""


def _refuse_other_delimiter(path: str, line: str, names: Sequence[str]) -> None:
    if any(name in names for name in REPLAY_CHANNELS):
        return
    for delimiter, called in _DELIMITERS.items():
        split = [name.strip().strip('"') for name in line.split(delimiter)]
        known = any(name in split for name in REPLAY_CHANNELS)
        if len(split) > len(names) and (known or len(names) == 1):
            remedy = "convert the delimiter to a comma (and decimal commas to points)"
            value, limit = f"separated by {called}", "must be commas"
            raise RecordingError([RecordingProblem(path, 1, "header", value, limit, remedy)])


def _cells(line: str) -> list[str]:
    return [cell.strip() for cell in next(csv.reader([line], skipinitialspace=True), [])]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _line_numbers(text: bytes) -> Callable[[int], int]:
    """Return a function from row (from 0) to line number (from 1); blank lines are no rows.

    The lines are counted when the function is first called.
    """
    numbers: list[int] = []

    def line_of(row: int) -> int:
        if not numbers:
            lines = text.splitlines()[1:]
            numbers.extend(number for number, line in enumerate(lines, 2) if line.strip())
        return numbers[row]

    return line_of


def _fast_columns(text: bytes, n_columns: int) -> list[FloatArray]:
    """Return the columns, each of shape (n,), of a text whose cells are all numbers or empty.

    Raises:
        pyarrow.ArrowInvalid: a cell is not a number, or a row has another number of cells.
    """
    keys = [str(position) for position in range(n_columns)]
    if not text[len(_first_line(text)) :].strip():
        return [np.empty(0) for _ in keys]
    table = pacsv.read_csv(
        pa.BufferReader(text),
        read_options=pacsv.ReadOptions(column_names=keys, skip_rows=1, use_threads=False),
        convert_options=pacsv.ConvertOptions(
            column_types={key: pa.float64() for key in keys}, null_values=list(_MISSING)
        ),
    )
    # The columns are copied, as pyarrow's own buffers are read-only.
    return [np.array(table[key].to_numpy(), dtype=np.float64) for key in keys]


def _careful_columns(
    path: str, text: bytes, names: Sequence[str]
) -> tuple[list[FloatArray], NDArray[np.bool_], list[RecordingProblem]]:
    """Return the columns, a mask of unreadable cells, and the problems of those cells.

    Each column has shape (n,), with NaN for unreadable cells; the mask has shape (n_columns, n).
    """
    problems: list[RecordingProblem] = []
    rows: list[list[float]] = []
    unreadable: list[list[bool]] = []
    lines = text.splitlines()
    wrong: dict[str, list[tuple[int, str]]] = {name: [] for name in names}
    for number, raw in enumerate(lines[1:], 2):
        if not raw.strip():
            continue
        cells = _cells(raw.decode("utf-8", errors="replace"))
        if len(cells) != len(names):
            problems.append(_ragged(path, number, len(cells), len(names), number == len(lines)))
            rows.append([np.nan] * len(names))
            unreadable.append([True] * len(names))
            continue
        values = [_number(cell) for cell in cells]
        for name, cell, value in zip(names, cells, values, strict=True):
            if value is None:
                wrong[name].append((number, cell))
        rows.append([np.nan if value is None else value for value in values])
        unreadable.append([value is None for value in values])
    for name, found in wrong.items():
        problems += _not_numbers(path, name, found, len(rows))
    shape = (-1, len(names))
    columns = np.ascontiguousarray(np.array(rows, dtype=np.float64).reshape(shape).T)
    return list(columns), np.array(unreadable, dtype=np.bool_).reshape(shape).T, problems


def _number(cell: str) -> float | None:
    if cell in _MISSING:
        return float("nan")
    try:
        # float() would read 1_000 as a number.
        return None if "_" in cell else float(cell)
    except ValueError:
        return None


def _ragged(path: str, line: int, cells: int, wanted: int, last: bool) -> RecordingProblem:
    remedy = (
        "delete the line: the file was cut off in it" if last else "complete or delete the line"
    )
    return RecordingProblem(path, line, "row", f"{cells} cells", f"the header has {wanted}", remedy)


def _not_numbers(
    path: str, name: str, found: Sequence[tuple[int, str]], n_rows: int
) -> list[RecordingProblem]:
    if not found:
        return []
    limit = "every cell must be a number or empty"
    if len(found) == n_rows:
        line, cell = found[0]
        value = f"text throughout ({cell[:40]!r}, ...)"
        remedy = "delete the column or write numbers"
        return [RecordingProblem(path, line, name, value, limit, remedy)]
    remedy = "write a number with a decimal point, or leave the cell empty"
    return [
        RecordingProblem(path, line, name, f"{cell[:40]!r} is not a number", limit, remedy)
        for line, cell in found
    ]
