"""The log of the limits that were passed, which the compiled interlock writes and others read.

The interlock alone counts how long a value has been beyond a limit. Whoever tells of a limit reads
this log, so that what is told and what is acted on cannot differ.
"""

from typing import NamedTuple

import numpy as np

from rig.jit import njit
from rig.loop.atomic import load_acquire, store_release

from .passing_log import PASSING_NUMBERS, PASSINGS_KEPT, PassingLog


class RungPassed(NamedTuple):
    """One moment at which a value counted as beyond a limit.

    Attributes:
        segment: number of the loop's segment; 0 on a simulated rig.
        tick: number of the tick in the segment.
        rung: index of the limit: those of the rig come first, then those of the test.
        value: the value at that tick, SI.
    """

    segment: int
    tick: int
    rung: int
    value: float


def passing_log() -> PassingLog:
    """Return a log without passings, in memory of this process."""
    return PassingLog(np.zeros(1, np.int64), np.zeros((PASSINGS_KEPT, PASSING_NUMBERS)))


@njit(cache=True, error_model="numpy", nogil=True)
def note_passing(log, segment, tick, rung, value):
    """Add a passing to the log; the arguments are those of `RungPassed`."""
    number = log.written[0]
    row = log.rows[number % PASSINGS_KEPT]
    row[0], row[1], row[2], row[3] = segment, tick, rung, value
    store_release(log.written, 0, number + 1)


class PassingReader:
    """One reader of a log, which begins with the next passing that is written.

    Args:
        log: the log.
    """

    def __init__(self, log: PassingLog) -> None:
        self._log = log
        self._next = int(log.written[0])

    def take(self) -> list[RungPassed]:
        """Return the passings since the last call, the oldest first, without waiting for any.

        Passings that have been written over are left out.
        """
        end = int(load_acquire(self._log.written, 0))
        first = max(self._next, end - PASSINGS_KEPT)
        self._next = end
        return latest_passings(self._log, end - first)


def latest_passings(log: PassingLog, most: int = PASSINGS_KEPT) -> list[RungPassed]:
    """Return the last passings of a log, at most `most`, the oldest first."""
    end = int(load_acquire(log.written, 0))
    rows = (log.rows[number % PASSINGS_KEPT] for number in range(max(end - most, 0), end))
    return [RungPassed(int(row[0]), int(row[1]), int(row[2]), float(row[3])) for row in rows]
