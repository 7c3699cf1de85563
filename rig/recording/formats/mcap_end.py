"""The end of an MCAP file: whether it is whole, what it repeats, and the checksums in it."""

import os
import struct
import zlib
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, Final

from mcap.opcode import Opcode
from mcap.reader import FOOTER_SIZE, SeekingReader
from mcap.records import Channel, Schema
from mcap.stream_reader import MAGIC_SIZE
from mcap.writer import MCAP0_MAGIC

from .sample_collector import DAMAGE

_DATA_END: Final = struct.Struct("<BQI")
"""The record that ends the data: opcode, length, and the checksum of all before it."""
_PIECE: Final = 1 << 20


@dataclass(frozen=True)
class EndCopies:
    """What the summary at the end of a file says of the records before it.

    Attributes:
        schemas, channels: copies of the schemas and channels, by their ids; both are empty where
            the file's end is missing or damaged.
        chunk_starts: offset in bytes of every chunk in the file, ascending.
    """

    schemas: Mapping[int, Schema] = field(default_factory=dict)
    channels: Mapping[int, Channel] = field(default_factory=dict)
    chunk_starts: Sequence[int] = ()

    def next_chunk(self, offset: int) -> int | None:
        """Return the offset of the first chunk that starts behind an offset; None if none does."""
        at = bisect_right(self.chunk_starts, offset)
        return self.chunk_starts[at] if at < len(self.chunk_starts) else None


def ends_properly(file: IO[bytes]) -> bool:
    """Return whether a file is long enough for a footer, and ends as every MCAP file does."""
    file.seek(0, os.SEEK_END)
    if file.tell() < FOOTER_SIZE + 2 * MAGIC_SIZE:
        return False
    file.seek(-MAGIC_SIZE, os.SEEK_END)
    return file.read(MAGIC_SIZE) == MCAP0_MAGIC


def check_summary(file: IO[bytes]) -> None:
    """Check the summary's checksum, as a lost chunk index would silently shorten the recording.

    Raises:
        ValueError: there is no summary, it has no checksum, which `McapWriter` always writes, or it
            or the footer is damaged.
    """
    file.seek(-FOOTER_SIZE - MAGIC_SIZE, os.SEEK_END)
    footer = file.read(FOOTER_SIZE)
    opcode, _, start, _, crc = struct.unpack("<BQQQI", footer)
    if opcode != Opcode.FOOTER or start == 0:
        raise ValueError("no summary")
    file.seek(0, os.SEEK_END)
    length = file.tell() - MAGIC_SIZE - FOOTER_SIZE - start
    file.seek(start)
    if length < 0:
        raise ValueError("the summary begins behind its end")
    if zlib.crc32(file.read(length) + footer[:-4]) != crc:
        raise ValueError(f"the summary's checksum is {'wrong' if crc else 'missing'}")


def check_data(file: IO[bytes]) -> None:
    """Check the checksum of all data before the summary, which notices a changed metadata value.

    Recordings of earlier versions have none.

    Raises:
        ValueError: the data does not end where the summary begins, or the checksum is wrong.
    """
    file.seek(-FOOTER_SIZE - MAGIC_SIZE, os.SEEK_END)
    _, _, start, _, _ = struct.unpack("<BQQQI", file.read(FOOTER_SIZE))
    end = start - _DATA_END.size
    file.seek(max(end, 0))
    opcode, _, crc = _DATA_END.unpack(file.read(_DATA_END.size))
    if end < 0 or opcode != Opcode.DATA_END:
        raise ValueError("the data does not end where the summary begins")
    if crc and checksum_before(file, end) != crc:
        raise ValueError("the checksum of all data is wrong")


def copies_at_end(file: IO[bytes]) -> EndCopies:
    """Return what the end of a file repeats, if its checksum is right; else empty copies."""
    try:
        if not ends_properly(file):
            return EndCopies()
        check_summary(file)
        file.seek(0)  # The reader reads from there when it is made.
        summary = SeekingReader(file).get_summary()
    except DAMAGE:
        return EndCopies()
    if summary is None or not summary.channels:
        return EndCopies()
    starts = sorted(index.chunk_start_offset for index in summary.chunk_indexes)
    return EndCopies(summary.schemas, summary.channels, starts)


def checksum_before(file: IO[bytes], end: int) -> int:
    """Return the CRC-32 of all bytes of a file before an offset; the file's position moves."""
    crc = 0
    file.seek(0, os.SEEK_SET)
    while end > 0:
        piece = file.read(min(end, _PIECE))
        if not piece:
            break
        crc, end = zlib.crc32(piece, crc), end - len(piece)
    return crc
