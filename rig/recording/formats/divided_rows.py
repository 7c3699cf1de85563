"""Rows whose channels are divided are kept here until their chunk of the MCAP file is written."""

import json
from typing import Any, Final

import numpy as np
from mcap.records import Channel, Message, Schema
from numpy.typing import NDArray

from rig.recording.units import unit_of

from .division import OVERVIEW_PERIOD_S, Division
from .mcap_stream import index_entries, serialised
from .packed_columns import packed
from .sample_layout import (
    DETAILS_NAME,
    OVERVIEW_NAME,
    SampleLayout,
    details_message,
    details_schema,
    overview_schema,
)

DETAILS_TOPIC: Final = "rig/details"
OVERVIEW_TOPIC: Final = "rig/overview"

_DETAILS_ID: Final = 3  # of schema and channel; samples and events have 1 and 2
_OVERVIEW_ID: Final = 4
_HALF_TICK_S: Final = 0.5e-3
"""Times are rounded, so that a row which is this little too early belongs to the next period."""


class DividedRows:
    """What the rows of a chunk hold beside their signals, until the chunk is written.

    Args:
        channels: names of all channels of a row.
        division: how they are divided.

    Attributes:
        schemas: schemas of the topics `rig/details` and `rig/overview`.
        topics: these topics, as channels of the MCAP file.
        signals: index of each signal in a row.
    """

    def __init__(self, channels: tuple[str, ...], division: Division) -> None:
        def places(names: tuple[str, ...]) -> NDArray[np.intp]:
            return np.array([channels.index(name) for name in names], dtype=np.intp)

        self.signals: Final = places(division.signals)
        self._details_at = places(division.details)
        self._overview_at = places(division.overview)
        self._layout = SampleLayout(division.overview, single=True)
        self._rows: list[NDArray[np.float64]] = []
        self._log_times: list[NDArray[np.uint64]] = []
        self._shown = 0
        self._period = -1.0
        self._then = self._shown, self._period
        self.schemas: Final = [
            Schema(_DETAILS_ID, details_schema(), "protobuf", DETAILS_NAME),
            Schema(_OVERVIEW_ID, overview_schema(division.overview), "protobuf", OVERVIEW_NAME),
        ]
        details = {"channels": json.dumps(division.details)}
        overview = {
            "channels": json.dumps(division.overview),
            "replayed": json.dumps(division.replayed),
            "units": json.dumps({name: unit_of(name) for name in division.overview}),
        }
        self.topics: Final = [
            Channel(_DETAILS_ID, DETAILS_TOPIC, "protobuf", details, schema_id=_DETAILS_ID),
            Channel(_OVERVIEW_ID, OVERVIEW_TOPIC, "protobuf", overview, schema_id=_OVERVIEW_ID),
        ]

    def take(self, rows: NDArray[np.float64], log_times: NDArray[np.uint64]) -> None:
        """Keep rows (n, n_channels) with these log times (n,) in ns for the next chunk."""
        # The caller may write over its rows.
        self._rows.append(rows.copy())
        self._log_times.append(log_times)

    def chunk(self, first: int, offset: int) -> tuple[bytes, dict[int, NDArray[Any]]]:
        """Return the messages of all rows that were kept since `clear`, and their index.

        Args:
            first: number of the first of these rows in the recording.
            offset: where the messages will stand in the chunk.
        """
        rows, log_times = np.concatenate(self._rows), np.concatenate(self._log_times)
        columns = packed(rows[:, self._details_at]) if self._details_at.size else b""
        data = details_message(first, len(rows), columns)
        at = int(log_times[0])
        message = serialised([Message(_DETAILS_ID, at, data, at, first)])
        indexes = {_DETAILS_ID: index_entries(log_times[:1], np.array([offset]))}
        overview = self._overview(rows, log_times)
        if len(overview):
            offsets = offset + len(message) + np.arange(len(overview)) * overview.dtype.itemsize
            indexes[_OVERVIEW_ID] = index_entries(overview["log_time"], offsets)
        return message + overview.tobytes(), indexes

    def clear(self) -> None:
        """Keep nothing of the rows so far, as their chunk is written."""
        self._rows, self._log_times = [], []
        self._shown, self._period = self._then

    def _overview(self, rows: NDArray[np.float64], log_times: NDArray[np.uint64]) -> NDArray[Any]:
        """Return records of the first row in each period."""
        periods = np.floor((rows[:, 0] + _HALF_TICK_S) / OVERVIEW_PERIOD_S)
        due = np.diff(periods, prepend=self._period) != 0
        records = self._layout.blank(int(np.count_nonzero(due)), _OVERVIEW_ID)
        # What no float32 can hold is an infinity in the overview.
        with np.errstate(over="ignore"):
            self._layout.set_values(records, rows[due][:, self._overview_at])
        records["log_time"] = records["publish_time"] = log_times[due]
        records["sequence"] = np.arange(self._shown, self._shown + len(records))
        self._then = self._shown + len(records), periods[-1]
        return records
