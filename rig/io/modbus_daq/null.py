"""Brings the valve of a Modbus device to null, and reads whether it is there."""

import time
from collections.abc import Iterator
from typing import Final

from rig.io.driver import DriverError

from .link import DaqLink
from .register_map import Register, RegisterMap, RegisterValue

_COMMANDED: Final = ("command_V", "valve_enable")
"""Outputs that are set to 0, in this order, on a device without a null request."""

_REPORTED: Final = ("device_command_V", "valve_enabled")
_POLL_S: Final = 0.002


def null(link: DaqLink, register_map: RegisterMap, timeout_s: float) -> None:
    """Bring the valve to 0 V and switch it off, and wait until the device confirms it.

    It confirms by its null request, if the map has one, and by every quantity that it reports of
    the valve: its output, and whether the valve is enabled. Each must be exactly 0.

    Args:
        link: connection to the device.
        register_map: the device's registers.
        timeout_s: longest time in s that the device may take.

    Raises:
        DriverError: the device gave no valid reply, refused, or did not confirm in time.
    """
    refusals = []
    for value in _requests(register_map):
        try:
            link.write(value)
        except DriverError as refusal:  # an output that fails must not keep the relay closed
            refusals.append(refusal)
    if refusals:
        raise refusals[0]
    deadline = time.monotonic() + timeout_s
    while waiting := _waiting(link, register_map):
        if time.monotonic() > deadline:
            raise DriverError(
                link.driver,
                f"{register_map.device} was asked for null and after {timeout_s:g} s {waiting}",
                "cut the hydraulic supply, then find out why",
            )
        time.sleep(_POLL_S)


def _requests(register_map: RegisterMap) -> list[RegisterValue]:
    """Return the values whose writing brings the valve to null, in order."""
    if register_map.null_request is not None:
        return [register_map.null_request]
    registers = {register.signal: register for register in register_map.written}
    nulled = [registers[signal] for signal in _COMMANDED if signal in registers]
    return [RegisterValue(r.address, r.type, _number_at_zero(r)) for r in nulled]


def _waiting(link: DaqLink, register_map: RegisterMap) -> str:
    """Return a text that says why the valve is not yet at null; empty if it is."""
    request = register_map.null_request
    if request is not None and not link.holds(request):
        return "has not taken the request"
    not_null = next(driven(link, register_map), "")
    return f"still {not_null}" if not_null else ""


def driven(link: DaqLink, register_map: RegisterMap) -> Iterator[str]:
    """Yield a text for each quantity of the valve that the device reports and that is not 0.

    On a device without a null request, outputs that can be read back count as well.

    Raises:
        DriverError: the device gives no valid reply, or refuses.
    """
    request = register_map.null_request
    for register in register_map.registers:
        counts = register.signal in _REPORTED
        if request is None:
            counts |= register.access == "rw" and register.signal in _COMMANDED
        if counts and (value := _value_of(register, link)) != 0.0:
            yield f"has {register.signal} at {value:g}"


def _number_at_zero(register: Register) -> float:
    """Return the number that a register holds for the value 0; for a switch, the whole word."""
    number = (0.0 - register.bias) / register.gain
    return number * (1 << register.bit) if register.bit is not None else number


def _value_of(register: Register, link: DaqLink) -> float:
    number = link.read(register.address, register.type)
    if register.bit is not None:
        number = int(number) >> register.bit & 1
    return register.gain * number + register.bias
