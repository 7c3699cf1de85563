"""Paces a run by the wall clock, or lets it run as fast as possible."""

import time
from typing import Final, Literal

from .stopping import StopFlag

Pace = Literal["real", "fast"]

LIVE_TICKS: Final = 50
"""Most ticks of a batch that is paced by the wall clock: 50 ms, so that a display looks live."""

_NAP_S: Final = 0.05
"""Longest sleep, s, so that a request to stop is noticed soon."""


class Pacer:
    """Lets a simulated run wait until the wall clock has reached its simulated time.

    Every wait ends at a time counted from the start, so that delays do not add up. After a late
    batch there is no wait before the next; the simulated rig runs late, but skips no tick.

    Args:
        pace: "real" to wait for the wall clock, "fast" never to wait.
        stop: a wait ends early when a stop is requested.

    Attributes:
        live: whether the pace is "real".
    """

    def __init__(self, pace: Pace, stop: StopFlag) -> None:
        self.live = pace == "real"
        self._stop = stop
        self._zero = time.monotonic()

    def start(self) -> None:
        """Take the present moment as time zero."""
        self._zero = time.monotonic()

    def wait_until(self, time_s: float) -> None:
        """Wait until `time_s` seconds after the start or until a stop; return at once if "fast"."""
        while self.live and not self._stop.requested:
            left = self._zero + time_s - time.monotonic()
            if left <= 0.0:
                return
            time.sleep(min(left, _NAP_S))
