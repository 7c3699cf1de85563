"""Parquet files are read and written here, so that no damage to them goes unnoticed.

The fields' metadata hold the units, the schema's metadata hold the recording's metadata and events.
Each page of values has a checksum, and the footer, which describes columns and pages, has a hash in
front of it. Another hash, of all that the file says, is among the schema's metadata.
"""

import hashlib
import json
import os
import struct
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rig.recording.bounds import LARGEST_JSON, most_bytes, too_large
from rig.recording.errors import RecordingError
from rig.recording.recording import FloatArray, Recording, Table, content_hash, events_from
from rig.recording.units import unit_of
from rig.unique_keys import json_of

_METADATA: Final = b"rig.metadata"
_EVENTS: Final = b"rig.events"
_HASH: Final = b"rig.sha256"
_MAGIC: Final = b"PAR1"
_TAIL: Final = struct.Struct("<I4s")
"""The end of a Parquet file: the footer's length and `_MAGIC`."""
_SEAL: Final = b"rig.footer.sha256"
"""Begin of the bytes in front of the footer that hold its SHA-256, of 32 bytes."""
_SEAL_SIZE: Final = len(_SEAL) + 32
_AGAIN: Final = "fetch the file again, or export it again from its source"
_UNREADABLE: Final = (pa.ArrowException, OSError, ValueError, TypeError, KeyError, RecursionError)
"""Exceptions that Arrow and the JSON reader raise on damaged bytes."""


def write_parquet(recording: Recording, path: Path) -> None:
    """Write a recording, metadata and events included, to Parquet; floats are kept bit for bit.

    The pages have checksums. The metadata `rig.sha256` is the hash of what the file says (`_hash`).
    """
    columns = [
        pa.field(name, pa.float64(), metadata={"unit": unit_of(name)})
        for name in recording.channels
    ]
    described = {_METADATA: recording.metadata, _EVENTS: recording.events}
    texts = {key: json.dumps(content).encode() for key, content in described.items()}
    texts[_HASH] = _hash(recording.channels, texts)
    schema = pa.schema(columns, metadata=texts)
    arrays = [pa.array(values) for values in recording.channels.values()]
    # Split byte streams put similar exponents side by side; dictionaries do not pay with noise.
    table = pa.table(arrays, schema=schema)
    pq.write_table(
        table,
        path,
        compression="zstd",
        use_dictionary=False,
        use_byte_stream_split=True,
        write_page_checksum=True,
    )
    _seal_footer(path)


def _hash(channels: Mapping[str, FloatArray], texts: Mapping[bytes, bytes]) -> bytes:
    """Return the SHA-256, as hexadecimal digits, of all that a Parquet file says.

    It covers the `content_hash` of the channels, which is that of their names and values, and the
    JSON texts of metadata and events.

    Args:
        channels: channel -> values, shape (n,).
        texts: the schema's metadata, of which `_METADATA` and `_EVENTS` are covered.
    """
    digest = hashlib.sha256(content_hash(channels).encode())
    for key in (_METADATA, _EVENTS):
        digest.update(b"\0" + texts.get(key, b""))
    return digest.hexdigest().encode()


