"""Reads and writes Parquet: units in the fields' metadata, metadata and events in the schema's."""

import json
from collections import Counter
from pathlib import Path
from typing import Final

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rig.recording.errors import RecordingError, RecordingProblem
from rig.recording.metadata import events_from, events_text
from rig.recording.recording import Recording
from rig.recording.table import Table
from rig.recording.units import unit_of

_METADATA: Final = b"rig.metadata"
_EVENTS: Final = b"rig.events"


def write_parquet(recording: Recording, path: Path) -> None:
    """Write a recording to a Parquet file; float64 is kept bit for bit."""
    schema = pa.schema(
        [
            pa.field(name, pa.float64(), metadata={"unit": unit_of(name)})
            for name in recording.channels
        ],
        metadata={
            _METADATA: json.dumps(recording.metadata),
            _EVENTS: events_text(recording.events),
        },
    )
    arrays = [pa.array(values) for values in recording.channels.values()]
    # Split byte streams bring the alike exponents together; dictionaries do not pay for noise.
    pq.write_table(
        pa.table(arrays, schema=schema),
        path,
        compression="zstd",
        use_dictionary=False,
        use_byte_stream_split=True,
    )


def read_parquet(path: str) -> Table:
    """Read a Parquet file; a null is NaN.

    Raises:
        RecordingError: the file cannot be read as Parquet at all.
    """
    try:
        # Not read_table, which fails on a column named twice.
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
            table.problems.append(
                RecordingProblem(path, None, name, value, "", "rename or delete one")
            )
            counts[name] = 1
        if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
            limit = "every column must hold numbers"
            remedy = "delete the column or convert it to double"
            table.problems.append(
                RecordingProblem(path, None, name, str(column.type), limit, remedy)
            )
            # The column stands in the table all the same, lest it be reported missing as well.
            table.columns[name] = np.full(len(arrow), np.nan)
            table.unreadable[name] = np.ones(len(arrow), dtype=np.bool_)
            continue
        table.columns[name] = np.array(column.to_numpy(), dtype=np.float64)
    return table
