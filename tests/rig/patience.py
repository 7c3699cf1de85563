"""Rigs that no stall of the machine trips, for tests that are not about time."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any, Final

import pytest

from rig.io.registry import DriverSpec
from tests.waiting import PATIENCE_S

PATIENT: Final[dict[str, dict[str, Any]]] = {
    "bypass_valves": {"timeout": PATIENCE_S, "watchdog": 0.0, "margin": PATIENCE_S},
    "can_valve": {
        "open_timeout": PATIENCE_S, "step_timeout": PATIENCE_S, "silence": PATIENCE_S,
        "watchdog": 0.0,
    },
    "can_pump": {"silence": PATIENCE_S, "load_timeout": PATIENCE_S},
}  # fmt: skip
"""Options of drivers that wait for their devices, and keep no watchdog over this host."""


@contextmanager
def long_watchdogs() -> Iterator[None]:
    """Let emulated I/O nodes of this process take a watchdog longer than a real one does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rig.emulator.modbus.io_node.WATCHDOG_LIMIT_MS", round(1e3 * PATIENCE_S))
        yield


def patient(spec: DriverSpec, **options: Any) -> DriverSpec:
    """Return a driver that no stall of the machine keeps from its device, with other options."""
    given = dict(PATIENT.get(spec.type, {}))
    if spec.type == "modbus_daq":
        registers = spec.options.map
        longer = replace(registers.watchdog, longest=PATIENCE_S)
        given = {"timeout": PATIENCE_S, "watchdog": PATIENCE_S}
        given["map"] = replace(registers, watchdog=longer)
    return replace(spec, options=replace(spec.options, **given | options))
