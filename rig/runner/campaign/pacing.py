"""Keeps a run at the wall clock, or lets it go as fast as it can."""

import time
from collections.abc import Callable
from typing import Final, Literal

from .stopping import StopFlag

Pace = Literal["real", "fast"]

LIVE_TICKS: Final = 50
"""Ticks of a batch at the wall clock: 50 ms, so that a display looks live."""

_NAP_S: Final = 0.05
"""Longest sleep: a request to stop is noticed within it."""


class Pacer:
    """Holds a run back until the wall clock has come to its simulated time.

    Every wait ends at an absolute time, so that no delay adds up. A batch that is late is followed
    at once by the next: the simulated rig is delayed, and no tick of it skipped.

    Args:
        pace: "real" or "fast", which never waits.
        stop: a wait ends early when a stop is requested.
        clock, sleep: seconds, as `time.monotonic` and `time.sleep`.
    """

    def __init__(
        self,
        pace: Pace,
        stop: StopFlag,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self.live = pace == "real"
        self._stop = stop
        self._clock = clock
        self._sleep = sleep
        self._zero = clock()

    def start(self) -> None:
        """Take the present moment as time zero."""
        self._zero = self._clock()

    def wait_until(self, time_s: float) -> None:
        """Return when the wall clock is at `time_s` after the start, or a stop is requested."""
        while self.live and not self._stop.requested:
            left = self._zero + time_s - self._clock()
            if left <= 0.0:
                return
            self._sleep(min(left, _NAP_S))
