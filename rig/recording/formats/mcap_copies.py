"""What the end of an MCAP file repeats of its beginning, and the checksum of all between."""

import os
import zlib
from bisect import bisect_right
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import IO, Final

from mcap.reader import SeekingReader
from mcap.records import Channel, Schema

from .mcap_reader import DAMAGE, check_summary, ends_properly

_PIECE: Final = 1 << 20
_HEAD: Final = 256
"""Bytes from the start of a file within which its header names the program that wrote it."""


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


def is_of_rig(file: IO[bytes]) -> bool:
    """Return whether the header of a file names this program as the one that wrote it."""
    file.seek(0)
    return b"rig.recording" in file.read(_HEAD)


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
