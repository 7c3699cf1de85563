"""A clean recording is made here from the readable part of a cut or damaged MCAP file."""

import json
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
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message, Metadata, Schema
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
    Opcode.DATA_END: DataEnd,
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
    chunk is checked by its checksum. Damaged schemas and channels are taken from their copies at
    the file's end, and of damaged metadata the keys that can be read. The key `recovered` is added
    to the metadata.

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
        is_of_rig = formats.is_of_rig(file)
        reading = _Reading(file, collector, is_of_rig)
        try:
            stretches, lost = reading.stretches()
        except formats.ForeignSchemaError as error:
            if not is_of_rig or reading.has_copies:
                raise formats.foreign(source, str(error)) from None
            value = f"damaged ({error}), and its end holds no whole copy of what is damaged"
            raise RecordingError.of_file(source, value, "record again") from None
    if "time_s" not in collector.channels:
        value = "the topic rig/details is missing, which holds the times of the samples"
        raise RecordingError.of_file(source, value, "record again")
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


class _Reading:
    """Collects the readable records of a file.

    Args:
        file: the file.
        collector: takes what can be read.
        is_of_rig: whether the file's header says that this program wrote it.
    """

    def __init__(
        self, file: IO[bytes], collector: formats.SampleCollector, is_of_rig: bool
    ) -> None:
        self._file = file
        self._collector = collector
        self._is_of_rig = is_of_rig
        self._copies = formats.copies_at_end(file)
        self._is_described = False
        self._crc: tuple[int, int] | None = None
        self._lost: list[str] = []

    @property
    def has_copies(self) -> bool:
        """Whether the file's end holds whole copies of its schemas and channels."""
        return bool(self._copies.channels)

    def stretches(self) -> tuple[list[list[NDArray[np.float64]]], list[str]]:
        """Collect the file's readable records; return its stretches, and a sentence on each loss.

        A stretch is a list of sample blocks (n, n_channels) without a gap between them.

        Raises:
            ForeignSchemaError: there are no samples of rig before the end or the first damage, or
                they have another schema than McapWriter's.
        """
        for copy in (*self._copies.schemas.values(), *self._copies.channels.values()):
            self._collector.take(copy)
        self._file.seek(0, os.SEEK_END)
        size = self._file.tell()
        position: int | None = len(MCAP0_MAGIC)
        while position is not None:
            position = self._read_from(position, size)
        collector, lost = self._collector, self._lost
        if collector.unmatched:
            lost.append(f"{collector.unmatched} samples, as their details are missing")
        if not collector.channels:
            raise formats.ForeignSchemaError("no samples of rig before the end or the first damage")
        if self._is_of_rig and not self._is_described:
            lost.append("the metadata: its record is damaged or missing")
        if not lost and self._is_changed():
            lost.append(
                "the checksum of the whole data is wrong, and that of each chunk is right: "
                "something outside the samples and events is damaged, perhaps the metadata"
            )
        bounds = [0, *_breaks(collector.blocks), len(collector.blocks)]
        return [collector.blocks[first:last] for first, last in pairwise(bounds)], lost

    def _read_from(self, position: int, size: int) -> int | None:
        """Collect the records from an offset on, to the end or to one whose length is damaged.

        Return the offset of the next chunk behind such a record, where reading goes on; None if
        none is known.
        """
        self._file.seek(position)
        try:
            for opcode, content in self._contents():
                self._take(opcode, content, position)
                position = self._file.tell()
        except RecordingError:
            raise  # what can be read takes too much memory
        except formats.DAMAGE:
            following = self._copies.next_chunk(position)
            if following is None:
                until = f"everything after byte {position} of {size}: cut off or unreadable"
            else:
                until = f"bytes {position} to {following} of {size}: unreadable"
            self._lost.append(until)
            return following
        return None

    def _contents(self) -> Iterator[tuple[int, bytes]]:
        """Yield opcode and content of each record, from the present position to the footer.

        Raises:
            ValueError, struct.error: the length of a record is damaged, or there is no footer.
        """
        while True:
            start = self._file.tell()
            following = self._copies.next_chunk(start)
            opcode, length = struct.unpack("<BQ", self._file.read(formats.RECORD_PREFIX))
            # A power cut leaves zeros, which would otherwise be taken for millions of empty
            # records.
            if opcode == 0:
                raise ValueError("zeros in place of a record")
            end = start + formats.RECORD_PREFIX + length
            if following is not None and (end > following or opcode == Opcode.FOOTER):
                raise ValueError("a record reaches into the chunk that follows it")
            if opcode == Opcode.FOOTER:
                return
            content = self._file.read(length)
            if len(content) != length:
                raise ValueError("a record is cut off")
            yield opcode, content

    def _take(self, opcode: int, content: bytes, start: int) -> None:
        """Collect the record that starts at an offset, or note that it cannot be read."""
        collector = self._collector
        if opcode != Opcode.MESSAGE and opcode not in _KINDS:
            return
        try:
            stream = ReadDataStream(BytesIO(content))
            if opcode == Opcode.MESSAGE:
                collector.take(Message.read(stream, len(content)))
                return
            record = _KINDS[opcode].read(stream)
            if isinstance(record, Chunk):
                _take_chunk(record, collector, self._lost)
            elif isinstance(record, DataEnd):
                self._crc = start, record.data_section_crc
            elif isinstance(record, Metadata):
                self._take_metadata(record)
            elif self.has_copies:
                self._compare(record, start)
            else:
                self._take_uncopied(record)
        except RecordingError:
            raise
        except formats.DAMAGE:
            name = Opcode(opcode).name.lower().replace("_", " ")
            copied = opcode in (Opcode.SCHEMA, Opcode.CHANNEL) and self.has_copies
            instead = "; its copy at the file's end was used" if copied else ""
            self._lost.append(f"the {name} record at byte {start}: damaged{instead}")

    def _take_uncopied(self, record: McapRecord) -> None:
        """Collect a schema or channel of which the file's end has no copy.

        Raises:
            ForeignSchemaError: the samples have another schema than McapWriter's.
        """
        try:
            self._collector.take(record)
        except formats.ForeignSchemaError:
            # A replay makes again what the overview shows, so that the samples can do without it.
            is_overview = isinstance(record, Channel) and record.topic == formats.OVERVIEW_TOPIC
            if not (self._is_of_rig and is_overview):
                raise
            self._lost.append("the overview of what a replay makes again: its schema is damaged")

    def _compare(self, record: McapRecord, start: int) -> None:
        """Note if a schema or channel differs from its copy at the file's end, which is used."""
        if isinstance(record, Schema):
            kind, is_whole = "schema", record == self._copies.schemas.get(record.id)
        else:
            assert isinstance(record, Channel)
            kind, is_whole = "channel", record == self._copies.channels.get(record.id)
        if not is_whole:
            self._lost.append(
                f"the {kind} record at byte {start}: damaged; its copy at the file's end was used"
            )

    def _take_metadata(self, record: Metadata) -> None:
        """Collect the metadata whose values can be read, and note each key whose value cannot."""
        readable = {}
        for key, text in record.metadata.items():
            try:
                json.loads(text)
                readable[key] = text
            except formats.DAMAGE:
                self._lost.append(f"the metadata {key[:80]!r}: damaged")
        self._collector.take(Metadata(record.name, readable))
        self._is_described |= record.name == formats.METADATA_NAME

    def _is_changed(self) -> bool:
        """Return whether the file has a checksum of all its data, and that is wrong."""
        if self._crc is None or not self._crc[1]:
            return False
        end, crc = self._crc
        return formats.checksum_before(self._file, end) != crc


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
