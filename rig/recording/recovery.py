"""A clean recording is made here from the readable part of a cut or damaged MCAP file."""

import os
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from itertools import pairwise
from os import PathLike, fspath
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from . import formats
from .errors import RecordingError, RecordingProblem
from .targets import replacing, target_problems

_KINDS: Final[dict[int, Any]] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.METADATA: Metadata,
}
"""Kinds of records that a recording needs besides messages, by their first byte in the file."""


_HALF_TICK_S: Final = 0.5e-3
"""Half the time between two samples, s."""


@dataclass(frozen=True, slots=True)
class RecoverySummary:
    """A summary of how much of a damaged file was saved, and what was lost.

    Attributes:
        path_in: the damaged file.
        path_out: the file that was written.
        samples_kept: samples that were written.
        samples_dropped: readable samples that were left out, on the other side of a gap.
        first_time_s, last_time_s: times in s of the first and the last sample that were written.
        events_kept: events that were written.
        lost: one sentence on each loss.
    """

    path_in: str
    path_out: str
    samples_kept: int
    samples_dropped: int
    first_time_s: float
    last_time_s: float
    events_kept: int
    lost: tuple[str, ...]

    def __str__(self) -> str:
        """Return a line on the saved part, and a further line for each loss."""
        kept = (
            f"{self.path_out}: {self.samples_kept} samples, {self.first_time_s:.9g} s to "
            f"{self.last_time_s:.9g} s, {self.events_kept} events"
        )
        losses = self.lost or ("nothing was lost",)
        return "\n".join([kept, *(f"{self.path_in}: {loss}" for loss in losses)])


def recover(path_in: str | PathLike[str], path_out: str | PathLike[str]) -> RecoverySummary:
    """Write what can be read of a damaged MCAP file to a new file; return what was saved and lost.

    A filter needs samples without gaps, so that of the stretches into which damage splits the
    recording only the longest is written, with metadata and all events that can be read. Every
    chunk is checked by its checksum. The key `recovered` is added to the metadata.

    Args:
        path_in: the damaged file, which is not changed.
        path_out: the new file.

    Raises:
        RecordingError: path_out exists, its folder does not, or it does not end with .mcap; or
            path_in does not exist, has no readable sample, is not a recording of rig, or holds more
            than memory can take.
        OSError: a file cannot be read or written.
    """
    source, target = fspath(path_in), fspath(path_out)
    problems = _path_problems(source, target)
    if problems:
        raise RecordingError(problems)
    collector = formats.SampleCollector(source)
    with formats.mapped(source) as file:
        try:
            stretches, lost = _readable(file, collector)
        except formats.ForeignSchemaError as error:
            raise formats.foreign(source, str(error)) from None
    sizes = [sum(len(block) for block in stretch) for stretch in stretches]
    best = int(np.argmax(sizes))
    if not sizes[best]:
        value = "; ".join(["no sample can be read", *lost])
        raise RecordingError.of_file(source, value, "record again")
    dropped = sum(sizes) - sizes[best]
    if dropped:
        lost.append(f"{dropped} readable samples on the other side of a gap")
    channels = formats.columns_of(collector.channels, stretches[best])
    if collector.division is not None:
        channels |= _replayed(collector, channels["time_s"])
    metadata = collector.metadata | {"recovered": {"from": Path(source).name, "lost": lost}}
    with replacing(Path(target)) as partial:
        formats.write_mcap(partial, channels, metadata, collector.events, collector.division)
    kept, (first_s, last_s) = sizes[best], channels["time_s"][[0, -1]].tolist()
    events = len(collector.events)
    return RecoverySummary(source, target, kept, dropped, first_s, last_s, events, tuple(lost))


def _replayed(
    collector: formats.SampleCollector, time_s: NDArray[np.float64]
) -> dict[str, NDArray[np.float64]]:
    """Return what the overview tells of the channels that a replay makes again, for viewers.

    They are channels of shape (n,), as `time_s`, and NaN where the overview has no row.
    """
    division = collector.division
    assert division is not None
    channels = {name: np.full(len(time_s), np.nan) for name in division.replayed}
    start_ns = int(collector.metadata.get("start_ns", 0))
    for log_times, rows in collector.overview:
        since_s = (log_times.astype(np.int64) - start_ns) * 1e-9
        at = np.searchsorted(time_s, since_s - _HALF_TICK_S)
        here = (at < len(time_s)) & (np.abs(time_s[at % len(time_s)] - since_s) < _HALF_TICK_S)
        for name, values in zip(channels, rows.T, strict=False):
            channels[name][at[here]] = values[here]
    return channels


