"""The memory that the processes of a session share: words, slow values, decisions, and the ring.

It is anonymous (memfd), so that nothing is left of it however the processes end. Every word, every
slow value and the ring have one writer each, which uses aligned 8-byte stores. A row is written
before the word that counts it (`store_release`), so that a reader that sees the count sees the row.
A `RingReader` reads every row once, in order, while the loop goes on writing.
"""

import mmap
import os
from enum import IntEnum
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.io import SLOW_INPUTS

from .decided import DECIDED
from .interlocks import PASSING_NUMBERS, PASSINGS_KEPT, PassingLog

Words = NDArray[np.int64]
Array = NDArray[np.float64]

RING_ROWS: Final = 1 << 15
"""Number of rows in the ring: 32 s at 1 kHz, far more than a recorder may fall behind."""

DECISIONS_KEPT: Final = 8
"""Number of decisions on the board, those of 4 s: far longer than the loop takes to copy one."""


class Word(IntEnum):
    """Index of each word on the board; its description begins with the process that writes it.

    Times are CLOCK_MONOTONIC in ns, and 0 before the event has happened.
    """

    ROWS = 0
    """Loop: number of rows written to the ring so far; stored after the row itself (release)."""
    LOOP_BEAT = 1
    """Loop: time at which its last tick ended."""
    FIELD_BEAT = 2
    """Field process: time at which its last cycle ended."""
    SUPERVISOR_BEAT = 3
    """Supervisor: time at which it last proved that it works."""
    RECORDER_BEAT = 4
    """Recorder: time at which its last turn ended."""
    SWITCH = 5
    """Supervisor: number of the segment that the loop must run; it leaves any other segment."""
    STOP = 6
    """Supervisor: `Action` that it asks of the loop: NONE, HOLD, RAMP_DOWN or TRIP."""
    SEGMENT = 7
    """Loop: number of the segment that it runs."""
    TICK = 8
    """Loop: number of ticks of that segment that are done."""
    LOOP_TRIP = 9
    """Loop: cause (`rig.loop.interlocks.ladder.Cause`) for which it tripped; 0 if it did not."""
    LOOP_TRIP_AT = 10
    """Loop: time at which it tripped last; LOOP_TRIP says whether that trip is still latched."""
    FIELD_TRIP = 11
    """Field process: cause for which it tripped, as LOOP_TRIP."""
    FIELD_TRIP_AT = 12
    """Field process: time at which it tripped last; see FIELD_TRIP."""
    SUPERVISOR_TRIP = 13
    """Supervisor: cause for which it tripped, as LOOP_TRIP."""
    SUPERVISOR_TRIP_AT = 14
    """Supervisor: time at which it tripped last; see SUPERVISOR_TRIP."""
    VALVE_NULL_AT = 15
    """Loop: time at which the device confirmed, after a trip, that the valve is null and off."""
    BYPASS_SHUT_AT = 16
    """Field process: time at which, after a trip, the feedback of every ball valve was shut."""
    PUMP_UNLOADED_AT = 17
    """Field process: time at which, after a trip, the pump unit confirmed that it is unloaded."""
    ACTION = 18
    """Loop: worst present `Action` of the interlock."""
    ACTION_CAUSE = 19
    """Loop: `Cause` of that action."""
    ACTION_CHANNEL = 20
    """Loop: index in `FAST_INPUTS` of the channel that the cause concerns, -1 for none."""
    MISSED = 21
    """Loop: number of ticks missed so far."""
    EXCHANGE_ERRORS = 22
    """Loop: number of exchanges that failed so far."""
    HOMED = 23
    """Loop: 1 once the encoder's zero is known; 0 before, and again after a lost count."""
    RECORDED = 24
    """Recorder: number of rows of its present file that it had written at the last flush."""
    DECISIONS = 25
    """Supervisor: number of decisions posted so far; stored after the decision (release)."""
    PUBLISHER_BEAT = 26
    """Publisher of the live stream: time at which its last turn ended."""
    PUBLISHED = 27
    """Publisher: number of the first row that it has not sent, where a restarted one goes on."""
    CHANGE = 28
    """Supervisor: number of the change of control that the loop must have taken."""
    CHANGED = 29
    """Loop: number of the newest change of control that it has taken; stored last (release)."""
    CHANGED_AT = 30
    """Loop: number of the tick in its segment from which that change holds."""
    PASSINGS = 40
    """Loop: number of limits passed so far; stored after the passing itself (release)."""
    SKIP = 41
    """Supervisor: its last order to skip a stretch of the setpoints (`skip_order`)."""
    SKIPPED = 42
    """Loop: the order in SKIP that it has looked at last; stored after LEAD (release)."""
    LEAD = 43
    """Loop: number of setpoints that its segment has skipped so far."""


