"""Looks whether a valve that the loop has at null stays there, compiled.

Whoever else writes to the device is seen only before the loop's next exchange, which brings the
valve to null again before it reads.
"""

from math import isnan
from typing import Final

from rig.io import FAST_INPUTS, ExchangeStatus, exchange, monotonic_ns
from rig.loop.atomic import store_release
from rig.plant import inner

from .layout import NULL_V, Count, Found

_SPOOL: Final = FAST_INPUTS.index("spool_m")
_VALVE_ENABLED: Final = FAST_INPUTS.index("valve_enabled")
_DEVICE_COMMAND: Final = FAST_INPUTS.index("device_command_V")


@inner
def is_null(inputs):
    """Return whether the device says that the valve is at null and disabled.

    What it does not report cannot deny it, but one of both it must confirm.
    """
    command, enabled = inputs[_DEVICE_COMMAND], inputs[_VALVE_ENABLED]
    if isnan(command):
        return enabled == 0.0
    return abs(command) <= NULL_V and enabled != 1.0


@inner
def look_at_null(fd, look, tol, pace, memory):
    """Take note of a valve that is driven though this loop has it at null: by another master.

    Args:
        fd: the device's connection.
        look: reads the device and writes nothing.
        tol: `rig.loop.interlocks.check_tolerances.Tolerances`.
        pace: for the deadline.
        memory: `WireMemory`; `found` is updated.
    """
    counts, seen, found = memory.counts, memory.seen, memory.found
    counts[Count.SEQUENCE] += 1
    deadline = monotonic_ns() + pace.timeout_ns
    status, _ = exchange(fd, look, counts[Count.SEQUENCE], memory.outputs, seen, deadline)
    if status != ExchangeStatus.OK:
        return
    off_null_m = _spool_off_null(seen[_SPOOL], tol, counts)
    enabled, output_V = seen[_VALVE_ENABLED] == 1.0, seen[_DEVICE_COMMAND]  # noqa: N806
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
    """Return how far from null the spool is in m, once it was there and then away for long; or 0.

    A spool that never came to null is stuck, which is no master's doing. NaN is at no place.
    """
    if counts[Count.SETTLED] < tol.spool_ticks:
        at_null = abs(spool_m) <= tol.spool_m
        counts[Count.SETTLED] = counts[Count.SETTLED] + 1 if at_null else 0
        return 0.0
    away = abs(spool_m) > tol.spool_m
    counts[Count.AWAY] = counts[Count.AWAY] + 1 if away else 0
    return spool_m if counts[Count.AWAY] > tol.spool_ticks else 0.0
