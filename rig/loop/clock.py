"""Sleep until a time on the monotonic clock, for compiled code; `rig.io.libc` reads the clock."""

from typing import Final

from rig.io import bind, scratch
from rig.jit import njit

_CLOCK_MONOTONIC: Final = 1  # linux/time.h
_TIMER_ABSTIME: Final = 1
_SECOND: Final = 1_000_000_000

_clock_nanosleep = bind("clock_nanosleep", "int32", "int32", "int32", "uintp", "uintp")


@njit(cache=True, error_model="numpy", nogil=True)
def sleep_until(time_ns):
    """Sleep until a time on CLOCK_MONOTONIC, ns; return at once when it is past."""
    timespec = scratch()
    timespec[0], timespec[1] = time_ns // _SECOND, time_ns % _SECOND
    # When a signal arrives, the call returns early and not with 0.
    while _clock_nanosleep(_CLOCK_MONOTONIC, _TIMER_ABSTIME, timespec.ctypes.data, 0) != 0:
        pass
