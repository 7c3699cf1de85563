"""The readable records of a cut or damaged MCAP file are collected here, with what was lost."""

import os
import struct
from collections.abc import Iterator, Sequence
from io import BytesIO
from itertools import pairwise
from typing import IO, Any, Final

import numpy as np
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE
from mcap.records import Channel, Chunk, DataEnd, McapRecord, Message, Metadata, Schema
from mcap.writer import MCAP0_MAGIC
from numpy.typing import NDArray

from rig.unique_keys import json_of

from . import formats
from .errors import RecordingError

_KINDS: Final[dict[int, Any]] = {
    Opcode.SCHEMA: Schema,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.METADATA: Metadata,
    Opcode.DATA_END: DataEnd,
}
"""Kinds of records that a recording needs besides messages, by their first byte in the file."""
_LATEST_NS: Final = 2**62
"""Recordings begin before this time, ns since 1970: the year 2116. The time since the beginning may
be as long (`McapWriter`), so that their sum still fits into 64 bits with a sign."""


class DamagedFile:
    """A file whose readable records are collected.

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
        position: int | None = min(len(MCAP0_MAGIC), size)
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
        behind = size - position - FOOTER_SIZE - len(MCAP0_MAGIC)
        if behind > 0:
            self._lost.append(
                f"{behind} bytes behind the recording's end: if they are another recording, cut "
                "them off into a file of their own"
            )
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
                self._compare(record)
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

    def _compare(self, record: McapRecord) -> None:
        """Compare a schema or channel with its copy at the file's end, which was collected before.

        Raises:
            ValueError: they differ.
        """
        if isinstance(record, Schema):
            is_whole = record == self._copies.schemas.get(record.id)
        else:
            assert isinstance(record, Channel)
            is_whole = record == self._copies.channels.get(record.id)
        if not is_whole:
            raise ValueError("it differs from its copy at the file's end")

    def _take_metadata(self, record: Metadata) -> None:
        """Collect the metadata whose values can be read, and note each key whose value cannot."""
        readable = {}
        for key, text in record.metadata.items():
            try:
                value = json_of(text)
                if key == "start_ns":
                    _check_start(value)
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


def _check_start(start_ns: Any) -> None:
    """Check that the log times of samples can be counted from a time of the metadata, in ns.

    Raises:
        ValueError, TypeError, OverflowError: they cannot.
    """
    if not 0 <= int(start_ns) < _LATEST_NS:
        raise ValueError("the time does not fit into 64 bits")


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
