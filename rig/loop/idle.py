"""A loop that does nothing but wake at every tick, to measure how late the machine wakes it."""

import numpy as np
from numpy.typing import NDArray

from rig.io import monotonic_ns
from rig.jit import njit

from .clock import sleep_until


def wakeup_lateness(period_s: float, ticks: int) -> NDArray[np.float64]:
    """Return float64 (ticks,), s: how late each tick of an idle loop woke; NaN for a missed one.

    The result depends on how the calling thread is scheduled (`rig.loop.realtime`).
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
