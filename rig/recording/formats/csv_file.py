"""CSV and gzipped CSV are read and written here, so that they read back bit for bit.

They are read fast if all cells are numbers, else with line numbers for what is wrong.
"""

import csv
import gzip
import io
import math
import re
import zlib
from array import array
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import IO, Final, cast

import numpy as np
import pyarrow as pa
import pyarrow.csv as pacsv
from numpy.typing import NDArray

from rig.recording.bounds import LONGEST_LINE, in_bytes, most_bytes, too_large
from rig.recording.errors import RecordingError, RecordingProblem
from rig.recording.recording import REPLAY_CHANNELS, FloatArray, Recording, Table

_GZIP_MAGIC: Final = b"\x1f\x8b"
_GZIP_LEVEL: Final = 1
_LINE_BYTES: Final = 64
"""Bytes that a short line takes in a list: 33 of the object, its text, and 8 of the list."""
_MOST_REPORTED: Final = 1000
"""Cells of a column that are reported one by one as no numbers; the others are only counted."""
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
    _refuse_too_many_cells(path, text, len(names))
    kept = {name: names.index(name) for name in names if name}
    table = Table(path, {}, problems, line_of=_line_numbers(text))
    try:
        columns = _fast_columns(text, len(names))
    except pa.ArrowInvalid:
        columns, unreadable = _careful_columns(table, text, names)
        table.unreadable = {name: unreadable[index] for name, index in kept.items()}
    table.columns = {name: columns[index] for name, index in kept.items()}
    return table


def _text(path: str) -> bytes:
    compressed = path.lower().endswith(".gz")
    with Path(path).open("rb") as file:
        magic = file.read(len(_GZIP_MAGIC))
        file.seek(0)
        if not magic:
            remedy = "record again or fetch the file again"
            raise RecordingError.of_file(path, "empty (0 bytes)", remedy)
        if (magic == _GZIP_MAGIC) != compressed:
            value = "not gzip-compressed" if compressed else "gzip-compressed"
            wanted = path[: -len(".gz")] if compressed else f"{path}.gz"
            limit = "its extension says otherwise"
            raise RecordingError.of_file(path, value, f"rename to {wanted}", limit)
        if not compressed:
            return _bounded(path, file)
        return _decompressed(path, file)


def _decompressed(path: str, file: IO[bytes]) -> bytes:
    """Return the text of a gzipped file, whose checksum is verified.

    Raises:
        RecordingError: the file is cut off or damaged, or its text is too large.
    """
    try:
        with gzip.GzipFile(fileobj=file) as text:
            return _bounded(path, cast(IO[bytes], text))
    except (EOFError, OSError, zlib.error) as error:
        cut = isinstance(error, EOFError)
        value = "gzip data is cut off" if cut else f"gzip data is corrupt ({error})"
        remedy = f"fetch the file again, or keep what is readable: zcat {path} > salvaged.csv"
        raise RecordingError.of_file(path, value, remedy) from None


def _bounded(path: str, file: IO[bytes]) -> bytes:
    """Return what is left of a file, of which no more is read than a recording may have.

    Raises:
        RecordingError: there is more than `most_bytes`, or a line is longer than `LONGEST_LINE`.
    """
    most = most_bytes()
    text = bytearray()
    lines = 0
    while piece := file.read(LONGEST_LINE):
        text += piece
        lines += piece.count(b"\n")
        size = max(len(text), lines * _LINE_BYTES)
        if size > most:
            raise too_large(path, f"{lines} lines of text and more", size)
        # This also stops a file of zeros, which a few bytes on disk can stand for, at its start.
        if len(piece) == LONGEST_LINE and not (b"\n" in piece or b"\r" in piece):
            value = f"a line is longer than {in_bytes(LONGEST_LINE)}"
            remedy = "is it a recording? Write one line for each sample"
            raise RecordingError.of_file(path, value, remedy)
    return bytes(text)


