"""Sleep until a time on the monotonic clock, for compiled code, and measure how late one wakes.

`rig.io.libc` reads the clock.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.io import bind, monotonic_ns, scratch
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


def wakeup_lateness(period_s: float, ticks: int) -> NDArray[np.float64]:
    """Return float64 (ticks,), s: how late each tick of an idle loop woke; NaN for a missed one.

    The loop does nothing but wake at every tick. The result depends on how the calling thread is
    scheduled (`rig.loop.realtime`).
    """
    # The first call makes numba compile or load the function, which must not be timed.
    _wake(round(1e9 * period_s), np.empty(1))
    lateness = np.full(ticks, np.nan)
    _wake(round(1e9 * period_s), lateness)
    return lateness


@njit(cache=True, error_model="numpy", nogil=True)
def _wake(period_ns, lateness):
    due = monotonic_ns() + period_ns
    tick = 0
    while tick < lateness.size:
        sleep_until(due)
        late = monotonic_ns() - due
        lateness[tick] = 1e-9 * late
        # Ticks that are past by a period or more are skipped, as in the loop.
        steps = 1 + late // period_ns
        tick += steps
        due += steps * period_ns