def _path_problems(source: str, target: str) -> list[RecordingProblem]:
    problems = []
    if not Path(source).is_file():
        problems.append(RecordingProblem(source, "file", "is no file", "check the path"))
    if not target.lower().endswith(".mcap"):
        value, limit = "not an MCAP name", "must end with .mcap"
        problems.append(RecordingProblem(target, "file", value, "rename it", limit))
    return problems + target_problems(target, may_replace=False)


def _readable(
    file: IO[bytes], collector: formats.SampleCollector
) -> tuple[list[list[NDArray[np.float64]]], list[str]]:
    """Collect a file's readable records; return its stretches, and a sentence on each loss.

    A stretch is a list of sample blocks (n, n_channels) without a gap between them.

    Raises:
        ForeignSchemaError: there are no samples of rig before the end or the first damage.
    """
    file.seek(0, os.SEEK_END)
    size = file.tell()
    file.seek(0)
    lost: list[str] = []
    file.read(len(MCAP0_MAGIC))
    position = file.tell()
    try:
        for record in _records(file):
            if isinstance(record, Chunk):
                _take_chunk(record, collector, lost)
            else:
                collector.take(record)
            position = file.tell()
    except RecordingError:
        raise  # what can be read takes too much memory
    except formats.DAMAGE:
        lost.append(f"everything after byte {position} of {size}: cut off or unreadable")
    if collector.unmatched:
        lost.append(f"{collector.unmatched} samples, as their details are missing")
    if not collector.channels:
        raise formats.ForeignSchemaError("no samples of rig before the end or the first damage")
    bounds = [0, *_breaks(collector.blocks), len(collector.blocks)]
    return [collector.blocks[first:last] for first, last in pairwise(bounds)], lost


def _records(file: IO[bytes]) -> Iterator[McapRecord]:
    """Yield the records of a file, from its present position to the footer, that a recording needs.

    Raises:
        ValueError, McapError, ...: one of `DAMAGE`; a record is damaged, or there is no footer.
    """
    while True:
        opcode, length = struct.unpack("<BQ", file.read(formats.RECORD_PREFIX))
        # A power cut leaves zeros, which would otherwise be taken for millions of empty records.
        if opcode == 0:
            raise ValueError("zeros in place of a record")
        if opcode == Opcode.FOOTER:
            return
        content = file.read(length)
        if len(content) != length:
            raise ValueError("a record is cut off")
        if opcode == Opcode.MESSAGE:
            yield Message.read(ReadDataStream(BytesIO(content)), length)
        elif opcode in _KINDS:
            yield _KINDS[opcode].read(ReadDataStream(BytesIO(content)))


def _take_chunk(chunk: Chunk, collector: formats.SampleCollector, lost: list[str]) -> None:
    standing = collector.standing()
    try:
        collector.take_chunk(chunk)
    except RecordingError:
        raise
    except formats.DAMAGE as error:
        collector.back_to(standing)
        start, end = chunk.message_start_time * 1e-9, chunk.message_end_time * 1e-9
        lost.append(f"a chunk of log time {start:.9g} s to {end:.9g} s: {error}")


def _breaks(blocks: Sequence[NDArray[np.float64]]) -> list[int]:
    """Return the indices of the blocks whose first time does not follow on the block before.

    The step in time must be positive and below 1.5 times the median step.
    """
    if len(blocks) < 2:
        return []
    steps = np.diff(np.concatenate([block[:, 0] for block in blocks]))
    between = steps[np.cumsum([len(block) for block in blocks[:-1]]) - 1]
    # The comparisons are written so that NaN counts as a break.
    continues = (between > 0.0) & (between < 1.5 * float(np.median(steps)))
    return [int(k) + 1 for k in np.flatnonzero(~continues)]
