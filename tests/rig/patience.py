"""Makes drivers so patient that a stall of the machine trips no rig, for tests not about time."""

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
"""Options, by type of driver, with long time limits and without a watchdog of this host."""


@contextmanager
def long_watchdogs() -> Iterator[None]:
    """Let emulated I/O nodes of this process accept a longer watchdog time than a real one does."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("rig.emulator.modbus.io_node.WATCHDOG_LIMIT_MS", round(1e3 * PATIENCE_S))
        yield


def patient(spec: DriverSpec, **options: Any) -> DriverSpec:
    """Return the driver with long time limits, and with `options` changed."""
    given = dict(PATIENT.get(spec.type, {}))
    if spec.type == "modbus_daq":
        registers = spec.options.map
        longer = replace(registers.watchdog, longest=PATIENCE_S)
        given = {"timeout": PATIENCE_S, "watchdog": PATIENCE_S}
        given["map"] = replace(registers, watchdog=longer)
    return replace(spec, options=replace(spec.options, **given | options))
