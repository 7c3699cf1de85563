"""An MCAP file is written here as a growing stream: start, chunks with their indexes, summary.

All records are those of the `mcap` library. Only its `Writer` is not used, as it needs one call per
message, some 4 ms for a second of 1 kHz data. A chunk that is built as one numpy array costs a
fraction of that.
"""

import zlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

import numpy as np
import zstandard
from mcap import records
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.writer import LIBRARY_IDENTIFIER, MCAP0_MAGIC
from numpy.typing import NDArray

COMPRESSION_LEVEL: Final = -5
"""Level of zstd. Noisy doubles hardly shrink: level 1 would save another 10 % in twice the time."""
DIVIDED_LEVEL: Final = 2
"""Level of zstd for recordings that are divided (`division_of`). With the estimates away a second
has a fifth of the bytes, so that level 2 takes no longer than -5 did, and saves 20 %; level 3 saves
nothing more."""

INDEX_ENTRY: Final = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
"""An entry for one message in a chunk's index: its time (ns) and its offset in the chunk."""


def serialised(content: Sequence[records.McapRecord]) -> bytes:
    """Return the bytes of records, one after the other, as an MCAP file has them."""
    builder = RecordBuilder()
    for record in content:
        record.write(builder)
    return builder.end()


def index_entries(log_time: NDArray[np.uint64], offset: NDArray[np.int64]) -> NDArray[Any]:
    """Return index entries (n,) for messages with these times (n,) in ns and chunk offsets (n,)."""
    entries = np.empty(len(log_time), INDEX_ENTRY)
    entries["log_time"] = log_time
    entries["offset"] = offset
    return entries


class McapStream:
    """An MCAP file that is being written; it is complete once `finish` has written the summary.

    Schemas, channels and metadata are written first, so that a file that was cut off has them.

    Attributes:
        file: the file. Its `flush` hands what is written to the operating system, and its `close`
            leaves it without a summary unless `finish` was called.
        counts: channel id -> number of messages that are written.
    """

    def __init__(
        self,
        path: Path,
        schemas: Sequence[records.Schema],
        channels: Sequence[records.Channel],
        metadata: records.Metadata,
        level: int = COMPRESSION_LEVEL,
    ) -> None:
        self._schemas = schemas
        self._channels = channels
        self._chunk_indexes: list[records.ChunkIndex] = []
        self.counts = {channel.id: 0 for channel in channels}
        self._compressor = zstandard.ZstdCompressor(level=level)
        self._position = 0
        self._crc = 0
        self.file: Final = path.open("wb")
        try:
            self._metadata_index = self._begin(metadata)
        except BaseException:
            # Closing writes what is left, which fails again where the disk is full.
            with suppress(OSError):
                self.file.close()
            raise

    def _begin(self, metadata: records.Metadata) -> records.MetadataIndex:
        """Write all that comes before the first chunk; return the index of the metadata."""
        self._put(MCAP0_MAGIC)
        self._write([records.Header(profile="", library=f"rig.recording {LIBRARY_IDENTIFIER}")])
        offset = self._position
        self._write([metadata])
        index = records.MetadataIndex(offset, self._position - offset, metadata.name)
        self._write([*self._schemas, *self._channels])
        self.file.flush()
        return index

    def write_chunk(self, content: bytes, indexes: Mapping[int, NDArray[Any]]) -> None:
        """Write Message records as one compressed chunk, followed by an index for each channel id.

        Args:
            content: the serialised Message records.
            indexes: channel id -> its index entries (n,), at least one.
        """
        times = np.concatenate([entries["log_time"] for entries in indexes.values()])
        described: dict[str, Any] = {
            "compression": "zstd",
            "message_start_time": int(times.min()),
            "message_end_time": int(times.max()),
            "uncompressed_size": len(content),
        }
        data = self._compressor.compress(content)
        start = self._position
        self._write([records.Chunk(data=data, uncompressed_crc=zlib.crc32(content), **described)])
        index_start = self._position
        offsets = {}
        for channel_id, entries in indexes.items():
            offsets[channel_id] = self._position
            self._put(_message_index(channel_id, entries))
            self.counts[channel_id] += len(entries)
        self._chunk_indexes.append(
            records.ChunkIndex(
                chunk_length=index_start - start,
                chunk_start_offset=start,
                compressed_size=len(data),
                message_index_length=self._position - index_start,
                message_index_offsets=offsets,
                **described,
            )
        )

    def finish(self) -> None:
        """Write the end of data, the summary and the footer; leave the file open."""
        # Only this checksum covers what stands outside the chunks.
        self._write([records.DataEnd(data_section_crc=self._crc)])
        groups: dict[Opcode, Sequence[records.McapRecord]] = {
            Opcode.SCHEMA: self._schemas,
            Opcode.CHANNEL: self._channels,
            Opcode.STATISTICS: [self._statistics()],
            Opcode.CHUNK_INDEX: self._chunk_indexes,
            Opcode.METADATA_INDEX: [self._metadata_index],
        }
        start = self._position
        summary = b""
        offsets = []
        for opcode, content in groups.items():
            group = serialised(content)
            offsets.append(records.SummaryOffset(opcode, start + len(summary), len(group)))
            summary += group
        footer = records.Footer(start, summary_offset_start=start + len(summary), summary_crc=0)
        summary += serialised(offsets)
        # The checksum covers the summary and the footer up to the checksum itself.
        footer.summary_crc = zlib.crc32(summary + serialised([footer])[:-4])
        self._put(summary + serialised([footer]) + MCAP0_MAGIC)

    def _put(self, data: bytes) -> None:
        self.file.write(data)
        self._position += len(data)
        self._crc = zlib.crc32(data, self._crc)

    def _write(self, content: Sequence[records.McapRecord]) -> None:
        self._put(serialised(content))

    def _statistics(self) -> records.Statistics:
        chunks = self._chunk_indexes
        return records.Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self.counts,
            chunk_count=len(chunks),
            message_count=sum(self.counts.values()),
            message_end_time=max((chunk.message_end_time for chunk in chunks), default=0),
            message_start_time=min((chunk.message_start_time for chunk in chunks), default=0),
            metadata_count=1,
            schema_count=len(self._schemas),
        )


def _message_index(channel_id: int, entries: NDArray[Any]) -> bytes:
    builder = RecordBuilder()
    builder.start_record(Opcode.MESSAGE_INDEX)
    builder.write2(channel_id)
    builder.write4(entries.nbytes)
    builder.write(entries.tobytes())
    builder.finish_record()
    return builder.end()
