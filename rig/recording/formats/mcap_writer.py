"""A recording is written to MCAP while it is made; a killed process loses at most a second."""

import json
import re
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from os import PathLike, fspath
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.records import Channel, Message, Metadata, Schema
from numpy.typing import NDArray

from rig.recording.errors import RecordingError, RecordingProblem
from rig.recording.recording import Event
from rig.recording.targets import metadata_texts, target_problems
from rig.recording.units import unit_of

from .divided_rows import DividedRows
from .division import Division
from .mcap_stream import COMPRESSION_LEVEL, DIVIDED_LEVEL, McapStream, index_entries, serialised
from .sample_layout import MESSAGE_NAME, SampleLayout, sample_schema

SAMPLES_TOPIC: Final = "rig/samples"
EVENTS_TOPIC: Final = "rig/events"
METADATA_NAME: Final = "rig"
CHUNK_SAMPLES: Final = 1000
"""Samples of a chunk: one second, which is the most that a killed process loses."""

_SAMPLES_ID: Final = 1  # of schema and channel
_EVENTS_ID: Final = 2
_EVENT_SCHEMA: Final = {
    "title": "rig.Event",
    "type": "object",
    "properties": {
        "time_s": {"type": "number"},
        "kind": {"type": "string"},
        "text": {"type": "string"},
    },
}


class McapWriter(AbstractContextManager["McapWriter"]):
    """A context manager that writes samples and events of one recording to an MCAP file.

    Samples are messages of topic `rig/samples` (protobuf, one double per channel), events of topic
    `rig/events` (JSON). With a `division`, messages of `rig/samples` have its signals only; its
    details follow packed, one message of `rig/details` a chunk, and all channels but the signals
    have 50 rows a second, as float32, on `rig/overview`. The metadata is a Metadata record `rig` at
    the start, with one JSON text per key. Every CHUNK_SAMPLES samples, and at `flush()`, all data
    so far is handed to the operating system, so that it survives the death of this process (but not
    a power cut).

    Args:
        path: the file to make.
        channels: names of the channels, which are protobuf identifiers; the first is `time_s`.
        metadata: values that JSON can hold; they are stored exactly. The value of key "start_ns" is
            also taken as the log time of time_s = 0, ns since an epoch; it is 0 without that key.
        division: how the channels are divided; if not given, every channel has its double in the
            message of each sample.

    Raises:
        RecordingError: the file exists or its folder does not, or a channel name or metadata
            cannot be written.
    """

    def __init__(
        self,
        path: str | PathLike[str],
        channels: Sequence[str],
        metadata: Mapping[str, Any] | None = None,
        division: Division | None = None,
    ) -> None:
        self.path: Final = fspath(path)
        given = metadata or {}
        texts, problems = metadata_texts(self.path, given)
        problems += channel_problems(self.path, channels)
        problems += target_problems(self.path, may_replace=False)
        if problems:
            raise RecordingError(problems)

        self._start_ns = int(given.get("start_ns", 0))
        self._channels = tuple(channels)
        if division is None or not division.overview:
            signals, self._beside = self._channels, None
        else:
            signals, self._beside = division.signals, DividedRows(self._channels, division)
        self._layout = SampleLayout(signals)
        self._records = self._layout.blank(CHUNK_SAMPLES, _SAMPLES_ID)
        self._pending = 0
        self._pending_events: list[Message] = []
        names = {
            "channels": json.dumps(list(signals)),
            "units": json.dumps({name: unit_of(name) for name in signals}),
        }
        event_schema = json.dumps(_EVENT_SCHEMA).encode()
        self._stream = McapStream(
            Path(self.path),
            [
                Schema(_SAMPLES_ID, sample_schema(signals), "protobuf", MESSAGE_NAME),
                Schema(_EVENTS_ID, event_schema, "jsonschema", "rig.Event"),
                *(self._beside.schemas if self._beside else ()),
            ],
            [
                Channel(_SAMPLES_ID, SAMPLES_TOPIC, "protobuf", names, schema_id=_SAMPLES_ID),
                Channel(_EVENTS_ID, EVENTS_TOPIC, "json", {}, schema_id=_EVENTS_ID),
                *(self._beside.topics if self._beside else ()),
            ],
            Metadata(name=METADATA_NAME, metadata=texts),
            DIVIDED_LEVEL if self._beside else COMPRESSION_LEVEL,
        )

    def __exit__(self, *_: object) -> None:
        self.close()

    def write(self, rows: NDArray[np.float64]) -> None:
        """Append samples: rows of shape (n, n_channels), in the order of the channels, SI.

        Raises:
            ValueError: the shape is another, or a time is not finite, or negative by more than
                `start_ns`; then no row is added.
        """
        rows = np.asarray(rows, dtype=np.float64)
        if rows.ndim != 2 or rows.shape[1] != len(self._channels):
            raise ValueError(
                f"{self.path}: rows of shape {rows.shape}, must be (n, "
                f"{len(self._channels)}) for {', '.join(self._channels)}"
            )
        log_times = self._log_times(rows[:, 0])
        done = 0
        while done < len(rows):
            count = min(len(rows) - done, CHUNK_SAMPLES - self._pending)
            records = self._records[self._pending : self._pending + count]
            some, times = rows[done : done + count], log_times[done : done + count]
            if self._beside is not None:
                self._beside.take(some, times)
                some = some[:, self._beside.signals]
            self._layout.set_values(records, some)
            records["log_time"] = records["publish_time"] = times
            first = self._stream.counts[_SAMPLES_ID] + self._pending
            records["sequence"] = np.arange(first, first + count)
            self._pending += count
            done += count
            if self._pending == CHUNK_SAMPLES:
                self.flush()

    def event(self, time_s: float, kind: str, text: str) -> None:
        """Add an event that happened at time_s (s); the next flush writes it.

        Raises:
            ValueError: the time is not finite, or negative by more than `start_ns`.
        """
        log_time = int(self._log_times(np.array([time_s]))[0])
        data = json.dumps({"time_s": float(time_s), "kind": kind, "text": text}).encode()
        number = self._stream.counts[_EVENTS_ID] + len(self._pending_events)
        self._pending_events.append(Message(_EVENTS_ID, log_time, data, log_time, number))

    def flush(self) -> None:
        """End the present chunk, and hand all data so far to the operating system."""
        if self._pending or self._pending_events:
            self._write_chunk()
        self._stream.file.flush()

    def close(self) -> None:
        """Flush, write the summary that makes the file complete, and close it.

        Repeated calls do nothing.
        """
        if self._stream.file.closed:
            return
        try:
            self.flush()
            self._stream.finish()
        finally:
            self._stream.file.close()

    def _log_times(self, time_s: NDArray[np.float64]) -> NDArray[np.uint64]:
        nanoseconds = np.rint(time_s * 1e9)
        # NaN compares false, so it is refused too.
        valid = (nanoseconds >= -float(self._start_ns)) & (nanoseconds < 2.0**62)
        if not valid.all():
            worst = time_s[int(np.argmin(valid))]
            raise ValueError(
                f"{self.path}: time_s = {worst:g} s, must be finite and not before the epoch"
            )
        return (nanoseconds.astype(np.int64) + self._start_ns).astype(np.uint64)

    def _write_chunk(self) -> None:
        samples = self._records[: self._pending]
        events = self._pending_events
        indexes = {}
        content = samples.tobytes()
        if len(samples):
            offsets = np.arange(len(samples)) * self._layout.dtype.itemsize
            indexes[_SAMPLES_ID] = index_entries(samples["log_time"], offsets)
            if self._beside is not None:
                first = self._stream.counts[_SAMPLES_ID]
                beside, of_them = self._beside.chunk(first, len(content))
                content += beside
                indexes |= of_them
        encoded = [serialised([event]) for event in events]
        if events:
            lengths = [len(content), *(len(record) for record in encoded[:-1])]
            times = np.array([event.log_time for event in events], dtype=np.uint64)
            indexes[_EVENTS_ID] = index_entries(times, np.cumsum(lengths))
        self._stream.write_chunk(b"".join([content, *encoded]), indexes)
        self._pending = 0
        self._pending_events = []
        if self._beside is not None:
            self._beside.clear()


