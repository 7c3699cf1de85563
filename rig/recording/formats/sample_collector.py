"""Records of an MCAP file become blocks of samples here, without a call per sample."""

import json
import struct
import zlib
from collections.abc import Callable, Sequence
from io import BytesIO
from typing import Any, Final

import lz4.frame
import numpy as np
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Metadata, Schema
from numpy.typing import NDArray
from zstandard import ZstdError

from rig.recording.bounds import LARGEST_CHUNK, LARGEST_JSON, in_bytes, most_bytes, too_large
from rig.recording.recording import Event
from rig.unique_keys import json_of

from .divided_rows import DETAILS_TOPIC, OVERVIEW_TOPIC
from .division import Division
from .joining import Halves, NumberedRows
from .log_times import LogTimes
from .mcap_stream import serialised
from .mcap_writer import EVENTS_TOPIC, METADATA_NAME, SAMPLES_TOPIC
from .packed_columns import unpacked
from .sample_layout import (
    RECORD_PREFIX,
    SampleLayout,
    details_of,
    details_schema,
    overview_schema,
    sample_schema,
)

DAMAGE: Final = (
    McapError,
    ZstdError,
    struct.error,
    ValueError,
    TypeError,
    LookupError,
    AttributeError,
    RuntimeError,
    OverflowError,
    MemoryError,
)
"""Exceptions that the libraries raise on damaged bytes."""
_LARGEST_WINDOW: Final = 1 << 27
"""Most bytes that zstd may keep of what it has decompressed: 128 MiB, its own default."""


class ForeignSchemaError(Exception):
    """Raised for an MCAP file without samples, or with samples in a schema not of `McapWriter`."""


