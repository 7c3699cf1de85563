"""The memory that the processes of a session share: words, slow values, decisions, and the ring.

It is anonymous (memfd), so that nothing is left of it however the processes end. Every word, every
slow value and the ring have one writer each; all are aligned 8-byte stores. A row is written before
the index that counts it (`store_release`), so a reader that sees the index sees the row.
"""

import mmap
import os
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.io import SLOW_INPUTS

from .decided import DECIDED

Words = NDArray[np.int64]
Array = NDArray[np.float64]

RING_ROWS: Final = 1 << 15
"""Rows the ring holds: 32 s at 1 kHz, far more than a recorder can fall behind and recover."""

DECISIONS_KEPT: Final = 8
"""Decisions that stand on the board, the last 4 s: far longer than the loop takes to copy one."""


class Word(IntEnum):
    """Index of each word, with its writer; times are CLOCK_MONOTONIC in ns, 0 if it never was."""

    ROWS = 0
    """Loop: rows written to the ring so far; written last (release)."""
    LOOP_BEAT = 1
    """Loop: when its last tick ended."""
    FIELD_BEAT = 2
    """Field process: when its last cycle ended."""
    SUPERVISOR_BEAT = 3
    """Supervisor: when it last proved that it works."""
    RECORDER_BEAT = 4
    """Recorder: when its last flush ended."""
    SWITCH = 5
    """Supervisor: number of the segment the loop shall be in; it leaves an open-ended one then."""
    STOP = 6
    """Supervisor: `Action` asked of the loop: NONE, HOLD, RAMP_DOWN or TRIP."""
    SEGMENT = 7
    """Loop: number of the segment it is in."""
    TICK = 8
    """Loop: ticks of that segment done."""
    LOOP_TRIP = 9
    """Loop: cause (`rig.loop.interlocks.ladder.Cause`) for which it tripped; 0 none."""
    LOOP_TRIP_AT = 10
    FIELD_TRIP = 11
    """Field process: as LOOP_TRIP."""
    FIELD_TRIP_AT = 12
    SUPERVISOR_TRIP = 13
    """Supervisor: as LOOP_TRIP."""
    SUPERVISOR_TRIP_AT = 14
    VALVE_NULL_AT = 15
    """Loop: when the device confirmed null and disabled after a trip."""
    BYPASS_SHUT_AT = 16
    """Field process: when every ball valve's feedback was shut after a trip."""
    PUMP_UNLOADED_AT = 17
    """Field process: when the pump unit confirmed."""
    ACTION = 18
    """Loop: worst `Action` of the ladder at present."""
    ACTION_CAUSE = 19
    """Loop: its `Cause`."""
    ACTION_CHANNEL = 20
    """Loop: index of the limit concerned, -1 none."""
    MISSED = 21
    """Loop: ticks missed so far."""
    EXCHANGE_ERRORS = 22
    """Loop: exchanges that failed so far."""
    HOMED = 23
    """Loop: 1 once the encoder's zero is known; 0 again after a lost count."""
    RECORDED = 24
    """Recorder: rows on disk so far."""
    DECISIONS = 25
    """Supervisor: decisions posted so far; written last (release)."""
    PUBLISHER_BEAT = 26
    """Publisher of the live stream: when its last turn ended."""
    PUBLISHED = 27
    """Publisher: number of the row it reads next; one that is started again goes on there."""


_WORDS: Final = 64
_SLOW: Final = 64
_DECISION: Final = 1 + len(DECIDED)
_RING_AT: Final = _WORDS + 2 * _SLOW + DECISIONS_KEPT * _DECISION


@dataclass(frozen=True)
class Board:
    """The shared memory, mapped.

    Attributes:
        fd: descriptor to hand to child processes (`subprocess` pass_fds).
        words: int64 (64,), by `Word`.
        slow: float64 (n,), the latest of each of `SLOW_INPUTS`, SI; NaN if none ever came.
        slow_at: int64 (n,), CLOCK_MONOTONIC in ns at which each came.
        decisions: float64 (DECISIONS_KEPT, 1 + len(DECIDED)); decision k of the session stands at
            k % DECISIONS_KEPT, behind the number of the segment it is on.
        ring: float64 (RING_ROWS, columns); row k of the session stands at k % RING_ROWS.
    """

    fd: int
    words: Words
    slow: Array
    slow_at: Words
    decisions: Array
    ring: Array

    @classmethod
    def create(cls, columns: int) -> "Board":
        """Return new memory for rows of so many columns."""
        fd = os.memfd_create("rig-board", 0)
        os.ftruncate(fd, 8 * (_RING_AT + RING_ROWS * columns))
        board = cls.attach(fd)
        board.slow[:] = np.nan
        return board

    @classmethod
    def attach(cls, fd: int) -> "Board":
        """Return the memory of a descriptor inherited from the process that made it."""
        memory = mmap.mmap(fd, 0)
        floats, integers = np.frombuffer(memory), np.frombuffer(memory, np.int64)
        slow, slow_at = _WORDS, _WORDS + _SLOW
        return cls(
            fd,
            integers[:_WORDS],
            floats[slow : slow + len(SLOW_INPUTS)],
            integers[slow_at : slow_at + len(SLOW_INPUTS)],
            floats[_WORDS + 2 * _SLOW : _RING_AT].reshape(DECISIONS_KEPT, _DECISION),
            floats[_RING_AT:].reshape(RING_ROWS, -1),
        )