def read_parquet(path: str) -> Table:
    """Return the table in a Parquet file; a null is read as NaN.

    A repeated column, or one that does not hold numbers and becomes NaN, is reported among the
    table's problems. The checksums of pages, and the hash of the content, are verified if the file
    has them; one that another program or an earlier version wrote may have none.

    Raises:
        RecordingError: the file cannot be read as Parquet at all, is damaged, or is too large.
    """
    try:
        _check_footer(path)
        # read_table is not used, as it fails if two columns have the same name.
        with pq.ParquetFile(path, page_checksum_verification=True, pre_buffer=False) as file:
            schema, rows = file.schema_arrow, file.metadata.num_rows
            names, kinds, described = schema.names, schema.types, schema.metadata or {}
            # Others are not read, as a single row of texts or lists may take any amount of memory.
            others = {name for name, kind in zip(names, kinds, strict=True) if not _is_number(kind)}
            numbers = [name for name in names if name not in others]
            _refuse_too_large(path, file.metadata)
            arrow = file.read(columns=numbers, use_threads=False)
        metadata = json_of(described.get(_METADATA, b"{}"))
        if not isinstance(metadata, dict):
            raise ValueError("its metadata is no JSON object")
        events = events_from(described.get(_EVENTS, b"[]"))
    except RecordingError:
        raise
    except _UNREADABLE as error:
        lines = str(error).splitlines() or [type(error).__name__]
        raise RecordingError.of_file(
            path, f"cannot be read as Parquet ({lines[0]})", _AGAIN
        ) from None
    table = Table(path, {}, metadata=metadata, events=events)
    counts = Counter(names)
    read = iter(arrow.columns)
    for name, kind in zip(names, kinds, strict=True):
        if counts[name] > 1:
            value = f"{counts[name]} columns have this name"
            table.report(name, value, "rename or delete one")
            counts[name] = 1
        if name in others:
            limit = "every column must hold numbers"
            remedy = "delete the column or convert it to double"
            if not _is_number(kind):
                table.report(name, str(kind), remedy, limit)
            # The table gets a column of NaN, so that it is not reported as missing too.
            table.columns[name] = np.full(rows, np.nan)
            table.unreadable[name] = np.ones(rows, dtype=np.bool_)
            continue
        table.columns[name] = np.array(next(read).to_numpy(), dtype=np.float64)
    wanted = described.get(_HASH)
    if wanted is not None and not table.problems and _hash(table.columns, described) != wanted:
        value = "its values, names, metadata or events are not those that were written to it"
        limit = f"by the SHA-256 in its metadata, {_HASH.decode()}"
        remedy = f"{_AGAIN}; if another program changed it on purpose, delete this metadata there"
        raise RecordingError.of_file(path, value, remedy, limit)
    return table


def _seal_footer(path: Path) -> None:
    """Insert a hash of the footer before it, where Parquet's readers find no page and skip it.

    The footer is the description at the end of the file, in front of its own length and the magic
    bytes. Parquet has no checksum for it, and Arrow ends the process on some damage to it.
    """
    with path.open("r+b") as file:
        start = file.seek(0, os.SEEK_END) - _TAIL.size
        file.seek(start)
        length, _ = _TAIL.unpack(file.read(_TAIL.size))
        file.seek(start - length)
        footer = file.read()
        file.seek(start - length)
        file.write(_seal(footer) + footer)


def _seal(footer: bytes) -> bytes:
    return _SEAL + hashlib.sha256(footer).digest()


def _check_footer(path: str) -> None:
    """Check that a file and its footer are not too large, and the footer's hash if it has one.

    Raises:
        RecordingError: the file is larger than `most_bytes`, the footer than `LARGEST_JSON`, or the
            footer is damaged.
        OSError: the file cannot be read.
    """
    with Path(path).open("rb") as file:
        start = file.seek(0, os.SEEK_END) - _TAIL.size
        if start > most_bytes():
            raise too_large(path, "its bytes", start)
        file.seek(max(start, 0))
        tail = file.read()
        length, magic = _TAIL.unpack(tail) if len(tail) == _TAIL.size else (0, b"")
        if magic != _MAGIC or length > start:
            return  # Arrow says what is wrong
        if length > LARGEST_JSON:
            raise too_large(path, "its metadata", length, LARGEST_JSON)
        file.seek(max(start - length - _SEAL_SIZE, 0))
        seal, footer = file.read(_SEAL_SIZE), file.read()
    if seal.startswith(_SEAL) and seal != _seal(footer):
        raise RecordingError.of_file(path, "its description of columns is damaged", _AGAIN)


def _refuse_too_large(path: str, described: pq.FileMetaData) -> None:
    """Raise an error if the values of a file, or the pages that hold them, are too large.

    Raises:
        RecordingError: they would take more than `most_bytes`.
    """
    # What is known of a single column is not asked for: Arrow ends the process if it is damaged.
    groups = range(described.num_row_groups)
    pages = sum(described.row_group(index).total_byte_size for index in groups)
    size = max(pages, 8 * described.num_rows * described.num_columns)
    if size > most_bytes():
        what = f"{described.num_rows} rows of {described.num_columns} columns"
        raise too_large(path, what, size)


def _is_number(kind: pa.DataType) -> bool:
    return bool(pa.types.is_floating(kind) or pa.types.is_integer(kind))