class SampleCollector:
    """A collector of samples, events and metadata from the records of one MCAP file.

    The records must be given to it in file order. Of a recording that is divided, a block has the
    signals of some samples with their details beside them.

    Args:
        path: the file, for messages.

    Attributes:
        blocks: arrays of samples, each of shape (n, n_channels), in file order.
        overview: pairs of log times (m,) in ns and rows (m, n_overview) of the overview, in file
            order.
        metadata: metadata of the recording.
        events: events in file order.
        times: what was found of times that contradict each other.
    """

    def __init__(self, path: str) -> None:
        self._path = path
        self._most = most_bytes()
        self._size = self._described = 0
        self._signals: Sequence[str] = ()
        self._details: Sequence[str] = ()
        self._shown: Sequence[str] = ()
        self._replayed: Sequence[str] = ()
        self._halves = Halves()
        self.overview: list[tuple[NDArray[np.uint64], NDArray[np.float64]]] = []
        self.blocks: list[NDArray[np.float64]] = []
        self.metadata: dict[str, Any] = {}
        self.events: list[Event] = []
        self.times = LogTimes()
        self._schemas: dict[int, Schema] = {}
        self._layouts: dict[int, SampleLayout] = {}
        self._overviews: dict[int, SampleLayout] = {}
        self._details_channels: set[int] = set()
        self._event_channels: set[int] = set()

    @property
    def channels(self) -> Sequence[str]:
        """Names of the channels of `blocks`; `time_s` is the first."""
        return (*self._details, *self._signals)

    @property
    def division(self) -> Division | None:
        """How the recording is divided; None if it is not."""
        if not self._details_channels:
            return None
        return Division(tuple(self._signals), tuple(self._details), tuple(self._replayed))

    def take(self, record: McapRecord) -> None:
        """Collect the content of a record that is not a chunk; ignore records of other kinds.

        Raises:
            ForeignSchemaError: the samples have another schema than McapWriter's.
            RecordingError: there is more in the file than memory can take.
            ValueError, TypeError, LookupError: the contents are not as McapWriter writes them.
        """
        if isinstance(record, Schema):
            self._schemas[record.id] = record
        elif isinstance(record, Channel):
            self._take_channel(record)
        elif isinstance(record, Metadata) and record.name == METADATA_NAME:
            self._describe(sum(map(len, record.metadata.values())))
            self.metadata = {key: json_of(text) for key, text in record.metadata.items()}
            self.times.start_ns = int(self.metadata.get("start_ns", 0))
        elif isinstance(record, Message) and record.channel_id in self._layouts:
            self._take_samples(serialised([record]), 0, record.channel_id)
        elif isinstance(record, Message) and record.channel_id in self._overviews:
            self._take_overview(serialised([record]), 0, record.channel_id)
        elif isinstance(record, Message) and record.channel_id in self._details_channels:
            self._take_details(record)
        elif isinstance(record, Message) and record.channel_id in self._event_channels:
            self._describe(len(record.data))
            content = json_of(record.data)
            event = Event(float(content["time_s"]), str(content["kind"]), str(content["text"]))
            self.events.append(event)
            self._compare(EVENTS_TOPIC, np.array([event.time_s]), record)

    def _compare(self, topic: str, time_s: NDArray[np.float64], record: Message) -> None:
        """Compare the times of a message that is of one time, (1,), s."""
        log_time = np.array([record.log_time], np.uint64)
        self.times.compare(topic, time_s, log_time)
        published = np.array([record.publish_time], np.uint64)
        self.times.compare_published(topic, log_time, published)

    def _describe(self, size: int) -> None:
        """Count a text of metadata or an event, of a size in bytes.

        Raises:
            RecordingError: the texts so far are larger than `LARGEST_JSON`.
        """
        self._described += size
        if self._described > LARGEST_JSON:
            what = "its metadata and events"
            raise too_large(self._path, what, self._described, LARGEST_JSON)

    def take_chunk(self, chunk: Chunk) -> None:
        """Check a chunk's checksum, and collect its records, whatever its compression.

        Raises:
            ForeignSchemaError: the samples have another schema than McapWriter's.
            RecordingError: there is more in the file than memory can take.
            McapError, ZstdError, ValueError, ...: one of DAMAGE; the chunk cannot be read.
        """
        data = _content_of(chunk)
        length = len(data)
        offset = 0
        while offset < length:
            opcode, content_length = struct.unpack_from("<BQ", data, offset)
            start = offset + RECORD_PREFIX
            offset = start + content_length
            content = ReadDataStream(BytesIO(data[start:offset]))
            if opcode == Opcode.SCHEMA:
                self.take(Schema.read(content))
            elif opcode == Opcode.CHANNEL:
                self.take(Channel.read(content))
            elif opcode == Opcode.MESSAGE:
                channel_id, _, log_time = struct.unpack_from("<HIQ", data, start)
                self.times.seen(np.array([log_time], np.uint64))
                if channel_id in self._layouts:
                    offset = self._take_samples(data, start - RECORD_PREFIX, channel_id)
                elif channel_id in self._overviews:
                    offset = self._take_overview(data, start - RECORD_PREFIX, channel_id)
                else:
                    self.take(Message.read(content, content_length))
        self.times.end_chunk(chunk.message_start_time, chunk.message_end_time)

    def compare_overview(self) -> None:
        """Compare the log times of the overview with all samples; nothing may be missing."""
        if self.overview and self.blocks and self.channels[0] == "time_s":
            time_s = np.concatenate([block[:, 0] for block in self.blocks])
            log_times = np.concatenate([times for times, _ in self.overview])
            self.times.compare_overview(OVERVIEW_TOPIC, time_s, log_times)

    @property
    def unmatched(self) -> int:
        """Number of samples that are in no block, as their details did not come so far."""
        return self._halves.unmatched

    def standing(self) -> tuple[int, int, int]:
        """Return how much was collected so far, for `back_to`."""
        return len(self.blocks), len(self.events), len(self.overview)

    def back_to(self, standing: tuple[int, int, int]) -> None:
        """Forget what was collected of a chunk that cannot be read, since `standing` was asked."""
        blocks, events, overview = standing
        del self.blocks[blocks:], self.events[events:], self.overview[overview:]
        self._halves.forget()

    def _take_channel(self, record: Channel) -> None:
        if record.topic == EVENTS_TOPIC:
            self._event_channels.add(record.id)
        if record.topic == SAMPLES_TOPIC:
            self._signals = self._names(record, sample_schema)
            self._layouts[record.id] = SampleLayout(self._signals)
        elif record.topic == DETAILS_TOPIC:
            self._details = self._names(record, lambda _: details_schema(), at_least=0)
            self._details_channels.add(record.id)
        elif record.topic == OVERVIEW_TOPIC:
            self._shown = self._names(record, overview_schema)
            self._replayed = [str(name) for name in json.loads(record.metadata["replayed"])]
            self._overviews[record.id] = SampleLayout(self._shown, single=True)

    def _names(
        self, record: Channel, schema_of: Callable[[Sequence[str]], bytes], at_least: int = 1
    ) -> Sequence[str]:
        """Return the names of the channels of a topic.

        Raises:
            ForeignSchemaError: the topic's schema is not what `McapWriter` makes for them.
        """
        schema = self._schemas.get(record.schema_id)
        try:
            names = [str(name) for name in json.loads(record.metadata["channels"])]
        except (KeyError, ValueError, TypeError):
            names = []
        # Samples are read by a fixed layout, which only an identical schema guarantees.
        if schema is None or len(names) < at_least or schema_of(names) != schema.data:
            called = "none" if schema is None else f"{schema.name!r} ({schema.encoding})"
            raise ForeignSchemaError(f"topic {record.topic} has another schema: {called}")
        return names

    def _take_samples(self, data: bytes, offset: int, channel_id: int) -> int:
        """Collect the run of sample records that begins at data[offset]; return its end's offset.

        Raises:
            ValueError: there is no sample record of the layout's length.
        """
        layout = self._layouts[channel_id]
        records = _run_at(layout, data, offset, channel_id, SAMPLES_TOPIC)
        self._grow(len(records) * len(layout.channels))
        values, log_times = layout.values(records), records["log_time"].copy()
        self.times.seen(log_times)
        self.times.compare_published(SAMPLES_TOPIC, log_times, records["publish_time"])
        rows = NumberedRows(int(records["sequence"][0]), values, log_times)
        self._add(self._halves.joined(signals=rows) if self._details_channels else [rows])
        return offset + records.nbytes

    def _add(self, blocks: Sequence[NumberedRows]) -> None:
        """Add whole rows to the blocks, after their times were compared with the log times."""
        for block in blocks:
            if self.channels[0] == "time_s":
                self.times.compare(SAMPLES_TOPIC, block.rows[:, 0], block.log_times)
            self.blocks.append(block.rows)

    def _take_overview(self, data: bytes, offset: int, channel_id: int) -> int:
        """Collect the run of overview records at data[offset], as `_take_samples` does."""
        layout = self._overviews[channel_id]
        records = _run_at(layout, data, offset, channel_id, OVERVIEW_TOPIC)
        self._grow(len(records) * len(layout.channels))
        log_times = records["log_time"].copy()
        self.times.seen(log_times)
        self.times.compare_published(OVERVIEW_TOPIC, log_times, records["publish_time"])
        self.overview.append((log_times, layout.values(records)))
        return offset + records.nbytes

    def _take_details(self, record: Message) -> None:
        first, rows, columns = details_of(record.data)
        # A few bytes may say that they are the same value in any number of rows.
        self._grow(rows * max(1, len(self._details)))
        details = NumberedRows(first, unpacked(columns, rows, len(self._details)))
        joined = self._halves.joined(details=details)
        self._add(joined)
        # They are as late as their first row, whose signals come before them unless the file was
        # written anew by another program.
        if joined and joined[0].first == first and self.channels[0] == "time_s":
            self._compare(DETAILS_TOPIC, joined[0].rows[:1, 0], record)

    def _grow(self, values: int) -> None:
        """Count values before they are put into memory.

        Raises:
            RecordingError: with them there are more than memory can take.
        """
        self._size += 8 * values
        if self._size > self._most:
            raise too_large(self._path, "its samples", self._size)


