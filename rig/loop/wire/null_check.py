"""Checks that a valve which the loop has brought to null stays there, compiled.

What another program writes to the device can only be seen before the loop's next exchange, which
brings the valve to null again before it reads.
"""

from math import isnan
from typing import Final

from rig.io import FAST_INPUTS, ExchangeStatus, correct, exchange, monotonic_ns
from rig.loop.atomic import store_release
from rig.plant import inner

from .layout import NULL_V, Count, Found

_SPOOL: Final = FAST_INPUTS.index("spool_m")
VALVE_ENABLED: Final = FAST_INPUTS.index("valve_enabled")
_DEVICE_COMMAND: Final = FAST_INPUTS.index("device_command_V")


@inner
def is_null(inputs):
    """Return whether the device reports that the valve is at null and disabled.

    If it does not report the output, the valve must be reported disabled. If it does not report
    whether the valve is enabled, an output at null is enough.
    """
    command, enabled = inputs[_DEVICE_COMMAND], inputs[VALVE_ENABLED]
    if isnan(command):
        return enabled == 0.0
    return abs(command) <= NULL_V and enabled != 1.0


@inner
def look_at_null(fd, look, tol, pace, memory):
    """Read the device; note in `memory.found` if another master drives a valve that was at null.

    The valve counts as driven if it is enabled, its output is beyond `NULL_V`, or its spool has
    settled at null and then left it for long. If the reading fails, nothing is noted.

    Args:
        fd: descriptor of the device's connection.
        look: plan that reads the device and writes no output.
        tol: `rig.loop.interlocks.check_tolerances.Tolerances`.
        pace: `Pace`, for the deadline.
        memory: `WireMemory`; its counts, `seen` and `found` are updated.
    """
    counts, seen, found = memory.counts, memory.seen, memory.found
    counts[Count.SEQUENCE] += 1
    deadline = monotonic_ns() + pace.timeout_ns
    status, _ = exchange(fd, look, counts[Count.SEQUENCE], memory.outputs, seen, deadline)
    if status != ExchangeStatus.OK:
        return
    correct(seen, memory.corrections)
    off_null_m = _spool_off_null(seen[_SPOOL], tol, counts)
    enabled, output_V = seen[VALVE_ENABLED] == 1.0, seen[_DEVICE_COMMAND]  # noqa: N806
    if not (enabled or abs(output_V) > NULL_V or off_null_m != 0.0):
        return
    now = monotonic_ns()
    if found[Found.TIMES] == 0:
        found[Found.FIRST_NS] = now
    found[Found.LAST_NS] = now
    found[Found.ENABLED] += enabled
    if abs(1e6 * output_V) > abs(found[Found.OUTPUT_UV]):
        found[Found.OUTPUT_UV] = round(1e6 * output_V)
    if abs(1e9 * off_null_m) > abs(found[Found.SPOOL_NM]):
        found[Found.SPOOL_NM] = round(1e9 * off_null_m)
    store_release(found, Found.TIMES.value, found[Found.TIMES] + 1)


@inner
def _spool_off_null(spool_m, tol, counts):
    """Return the spool's position in m, from null, if it settled there and then left for long.

    Otherwise return 0. A spool that never came to null is stuck, which no other master caused. NaN
    counts neither as at null nor as away from it. `counts` is updated.
    """
    if counts[Count.SETTLED] < tol.spool_ticks:
        at_null = abs(spool_m) <= tol.spool_m
        counts[Count.SETTLED] = counts[Count.SETTLED] + 1 if at_null else 0
        return 0.0
    away = abs(spool_m) > tol.spool_m
    counts[Count.AWAY] = counts[Count.AWAY] + 1 if away else 0
    return spool_m if counts[Count.AWAY] > tol.spool_ticks else 0.0
