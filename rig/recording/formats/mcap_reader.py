"""Complete recordings that `McapWriter` wrote are read here, chunk by chunk."""

import json
import mmap
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Final, cast

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.reader import SeekingReader
from mcap.records import Chunk
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray
from zstandard import ZstdError

from rig.recording.errors import RecordingError
from rig.recording.recording import REPLAY_CHANNELS, FloatArray, Table

from .mcap_end import check_data, check_summary, ends_properly
from .mcap_writer import EVENTS_TOPIC, SAMPLES_TOPIC
from .sample_collector import DAMAGE, ForeignSchemaError, SampleCollector
from .sample_layout import RECORD_PREFIX

_HEAD: Final = 256
"""Bytes from the start of a file within which its header names the program that wrote it."""


@contextmanager
def mapped(path: str) -> Iterator[IO[bytes]]:
    """Give the block an MCAP file that is mapped into memory.

    Reading past its end then yields nothing, so that a damaged length allocates no huge buffer.

    Raises:
        RecordingError: the file is empty or not MCAP.
        OSError: the file cannot be read.
    """
    with Path(path).open("rb") as file:
        magic = file.read(len(MCAP0_MAGIC))
        if not magic or not MCAP0_MAGIC.startswith(magic):
            value = "not an MCAP file" if magic else "empty (0 bytes)"
            remedy = "give the right extension, or record again"
            raise RecordingError.of_file(path, value, remedy)
        with mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as mapping:
            yield cast(IO[bytes], mapping)


def read_mcap(path: str) -> Table:
    """Return the table in a complete MCAP file that McapWriter wrote.

    Raises:
        RecordingError: the file is cut off, damaged, too large, or written by another program, or
            the log times of its messages contradict the times in them.
    """
    collector = SampleCollector(path)
    with mapped(path) as file:
        if not ends_properly(file):
            raise _damaged(path, "cut off: the end of the file is missing")
        try:
            check_summary(file)
            _collect(file, collector)
            check_data(file)
        except ForeignSchemaError as error:
            raise foreign(path, str(error)) from None
        except RecordingError:
            raise
        except DAMAGE as error:
            raise _damaged(path, f"damaged ({_reason(error)})") from None
    collector.compare_overview()
    if count := collector.times.wrong:
        where = "one place" if count == 1 else f"{count} places"
        raise _damaged(path, f"its times contradict each other in {where}: {collector.times.first}")
    columns = columns_of(collector.channels, collector.blocks)
    replayed = () if collector.division is None else collector.division.replayed
    return Table(
        path,
        columns,
        metadata=collector.metadata,
        events=collector.events,
        replayed=replayed,
    )


def columns_of(
    channels: Sequence[str], blocks: Sequence[NDArray[np.float64]]
) -> dict[str, FloatArray]:
    """Return channel -> values (n,), contiguous, from blocks of rows (n_block, n_channels)."""
    rows = np.concatenate(blocks) if blocks else np.empty((0, len(channels)))
    return {name: np.ascontiguousarray(rows[:, k]) for k, name in enumerate(channels)}


def is_of_rig(file: IO[bytes]) -> bool:
    """Return whether the header of a file names this program as the one that wrote it."""
    file.seek(0)
    return b"rig.recording" in file.read(_HEAD)


def foreign(path: str, reason: str) -> RecordingError:
    """Return the error of an MCAP file that another program wrote; `reason` says how that shows."""
    limit = "only recordings written by rig are read"
    columns = ", ".join(REPLAY_CHANNELS)
    remedy = f"export it as CSV from the program that made it, with columns {columns}"
    return RecordingError.of_file(path, reason, remedy, limit)


def _reason(error: Exception) -> str:
    """Return in words for a user what an error on damaged bytes means.

    A library's own text is given where it is a check of the content, such as of a checksum. What
    Python says where bytes cannot be taken apart tells a user nothing.
    """
    text = " ".join(str(error).split())
    if isinstance(error, MemoryError):
        return "a record that does not fit into the memory"
    if isinstance(error, (UnicodeError, json.JSONDecodeError)):
        return "a text of wrong form"
    if text and isinstance(error, (ValueError, McapError, ZstdError)):
        return text if isinstance(error, ValueError) else f"{type(error).__name__} {text}"
    return "a record of wrong form"


def _collect(file: IO[bytes], collector: SampleCollector) -> None:
    file.seek(0)
    reader = SeekingReader(file)
    summary = reader.get_summary()
    if summary is None:
        raise ValueError("no summary")
    for record in (*summary.schemas.values(), *summary.channels.values()):
        collector.take(record)
    if not collector.channels:
        raise ForeignSchemaError(f"no topic {SAMPLES_TOPIC}")
    for metadata in reader.iter_metadata():
        collector.take(metadata)
    for index in sorted(summary.chunk_indexes, key=lambda entry: entry.chunk_start_offset):
        file.seek(index.chunk_start_offset + RECORD_PREFIX)
        collector.take_chunk(Chunk.read(ReadDataStream(file)))
    if collector.unmatched:
        raise ValueError(f"the details of {collector.unmatched} samples are missing")
    if summary.statistics is None:
        return
    found = sum(len(block) for block in collector.blocks) + len(collector.events)
    promised = sum(
        count
        for channel_id, count in summary.statistics.channel_message_counts.items()
        if summary.channels[channel_id].topic in (SAMPLES_TOPIC, EVENTS_TOPIC)
    )
    if found != promised:
        raise ValueError(f"the index leads to {found} of {promised} messages")


def _damaged(path: str, value: str) -> RecordingError:
    return RecordingError.of_file(path, value, f"rig recover {path} OUT.mcap")
