"""Registers of the I/O that drives the bypass valves: Modbus/TCP, or RTU on a serial line.

Bypass i of `BYPASSES` has coil i (1 opens its ball valve), discrete inputs 2i and 2i + 1 (the
ball's switches "open" and "shut", both off while it moves), holding register i (needle setpoint)
and input register i (needle position). The return throttle has no ball, so that its coil and
switches are unused; its needle counts from 0 (the line is free) to full scale (it is blocked).

A device may have blocking valves besides. That of chamber i, counted from 0, has coil 16 + i (1
shuts it, so that it is open without current) and discrete inputs 16 + 2i and 17 + 2i, its switches
"open" and "shut".

If the device gets no request at all for the watchdog's time, it shuts the balls, and opens the
throttle and the blocking valves by itself.
"""

from dataclasses import dataclass
from typing import Annotated, Final

from rig.channels import BYPASSES
from rig.plant import Quantity as _Quantity

THROTTLE: Final = BYPASSES[-1]
"""The bypass without a ball valve: the return throttle."""

NEEDLE_FULL_SCALE: Final = 10_000
"""Number in a needle's registers for opening 1."""

IDENTITY: Final = 0x4256
"""Number in the identity register, which is "BV" in ASCII."""

_Address = Annotated[int, _Quantity("", 0, 0xFFFF, "", "")]


@dataclass(frozen=True)
class BypassRegisters:
    """Addresses in the device, counted from 0 as on the wire; series are in order of `BYPASSES`.

    Attributes:
        coils: first coil, by which balls are commanded.
        switches: first discrete input, the switches of the balls.
        setpoints: first holding register of needle setpoints.
        positions: first input register of needle positions.
        identity: holding register of the identity, read only.
        watchdog: holding register of the watchdog's time in ms; 0 switches the watchdog off.
        blocking_coils: first coil of the blocking valves, if the device has them.
        blocking_switches: first discrete input of their switches.
    """

    coils: _Address = 0
    switches: _Address = 0
    setpoints: _Address = 0
    positions: _Address = 0
    identity: _Address = 100
    watchdog: _Address = 101
    blocking_coils: _Address = 16
    blocking_switches: _Address = 16


STANDARD_REGISTERS: Final = BypassRegisters()
"""Addresses in an I/O device that was built for this rig."""