def _refuse_too_many_cells(path: str, text: bytes, columns: int) -> None:
    """Raise an error if the values of a text with so many columns would fill the memory.

    A line costs `_LINE_BYTES` while the text is read carefully, even if it is blank.

    Raises:
        RecordingError: they would take more than `most_bytes`.
    """
    lines = max(text.count(b"\n"), text.count(b"\r"))
    size = lines * max(8 * columns, _LINE_BYTES)
    if size > most_bytes():
        raise too_large(path, f"{lines} lines of {columns} columns", size)


def _header(path: str, text: bytes) -> tuple[list[str], list[RecordingProblem]]:
    try:
        line = _first_line(text).decode("utf-8-sig")
    except UnicodeDecodeError:
        remedy = "save the file as CSV in UTF-8"
        raise _bad_header(path, "not text", remedy, "UTF-8 column names") from None
    names = _cells(line)
    _refuse_other_delimiter(path, line, names)
    if all(_is_number(name) for name in names):
        limit = f"line 1 must name the columns: {', '.join(REPLAY_CHANNELS)}, ..."
        raise _bad_header(path, "has numbers only", "insert a header line", limit)
    problems = []
    for position, name in enumerate(names):
        if not name:
            remedy = "name the column or delete it (pandas: to_csv(index=False))"
            field, value = f"column {position + 1}", "has no name"
            problems.append(RecordingProblem(path, field, value, remedy, line=1))
        elif name in names[:position]:
            value = f"columns {names.index(name) + 1} and {position + 1} have this name"
            problems.append(RecordingProblem(path, name, value, "rename or delete one", line=1))
    return names, problems


def _bad_header(path: str, value: str, remedy: str, limit: str) -> RecordingError:
    return RecordingError([RecordingProblem(path, "header", value, remedy, limit, 1)])


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
            raise _bad_header(path, f"separated by {called}", remedy, "must be commas")


def _cells(line: str) -> list[str]:
    """Return the cells of a line; the line as one cell if it has one that is too long to read."""
    try:
        return [cell.strip() for cell in next(csv.reader([line], skipinitialspace=True), [])]
    except csv.Error:
        return [line]


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

    @cache
    def numbers() -> list[int]:
        lines = text.splitlines()[1:]
        return [number for number, line in enumerate(lines, 2) if line.strip()]

    return lambda row: numbers()[row]


def _fast_columns(text: bytes, n_columns: int) -> list[FloatArray]:
    """Return the columns, each of shape (n,), of a text whose cells are all numbers or empty.

    Raises:
        pyarrow.ArrowInvalid: a cell is not a number, or a row has another number of cells.
    """
    keys = [str(position) for position in range(n_columns)]
    if not text[len(_first_line(text)) :].strip():
        return [np.empty(0) for _ in keys]
    kinds = {key: pa.float64() for key in keys}
    read = pacsv.ReadOptions(column_names=keys, skip_rows=1, use_threads=False)
    convert = pacsv.ConvertOptions(column_types=kinds, null_values=list(_MISSING))
    table = pacsv.read_csv(pa.BufferReader(text), read_options=read, convert_options=convert)
    # The columns are copied, as pyarrow's own buffers are read-only.
    return [np.array(table[key].to_numpy(), dtype=np.float64) for key in keys]