def _run_at(
    layout: SampleLayout, data: bytes, offset: int, channel_id: int, topic: str
) -> NDArray[Any]:
    """Return the run of records of a topic at data[offset], at least one.

    Raises:
        ValueError: there is no record of the layout's length.
    """
    records = layout.run_at(data, offset, channel_id)
    if not len(records):
        raise ValueError(f"a message of {topic} is not as long as its schema says")
    return records


def _content_of(chunk: Chunk) -> bytes:
    """Return the records of a chunk, decompressed and checked by its checksum.

    No more is decompressed than the chunk says, and that may be `LARGEST_CHUNK`.

    Raises:
        ValueError, ZstdError, RuntimeError: the chunk says or holds too much, is damaged, or has no
            checksum, which `McapWriter` always writes.
    """
    size = chunk.uncompressed_size
    if size > LARGEST_CHUNK:
        raise ValueError(f"a chunk takes {in_bytes(size)}, and may take {in_bytes(LARGEST_CHUNK)}")
    if chunk.compression == "zstd":
        unpacking = zstandard.ZstdDecompressor(max_window_size=_LARGEST_WINDOW)
        with unpacking.stream_reader(chunk.data) as content:
            data = content.read(size + 1)
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    elif chunk.compression:
        raise ValueError(f"a chunk's compression {chunk.compression[:40]!r} is not known")
    else:
        data = chunk.data
    if len(data) != size:
        raise ValueError(f"a chunk does not hold the {size} bytes that it says")
    if zlib.crc32(data) != chunk.uncompressed_crc:
        state = "wrong" if chunk.uncompressed_crc else "missing"
        raise ValueError(f"a chunk's checksum is {state}")
    return data