_MARGIN: Final = 256
"""Number of oldest rows that a reader counts as lost, as the loop may overwrite them meanwhile."""

_WORDS: Final = 64
_SLOW: Final = 64
_DECISION: Final = 1 + len(DECIDED)
_PASSINGS_AT: Final = _WORDS + 2 * _SLOW + DECISIONS_KEPT * _DECISION
_RING_AT: Final = _PASSINGS_AT + PASSINGS_KEPT * PASSING_NUMBERS


class Board(NamedTuple):
    """The shared memory, mapped into this process; compiled code takes this tuple.

    Attributes:
        fd: descriptor to pass to child processes (`subprocess` pass_fds).
        words: int64 (64,), indexed by `Word`.
        slow: float64 (n,), the latest value of each of `SLOW_INPUTS`, SI; NaN if none ever came.
        slow_at: int64 (n,), time on CLOCK_MONOTONIC in ns at which each of these values came.
        decisions: float64 (DECISIONS_KEPT, 1 + len(DECIDED)); decision k of the session is in row
            k % DECISIONS_KEPT, which begins with the number of the segment that it is about.
        passings: float64 (PASSINGS_KEPT, PASSING_NUMBERS), the rows of a `PassingLog`.
        ring: float64 (RING_ROWS, columns); row k of the session is at k % RING_ROWS.
    """

    fd: int
    words: Words
    slow: Array
    slow_at: Words
    decisions: Array
    passings: Array
    ring: Array

    @property
    def passing_log(self) -> PassingLog:
        """The log of passed limits that is on the board."""
        return PassingLog(self.words[Word.PASSINGS : Word.PASSINGS + 1], self.passings)

    @classmethod
    def create(cls, columns: int) -> "Board":
        """Return a new board for rows of `columns` numbers: slow values are NaN, all else is 0."""
        fd = os.memfd_create("rig-board", 0)
        os.ftruncate(fd, 8 * (_RING_AT + RING_ROWS * columns))
        board = cls.attach(fd)
        board.slow[:] = np.nan
        return board

    @classmethod
    def attach(cls, fd: int) -> "Board":
        """Return the board of a descriptor that is inherited from the process that made it."""
        memory = mmap.mmap(fd, 0)
        floats, integers = np.frombuffer(memory), np.frombuffer(memory, np.int64)
        slow, slow_at = _WORDS, _WORDS + _SLOW
        return cls(
            fd,
            integers[:_WORDS],
            floats[slow : slow + len(SLOW_INPUTS)],
            integers[slow_at : slow_at + len(SLOW_INPUTS)],
            floats[_WORDS + 2 * _SLOW : _PASSINGS_AT].reshape(DECISIONS_KEPT, _DECISION),
            floats[_PASSINGS_AT:_RING_AT].reshape(PASSINGS_KEPT, PASSING_NUMBERS),
            floats[_RING_AT:].reshape(RING_ROWS, -1),
        )


class RingReader:
    """One reader of the ring, which does not disturb the loop or other readers.

    It begins with the next row that is written.

    Attributes:
        next_row: number in the session of the row that is read next.
        lost: number of rows that were overwritten, or about to be, before they were read; a caller
            may set it to 0.
    """

    def __init__(self, board: Board) -> None:
        self._words, self._ring = board.words, board.ring
        self.next_row = int(board.words[Word.ROWS])
        self.lost = 0

    def go_on_from(self, row: int) -> None:
        """Read next row number `row` of the session, or the next new row if that comes earlier.

        Rows from `row` on that are overwritten already will count as lost.
        """
        self.next_row = min(row, int(self._words[Word.ROWS]))

    @property
    def waiting(self) -> int:
        """Number of rows that are written and not yet read, those overwritten already included."""
        return int(self._words[Word.ROWS]) - self.next_row

    def skip_to_end(self) -> None:
        """Skip all rows written so far, so that the next row that is written is read next."""
        self.next_row = int(self._words[Word.ROWS])

    def take(self, most: int = RING_ROWS) -> Array:
        """Return the rows that were not yet read, at most `most`, float64 (n, columns).

        It does not wait: n is 0 if there is none. Rows that were overwritten before that, or may be
        at any moment, are left out and counted in `lost`.
        """
        end = int(self._words[Word.ROWS])
        oldest = end - RING_ROWS + _MARGIN
        if self.next_row < oldest:
            self.lost += oldest - self.next_row
            self.next_row = oldest
        end = min(end, self.next_row + most)
        rows = self._ring[np.arange(self.next_row, end) % RING_ROWS]
        self.next_row = end
        return rows

    def latest(self, count: int) -> Array:
        """Return the last rows written, at most `count`, float64 (n, columns).

        They do not count as read: `take` still returns those that it has not returned yet.
        """
        end = int(self._words[Word.ROWS])
        return self._ring[np.arange(max(end - count, 0), end) % RING_ROWS]
