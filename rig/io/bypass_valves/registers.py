"""Registers of the I/O that drives the bypass valves: Modbus/TCP, or RTU on a serial line.

Bypass i of `BYPASSES` has coil i (open its ball valve), discrete inputs 2i and 2i + 1 (its switches
open and shut, neither on while it travels), holding register i (needle setpoint) and input register
i (needle position). The return throttle has no ball: its coil and switches are spare, and its
needle counts from 0, the line free, to full scale, the line blocked.

Whoever is not heard (no request at all) for the watchdog's time has the balls shut and the throttle
set free by the device itself.
"""

from dataclasses import dataclass
from typing import Annotated, Final

from rig.channels import BYPASSES
from rig.plant import Quantity as _Quantity

THROTTLE: Final = BYPASSES[-1]
"""The bypass without a ball."""

NEEDLE_FULL_SCALE: Final = 10_000
"""What a needle's registers hold when it is wide open, opening 1."""

IDENTITY: Final = 0x4256
"""What the identity register holds: "BV"."""

_Address = Annotated[int, _Quantity("", 0, 0xFFFF, "", "")]


@dataclass(frozen=True)
class BypassRegisters:
    """Addresses, counted from 0 as on the wire; each list in the order of `BYPASSES`.

    Attributes:
        coils: first coil.
        switches: first discrete input.
        setpoints: first holding register.
        positions: first input register.
        identity: holding register, read only.
        watchdog: holding register, ms; 0 switches the watchdog off.
    """

    coils: _Address = 0
    switches: _Address = 0
    setpoints: _Address = 0
    positions: _Address = 0
    identity: _Address = 100
    watchdog: _Address = 101


STANDARD_REGISTERS: Final = BypassRegisters()
"""Those of an I/O built for this rig."""
