"""A recording in memory: equally long float64 channels over time, metadata and events.

A table holds the columns as they were read from a file of any format, before they are checked.
"""

import hashlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.unique_keys import json_of

from .errors import RecordingProblem
from .units import unit_of

if TYPE_CHECKING:
    from .sampling import Sampling

FloatArray = NDArray[np.float64]

REPLAY_CHANNELS: Final = ("time_s", "command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa")
"""Channels that every filter needs; `spool_m` and all others are optional."""


class Event(NamedTuple):
    """Something that happened at a time, s as in `time_s`: an injected fault, a trip, a note.

    JSON has it as a list of these three.
    """

    time_s: float
    kind: str
    text: str


def events_from(text: str | bytes) -> list[Event]:
    """Return the events in a JSON text: a list of [time_s, kind, text].

    Raises:
        ValueError, TypeError: the text is not of this form.
    """
    return [Event(float(time_s), str(kind), str(what)) for time_s, kind, what in json_of(text)]


@dataclass(frozen=True, eq=False)
class Recording:
    """A recording in memory: channels, metadata and events.

    `channels` maps names to float64 arrays of shape (n,), in the unit of the name's suffix, with
    `time_s` first. command_V of row k acts from time_s[k] to time_s[k + 1]. A missing sample is
    NaN. `source` is the path that the recording was read from; empty if it was not. `sampling` says
    how the rows of a file became the samples, if it was read by `read_measured`. `replayed` names
    the channels that the file leaves out as a replay makes them again, bit for bit: what the test's
    filter estimated (`rig.runner.outcomes.with_estimates` adds them).

    Raises:
        ValueError: a channel is not float64 of shape (n,), or the first is not `time_s`.
    """

    channels: dict[str, FloatArray] = field(repr=False)
    metadata: dict[str, Any] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    source: str = ""
    sampling: "Sampling | None" = None
    replayed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if next(iter(self.channels), None) != "time_s":
            raise ValueError(f"first channel must be time_s, got {list(self.channels)}")
        shape = (len(self.channels["time_s"]),)
        for name, values in self.channels.items():
            if values.dtype != np.float64 or values.shape != shape:
                raise ValueError(
                    f"channel {name}: {values.dtype} of shape {values.shape}, must be float64 of "
                    f"shape {shape}; convert it with numpy.asarray(values, dtype=float)"
                )

    def __getitem__(self, channel: str) -> FloatArray:
        """Return one channel, shape (n,).

        Raises:
            KeyError: there is no such channel; the message names those present.
        """
        if channel not in self.channels:
            present = ", ".join(self.channels)
            raise KeyError(f"no channel {channel!r}; the recording has {present}")
        return self.channels[channel]

    def __contains__(self, channel: str) -> bool:
        """Return whether the recording has this channel."""
        return channel in self.channels

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.channels["time_s"])

    @property
    def time_s(self) -> FloatArray:
        """Time of each sample (s), shape (n,)."""
        return self.channels["time_s"]

    unit_of = staticmethod(unit_of)

    def content_hash(self) -> str:
        """Return the SHA-256 (hex) of channel names and values, which is the same in any format.

        It does not depend on the order of channels, on metadata, events or source. All NaN count as
        equal, and -0.0 differs from 0.0.
        """
        return content_hash(self.channels)


def content_hash(channels: Mapping[str, FloatArray]) -> str:
    """Return the SHA-256 (hex) of the names and values, shape (n,), of channels.

    See `Recording.content_hash`.
    """
    digest = hashlib.sha256()
    for name in sorted(channels):
        values = channels[name]
        digest.update(f"{name}\0{len(values)}\0".encode())
        # The bits within a NaN are lost in text formats, so they must not enter the hash.
        canonical = np.where(np.isnan(values), np.nan, values)
        digest.update(np.ascontiguousarray(canonical, dtype="<f8").data)
    return digest.hexdigest()


def row_number(row: int) -> int:
    """Return the number, from 1, that messages use for a row (from 0) of a file without lines."""
    return row + 1


@dataclass
class Table:
    """The columns that a reader found in a file, with the problems that were found in them so far.

    Attributes:
        path: the file.
        columns: name -> values, float64 of shape (n,).
        problems: problems that the reader and the checks found.
        unreadable: column -> mask (n,) of cells that are NaN as they could not be read; the
            problems report these already. A column without such cells may be missing.
        line_of: returns the line, or the row's number, of row k (from 0), for messages.
        metadata: metadata of the recording.
        events: events of the recording.
        replayed: channels that the file leaves out, as in `Recording`.
    """

    path: str
    columns: dict[str, FloatArray]
    problems: list[RecordingProblem] = field(default_factory=list)
    unreadable: dict[str, NDArray[np.bool_]] = field(default_factory=dict)
    line_of: Callable[[int], int] = row_number
    metadata: dict[str, Any] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    replayed: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def unread(self, column: str) -> NDArray[np.bool_]:
        """Return the mask (n,) of a column's cells that are reported as unreadable already."""
        return self.unreadable.get(column, np.zeros(len(self), dtype=np.bool_))

    def report(
        self, name: str, value: str, remedy: str, limit: str = "", row: int | None = None
    ) -> None:
        """Add a problem of a column, `name`, to the table's problems.

        Args:
            name: the column, or another field of the file.
            value: what was found.
            remedy: what is to be done about it.
            limit: the limit that the value breaks; empty if there is none.
            row: row (from 0) at which the problem is; None if it is of the whole column.
        """
        line = None if row is None else self.line_of(row)
        self.problems.append(RecordingProblem(self.path, name, value, remedy, limit, line))
