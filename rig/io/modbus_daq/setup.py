"""Verifies a Modbus device and sets it up, before samples are exchanged with it."""

from typing import Final

from rig.io.driver import DriverError

from .link import DaqLink, RefusedError
from .register_map import RegisterMap, RegisterValue

GREATEST_RATE: Final = "greatest_rate_Hz"
"""Name of the fact of a map that holds the greatest rate which the device itself states, Hz."""


def verify(link: DaqLink, register_map: RegisterMap, rate_hz: float) -> None:
    """Check that the device is that of the map, and that it can exchange at `rate_hz`.

    Raises:
        DriverError: its identity or map version is another one, it states a greatest rate below
            `rate_hz`, or it gives no valid reply.
    """
    _verify_register(link, register_map, "identity", register_map.identity)
    if register_map.version is not None:
        _verify_register(link, register_map, "map version", register_map.version)
    for fact in register_map.facts:
        if fact.name == GREATEST_RATE:
            greatest = link.read(fact.address, fact.type)
            if rate_hz > greatest:
                state = f"{link.place} does {greatest:g} exchanges/s, not {rate_hz:g}"
                raise DriverError(link.driver, state, f"write rate: {greatest:g} Hz", "rate")


def set_up(link: DaqLink, register_map: RegisterMap, watchdog_s: float | None) -> None:
    """Write the map's set-up and the watchdog's, unless the device holds all of it; read it back.

    Of a register that is written more than once, the last value counts as the one it must hold.

    Args:
        link: connection to the device.
        register_map: the device's registers.
        watchdog_s: time of the device's watchdog in s; None if the device has none.

    Raises:
        DriverError: the device refuses, gives no valid reply, or does not hold the values after
            they were written.
    """
    values = [*register_map.setup]
    watchdog = register_map.watchdog
    if watchdog is not None and watchdog_s is not None:
        counts = round(watchdog_s * watchdog.counts_per_s)
        values += [RegisterValue(watchdog.address, watchdog.type, counts), *watchdog.arm]
    last = {value.address: value for value in values}.values()
    if all(link.holds(value) for value in last):
        return
    for value in values:
        link.write(value)
    for value in last:
        found = link.read(value.address, value.type)
        if found != value.value:
            state = f"{register_map.device} was given {value.value:g} and has {found:g}"
            channel = f"register {value.address}"
            raise DriverError(link.driver, state, "check the map's set-up", channel)


def _verify_register(
    link: DaqLink, register_map: RegisterMap, what: str, expected: RegisterValue
) -> None:
    try:
        found = link.read(expected.address, expected.type)
    except RefusedError as refusal:
        instead = refusal.exception
    else:
        if found == expected.value:
            return
        instead = f"{found:g}"
    raise DriverError(
        link.driver,
        f"{link.place} is not the {register_map.device} expected: its {what} is {instead} "
        f"instead of {expected.value:g}",
        "check host, port and map",
        f"register {expected.address}",
    )
