"""Paces a run by the wall clock, or lets it run as fast as possible; tells if judging lags."""

import time
from collections.abc import Callable
from math import inf
from typing import Final, Literal

from .stopping import StopFlag

Pace = Literal["real", "fast"]

LIVE_TICKS: Final = 50
"""Most ticks of a batch that is paced by the wall clock: 50 ms, so that a display looks live."""

_NAP_S: Final = 0.05
"""Longest sleep, s, so that a request to stop is noticed soon."""
_LATE_S: Final = 1.0
"""Delay in s from which limits are judged late: twenty batches, twice the time between two
decisions of the detector, which take some tenths of a second at most."""


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


class Lateness:
    """Tells when the samples of a rig that runs by the clock are judged later than they should be.

    The delay of a sample is counted from that of the sample that was judged soonest after it came,
    which is some hundredths of a second.

    Args:
        clock: returns the time in s of a clock that is not set.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._least_s = inf
        self._is_late = False

    def take(self, last_s: float) -> str:
        """Return in words that samples begin to be judged late, or no longer are; else "".

        They are in time again once the delay is below half of that from which they are late.

        Args:
            last_s: time of the newest sample that was judged, s of the test.
        """
        offset_s = self._clock() - last_s
        self._least_s = min(self._least_s, offset_s)
        delay_s = offset_s - self._least_s
        if not self._is_late and delay_s > _LATE_S:
            self._is_late = True
            return (
                f"limits that the supervisor judges are judged {delay_s:.1f} s late: this machine "
                "is too slow for them, or busy; give fewer limits of figures, or shorter `over`"
            )
        if self._is_late and delay_s < 0.5 * _LATE_S:
            self._is_late = False
            return "limits that the supervisor judges are judged in time again"
        return ""
