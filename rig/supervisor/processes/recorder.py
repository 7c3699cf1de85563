"""The recorder writes the rows of a test from the ring to its MCAP file, in a process of its own.

It flushes twice a second, so that the death of any process costs at most a second of data. If the
supervisor is gone, the recorder writes the rest of the ring and the cause of the trip, closes the
file and ends. If an error of the operating system stops it, its exit code is the `errno`.
"""

import os
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

from rig.loop import Board, RingReader, Word, explain
from rig.recording import McapWriter, division_of

from .child import child_ends, obeyed_next, run_to_end
from .health import trips_of

POLL_S: Final = 0.02
FLUSH_S: Final = 0.5
"""Period in s of flushing: half of the second that a kill may cost, as flushing may be delayed."""
_DRAIN_S: Final = 0.5
"""Time in s for which rows are awaited after the supervisor is gone, while the loop ramps down."""
NICENESS: Final = -10
"""Niceness that is asked for, so that rows reach the disk though other programs keep all processors
busy; without the right to it (root's, or CAP_SYS_NICE) the recorder runs like any other program."""


@dataclass(frozen=True)
class BeginRecording:
    """The order to record the rows of a segment to a new file; the answer is the segment's number.

    The recorder first completes an earlier file that is still open.

    Attributes:
        segment: number of the segment, as in the rows' column `segment`.
        path: the file.
        channels: names of the rows' columns.
        metadata: metadata of the recording.
        start_ns: wall clock of the segment's tick 0, ns since 1970.
    """

    segment: int
    path: Path
    channels: tuple[str, ...]
    metadata: Mapping[str, Any]
    start_ns: int


@dataclass(frozen=True)
class NoteInRecording:
    """The order to add an event at a time of the segment, s; ignored without a file; no answer."""

    time_s: float
    kind: str
    text: str


@dataclass(frozen=True)
class FinishRecording:
    """The order to complete the file once it holds `rows` rows; the answer is how many it holds."""

    rows: int


class Recorder:
    """What works inside the recorder's process; `run` does it.

    It obeys the orders that come on the supervisor's pipe (`BeginRecording`, `NoteInRecording`,
    `FinishRecording`), and writes the rows of one segment at a time from the board's ring to a
    file. It ignores rows of other segments.

    Args:
        board: the board, to which it also writes its beat and the number of rows on disk.
        pipe: this process's end of the pipe to the supervisor.
    """

    def __init__(self, board: Board, pipe: Connection) -> None:
        self._board = board
        self._pipe = pipe
        self._ring = RingReader(board)
        self._writer: McapWriter | None = None
        self._segment = -1
        self._segment_column = 0
        self._written = 0
        self._last_s = 0.0
        self._due = -1
        self._flushed_at = 0.0

    def run(self) -> None:
        """Obey orders and record until the supervisor closes the pipe or is gone.

        A file that is open then takes the rows of another half second and the first-out cause of a
        trip, and is completed.
        """
        try:
            while obeyed_next(self._pipe, POLL_S, self._obey):
                self._take_rows()
                self._flush_if_due()
            self._end_alone()
        finally:
            self._close()

    def _obey(self, order: object) -> None:
        if isinstance(order, BeginRecording):
            self._begin(order)
        elif isinstance(order, NoteInRecording) and self._writer is not None:
            self._writer.event(order.time_s, order.kind, order.text)
        elif isinstance(order, FinishRecording):
            self._due = order.rows

    def _begin(self, order: BeginRecording) -> None:
        self._close()
        self._ring.skip_to_end()
        self._segment, self._written, self._due = order.segment, 0, -1
        self._segment_column = order.channels.index("segment")
        metadata = {**order.metadata, "start_ns": order.start_ns}
        self._writer = McapWriter(order.path, order.channels, metadata, division_of(order.channels))
        # A file that is cut off right after this has at least the metadata of its test.
        self._writer.flush()
        self._pipe.send(order.segment)

    def _take_rows(self) -> None:
        rows = self._ring.take()
        if self._writer is None or not len(rows):
            return
        if self._ring.lost:
            self._writer.event(0.0, "lost", f"{self._ring.lost} rows overwritten before recorded")
            self._ring.lost = 0
        mine = rows[rows[:, self._segment_column] == self._segment]
        self._writer.write(mine)
        self._written += len(mine)
        self._last_s = float(mine[-1, 0]) if len(mine) else self._last_s

    def _flush_if_due(self) -> None:
        now = time.monotonic()
        if self._writer is not None and now - self._flushed_at >= FLUSH_S:
            self._writer.flush()
            self._flushed_at = now
            self._board.words[Word.RECORDED] = self._written
        if self._writer is not None and 0 <= self._due <= self._written:
            self._close()
            self._pipe.send(self._written)
        self._board.words[Word.RECORDER_BEAT] = time.monotonic_ns()

    def _end_alone(self) -> None:
        """Take the last rows for an open file, and add the first-out cause to it.

        Nobody else reports the cause, as the supervisor is gone.
        """
        until = time.monotonic() + _DRAIN_S
        while self._writer is not None and time.monotonic() < until:
            time.sleep(POLL_S)
            self._take_rows()
        trips = trips_of(self._board)
        if self._writer is not None and trips:
            cause, _ = next(iter(trips.values()))
            self._writer.event(self._last_s, "trip", f"{cause.name}: {explain(cause).sentence}")

    def _close(self) -> None:
        writer, self._writer = self._writer, None
        if writer is not None:
            writer.close()


def main() -> None:
    """Run this process as the recorder of a session, until the supervisor closes the pipe.

    After an error of the operating system the exit code is its `errno`.
    """
    run_to_end("recorder", _record)


def _record() -> None:
    board, pipe = child_ends()
    with suppress(OSError):
        os.nice(NICENESS)
    Recorder(board, pipe).run()
