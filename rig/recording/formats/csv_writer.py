"""CSV and gzipped CSV files are written here, which read back bit for bit."""

import csv
import gzip
import io
from pathlib import Path
from typing import IO, Final, cast

import pyarrow as pa
import pyarrow.csv as pacsv

from rig.recording.recording import Recording

_GZIP_LEVEL: Final = 1


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
    arrays = [pa.array(values, from_pandas=True) for values in recording.channels.values()]
    table = pa.table(arrays, names=list(recording.channels))
    pacsv.write_csv(table, file, pacsv.WriteOptions(include_header=False))
