"""Parquet files are read and written here.

The fields' metadata hold the units, the schema's metadata hold the recording's metadata and events.
"""

import json
from collections import Counter
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rig.recording.errors import RecordingError
from rig.recording.recording import Recording, Table, events_from
from rig.recording.units import unit_of

_METADATA: Final = b"rig.metadata"
_EVENTS: Final = b"rig.events"


def write_parquet(recording: Recording, path: Path) -> None:
    """Write a recording, metadata and events included, to Parquet; floats are kept bit for bit."""
    columns = [
        pa.field(name, pa.float64(), metadata={"unit": unit_of(name)})
        for name in recording.channels
    ]
    described = {_METADATA: recording.metadata, _EVENTS: recording.events}
    texts = {key: json.dumps(content) for key, content in described.items()}
    schema = pa.schema(columns, metadata=texts)
    arrays = [pa.array(values) for values in recording.channels.values()]
    # Split byte streams put similar exponents side by side; dictionaries do not pay with noise.
    table = pa.table(arrays, schema=schema)
    pq.write_table(
        table, path, compression="zstd", use_dictionary=False, use_byte_stream_split=True
    )


def read_parquet(path: str) -> Table:
    """Return the table in a Parquet file; a null is read as NaN.

    A repeated column, or one that does not hold numbers and becomes NaN, is reported among the
    table's problems.

    Raises:
        RecordingError: the file cannot be read as Parquet at all.
    """
    try:
        # read_table is not used, as it fails if two columns have the same name.
        with pq.ParquetFile(path) as file:
            arrow = file.read()
        described = arrow.schema.metadata or {}
        metadata = json.loads(described.get(_METADATA, b"{}"))
        events = events_from(described.get(_EVENTS, b"[]"))
    except (pa.ArrowException, OSError, ValueError, TypeError) as error:
        value = f"cannot be read as Parquet ({str(error).splitlines()[0]})"
        remedy = "fetch the file again, or export it again from its source"
        raise RecordingError.of_file(path, value, remedy) from None
    table = Table(path, {}, metadata=metadata, events=events)
    counts = Counter(arrow.column_names)
    for position, name in enumerate(arrow.column_names):
        column = arrow.column(position)
        if counts[name] > 1:
            value = f"{counts[name]} columns have this name"
            table.report(name, value, "rename or delete one")
            counts[name] = 1
        if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
            limit = "every column must hold numbers"
            remedy = "delete the column or convert it to double"
            table.report(name, str(column.type), remedy, limit)
            # The table gets a column of NaN, so that it is not reported as missing too.
            table.columns[name] = np.full(len(arrow), np.nan)
            table.unreadable[name] = np.ones(len(arrow), dtype=np.bool_)
            continue
        table.columns[name] = np.array(column.to_numpy(), dtype=np.float64)
    return table
