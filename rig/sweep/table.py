"""Writes and reads the table of a sweep, with one row for each case, and its parts.

The metadata of each column has the column's unit and description. While the sweep runs, each
finished chunk is a file of its own, a part, from which the table is made at the end.
"""

import errno
import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rig.recording import read_bounded, replacing

from .drawing import Cases
from .group import Figures
from .motions import Column

FIGURES: Final = {
    "leak_true_m3_per_s": ("m^3/s", "mean leak flow from 2 s after the onset on"),
    "verdict": ("", "what the detector held at the end"),
    "right": ("", "whether that is what was injected"),
    "detected_at_s": ("s", "when it first held that verdict; none if it is no fault"),
    "latency_s": ("s", "from the onset to when the right verdict was first held after it"),
    "false_alarm": ("", "whether a fault was held while there was none"),
    "statistic": ("", "test statistic at the end"),
    "threshold": ("", "what a healthy rig exceeds at the stated rate of false alarms"),
    "score": ("", "how much speaks for a fault: what a ROC is drawn by"),
    "probability_healthy": ("", "of no fault; the thesis's filter tells none"),
    "leak_m3_per_s": ("m^3/s", "leak flow as estimated; the thesis's filter tells none"),
    "leak_low_m3_per_s": ("m^3/s", "its 95 % interval"),
    "leak_high_m3_per_s": ("m^3/s", "its 95 % interval"),
    "innovation_1_Pa": ("Pa", "mean |innovation| of pressure 1; of the thesis's filter"),
    "innovation_2_Pa": ("Pa", "mean |innovation| of pressure 2; of the thesis's filter"),
    "nis": ("", "mean squared innovation over its variance; 1 of a consistent filter"),
    "nis_position": ("", "that of the position; the product's filter keeps all in one"),
    "nis_pressure_1": ("", "that of pressure 1"),
    "nis_pressure_2": ("", "that of pressure 2"),
    "resets": ("", "how often the filter was found lost and started anew"),
    "lost": ("", "whether the filter followed its rig no more"),
}
"""Unit and description of each column with results of a case."""
_ABOUT: Final = b"about"
_UNIT: Final = b"unit"
_DIGEST_BYTES: Final = 32


def rows_of(
    cases: Cases, figures: Figures, asked: Mapping[str, tuple[str, str]] | None = None
) -> pa.Table:
    """Return the table's rows of some cases, with the columns drawn and the columns of results.

    A result that the filter of the sweep does not tell is missing in every row.

    Args:
        cases: the cases.
        figures: their results.
        asked: unit and description of the columns that follow from what the sweep asks, as
            `rig.sweep.asked.columns_told` returns them; none if it asks nothing.
    """
    absent = np.full(cases.numbers.size, np.nan)
    known = FIGURES | dict(asked or {})
    outcomes = {name: Column(figures.get(name, absent), *told) for name, told in known.items()}
    columns = {**cases.columns, **outcomes}
    arrays = [_array(column.values) for column in columns.values()]
    fields = [
        pa.field(name, array.type, metadata={_UNIT: column.unit, _ABOUT: column.about})
        for (name, column), array in zip(columns.items(), arrays, strict=True)
    ]
    return pa.table(arrays, schema=pa.schema(fields))


def _array(values: np.ndarray) -> pa.Array:
    """Return values (n,) as an Arrow array, in which a value that is NaN is missing.

    The array is made from the bytes because `pyarrow.array` would import pandas to check the type
    of its argument, which takes a second while other processes wait.
    """
    if values.dtype.kind in "US":
        words = [word.encode() for word in values.tolist()]
        ends = np.cumsum([0, *map(len, words)], dtype=np.int32)
        return pa.StringArray.from_buffers(len(words), _bytes(ends), pa.py_buffer(b"".join(words)))
    known = _bits(~np.isnan(values)) if values.dtype.kind == "f" else None
    content = _bits(values) if values.dtype.kind == "b" else _bytes(values)
    kind = pa.from_numpy_dtype(values.dtype)
    return pa.Array.from_buffers(kind, values.size, [known, content])


def _bytes(values: np.ndarray) -> pa.Buffer:
    return pa.py_buffer(values.tobytes())


def _bits(truths: np.ndarray) -> pa.Buffer:
    return _bytes(np.packbits(truths, bitorder="little"))


def write_table(parts: Iterable[pa.Table], path: Path) -> None:
    """Write the rows of all parts, sorted by the number of the case, as one table in Parquet.

    After a power cut the file is complete or missing.

    Raises:
        OSError: the file cannot be written.
    """
    table = pa.concat_tables(parts).sort_by("case").combine_chunks()
    with _durably(path) as partial:
        pq.write_table(table, partial, compression="zstd", write_page_checksum=True)


def write_part(rows: pa.Table, path: Path) -> None:
    """Write rows as an Arrow file; after a power cut the file is complete or missing.

    This takes a tenth of the time of writing Parquet. After the Arrow file come 32 bytes, the
    SHA-256 of the file's name and content, by which damage and exchanged files are noticed.

    Raises:
        OSError: the file cannot be written.
    """
    content = pa.BufferOutputStream()
    with pa.ipc.new_file(content, rows.schema) as writer:
        writer.write_table(rows)
    written = content.getvalue().to_pybytes()
    with _durably(path) as partial:
        partial.write_bytes(written + _digest(path, written))


def _digest(path: Path, content: bytes) -> bytes:
    return hashlib.sha256(path.name.encode() + b"\0" + content).digest()


@contextmanager
def _durably(path: Path) -> Iterator[Path]:
    """Yield a temporary path to write to; at the end its file is synced to disk and becomes `path`.

    After an exception in the context `path` stays as it was.
    """
    with replacing(path) as partial:
        yield partial
        with partial.open("rb") as written:
            os.fsync(written.fileno())
    folder = os.open(path.parent, os.O_RDONLY)
    try:
        os.fsync(folder)
    finally:
        os.close(folder)


def read_part(path: Path) -> pa.Table:
    """Return the rows in an Arrow file of `write_part`.

    Raises:
        OSError: the file cannot be read, is damaged, or was written under another name.
    """
    written = read_bounded(path)
    content, digest = written[:-_DIGEST_BYTES], written[-_DIGEST_BYTES:]
    if digest != _digest(path, content):
        raise OSError(
            errno.EIO, "it is damaged, or another part; --resume runs it again", str(path)
        )
    with pa.ipc.open_file(pa.BufferReader(content)) as reader:
        return reader.read_all()


def read_table(path: Path) -> pa.Table:
    """Return the table in a Parquet file of `write_table`.

    Raises:
        OSError: the file cannot be read.
        pyarrow.ArrowException: the file is damaged.
    """
    with pq.ParquetFile(path, page_checksum_verification=True) as file:
        return file.read()


def columns_of(table: pa.Table) -> dict[str, Any]:
    """Return the columns of a table by their names as arrays (n,), NaN for a missing number."""
    found: dict[str, Any] = {}
    for name in table.column_names:
        column = table.column(name)
        if pa.types.is_string(column.type):
            found[name] = np.array(column.to_pylist(), dtype=np.str_)
        else:
            found[name] = column.to_numpy(zero_copy_only=False)
    return found


def unit_of(table: pa.Table, name: str) -> str:
    """Return the unit of a column of a table; empty if it has none."""
    metadata = table.schema.field(name).metadata or {}
    return str(metadata.get(_UNIT, b"").decode())