def _careful_columns(
    table: Table, text: bytes, names: Sequence[str]
) -> tuple[list[FloatArray], NDArray[np.bool_]]:
    """Return the columns and a mask of unreadable cells; report the problems of those cells.

    Each column has shape (n,), with NaN for unreadable cells; the mask has shape (n_columns, n).
    """
    # An array of doubles takes a quarter of the memory of a list of floats.
    values, unreadable, rows = array("d"), bytearray(), 0
    wrong: dict[str, list[tuple[int, str]]] = {name: [] for name in names}
    counts = dict.fromkeys(names, 0)
    lines = text.splitlines()
    for number, raw in enumerate(lines[1:], 2):
        if not raw.strip():
            continue
        row, rows = rows, rows + 1
        cells = _cells(raw.decode("utf-8", errors="replace"))
        if len(cells) != len(names):
            remedy = "complete or delete the line"
            if number == len(lines):
                remedy = "delete the line: the file was cut off in it"
            limit = f"the header has {len(names)}"
            table.report("row", f"{len(cells)} cells", remedy, limit, row)
            values.extend([math.nan] * len(names))
            unreadable.extend([True] * len(names))
            continue
        for name, cell in zip(names, cells, strict=True):
            value = _number(cell)
            values.append(math.nan if value is None else value)
            unreadable.append(value is None)
            if value is None:
                counts[name] += 1
                if counts[name] <= _MOST_REPORTED:
                    wrong[name].append((row, cell))
    for name, found in wrong.items():
        _report_texts(table, name, found, counts[name], rows)
    columns = np.frombuffer(values, dtype=np.float64).reshape(-1, len(names)).T
    mask = np.frombuffer(unreadable, dtype=np.bool_).reshape(-1, len(names)).T
    return list(np.ascontiguousarray(columns)), mask


def _number(cell: str) -> float | None:
    if cell in _MISSING:
        return float("nan")
    try:
        # float() would read 1_000 as a number.
        return None if "_" in cell else float(cell)
    except ValueError:
        return None


def _report_texts(
    table: Table, name: str, found: Sequence[tuple[int, str]], count: int, n_rows: int
) -> None:
    """Report the cells of a column that are no numbers.

    If all of the `n_rows` cells are, there is one report on the column.

    Args:
        table: the table, to which the problems are added.
        name: the column.
        found: the first of these cells, `_MOST_REPORTED` at most, as (row, text).
        count: how many of these cells there are.
        n_rows: how many cells the column has.
    """
    limit = "every cell must be a number or empty"
    remedy = "write a number with a decimal point, or leave the cell empty"
    if found and count == n_rows:
        row, cell = found[0]
        value = f"text throughout ({cell[:40]!r}, ...)"
        table.report(name, value, "delete the column or write numbers", limit, row)
        return
    for row, cell in found:
        table.report(name, f"{cell[:40]!r} is not a number", remedy, limit, row)
    if count > len(found):
        table.report(name, f"{count - len(found)} further cells are no numbers", remedy, limit)


def write_csv(recording: Recording, path: Path, *, compressed: bool) -> None:
    """Write a recording's channels as CSV: a header line, then one row per sample.

    Floats are written in their shortest exact form, NaN as an empty cell. The file is gzipped if
    `compressed`. Metadata and events are not written.
    """
    with path.open("wb") as file:
        if not compressed:
            _write_text(recording, file)
            return
        # The gzip header has neither name nor time, so that equal recordings make equal files.
        with gzip.GzipFile("", "wb", _GZIP_LEVEL, file, mtime=0) as packed:
            _write_text(recording, cast(IO[bytes], packed))


def _write_text(recording: Recording, file: IO[bytes]) -> None:
    header = io.StringIO(newline="")
    csv.writer(header, lineterminator="\n").writerow(recording.channels)
    file.write(header.getvalue().encode())
    arrays = [_without_nan(values) for values in recording.channels.values()]
    table = pa.table(arrays, names=list(recording.channels))
    pacsv.write_csv(table, file, pacsv.WriteOptions(include_header=False))


def _without_nan(values: FloatArray) -> pa.Array:
    """Return the values of a channel for Arrow, without those that are NaN.

    `pa.array` would load pandas for that, for seconds on a busy machine, even while the rig is
    being left after a trip, whose report has its last rows as CSV.
    """
    present = pa.py_buffer(np.packbits(~np.isnan(values), bitorder="little"))
    numbers = pa.py_buffer(np.ascontiguousarray(values))
    return pa.Array.from_buffers(pa.float64(), len(values), [present, numbers])
