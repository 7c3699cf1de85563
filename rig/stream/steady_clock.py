"""A clock that tells about the time of day, and that nobody can set while it runs."""

import time


class SteadyClock:
    """The wall clock as it was when this was made, going on by the monotonic clock.

    Ages and intervals are taken by it: if somebody sets the machine's clock, by an hour or by what
    NTP found, a stream that has just spoken would else be called dead, or one that hangs alive.
    """

    def __init__(self) -> None:
        self._offset_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Return the present time, ns since 1970; it never goes back and never jumps."""
        return time.monotonic_ns() + self._offset_ns