def write_mcap(
    path: str | PathLike[str],
    channels: Mapping[str, NDArray[np.float64]],
    metadata: Mapping[str, Any],
    events: Sequence[Event],
    division: Division | None = None,
) -> None:
    """Write a whole recording (channels of shape (n,), SI) to a new MCAP file.

    `division` is as with `McapWriter`.

    Raises:
        RecordingError: the file exists or its folder does not, or a channel name or metadata cannot
            be written.
        ValueError: a time is not finite, or negative by more than `metadata["start_ns"]`.
    """
    with McapWriter(path, list(channels), metadata, division) as writer:
        for event in events:
            writer.event(*event)
        writer.write(np.column_stack(list(channels.values())))


def channel_problems(path: str, channels: Sequence[str]) -> list[RecordingProblem]:
    """Return a problem for each reason why these channels cannot be the fields of a sample."""
    found = []
    if not channels or channels[0] != "time_s":
        first = repr(channels[0]) if channels else "none"
        found.append((first, "reorder them", "the first channel must be time_s"))
    for position, name in enumerate(channels):
        if not re.fullmatch(r"[A-Za-z_][A-Za-z0-9_]*", name):
            limit = "letters, digits and _ only, to be a protobuf field"
            found.append((repr(name), "rename it", limit))
        if name in channels[:position]:
            found.append((repr(name), "rename or drop it", "given twice"))
    return [RecordingProblem(path, "channels", *each) for each in found]
