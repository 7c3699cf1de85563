"""These checks find out, before a hardware rig is opened, whether the parts of its file fit.

They cover drivers, sensors, valves and limits. A mistake that only a device shows, such as a
missing port or another identity, is found by the device's driver when the driver is opened.
"""

from typing import Final

from faults import FAULT_KINDS, Verdict
from rig.configuration.reading import Located, show
from rig.io import ChannelLimit, DriverSpec, LoopSettings, connection_of
from rig.plant import TICK

from .drivers import PlacedDriver

NEEDED_INPUTS: Final = ("position_m", "pressure_1_Pa", "pressure_2_Pa")
"""Signals that every filter needs; without them no filter and no detector can run."""

SENSORS: Final = {
    "supply_pressure_sensor": ("supply_pressure_Pa",),
    "load_cell": ("load_N",),
    "spool_sensor": ("spool_m", "drive_spool_m"),
}
"""Signals of each sensor that a rig file may have; a driver must supply at least one of them."""


def moved_faults(drivers: tuple[DriverSpec, ...]) -> tuple[str, ...]:
    """Return the kinds of fault of which the drivers move all valves (see `valves_of`)."""
    outputs = {output for spec in drivers for output in spec.outputs}
    return tuple(kind for kind in map(str, FAULT_KINDS) if outputs.issuperset(valves_of(kind)))


def valves_of(kind: str) -> tuple[str, ...]:
    """Return the names of the output signals by which a kind of fault is made.

    They are of the ball and the needle of its bypass. The throttle in the return line has a needle
    only.
    """
    needle = f"{kind}_needle"
    return (needle,) if kind == Verdict.RETURN_BLOCKAGE else (f"{kind}_ball", needle)


def check_hardware(root: Located, drivers: tuple[PlacedDriver, ...]) -> None:
    """Check that a hardware rig's drivers fit its file; record a problem for each mistake.

    There must be one fast driver, which writes the command. The drivers must supply the needed
    signals and the sensors that the file has. No two of them may read the same signal, write the
    same signal, or use the same device.
    """
    section = root.find("drivers")
    _check_fast(section, drivers)
    _check_shared(drivers)
    supplied = {signal for driver in drivers for signal in driver.spec.inputs}
    for signal in NEEDED_INPUTS:
        if signal not in supplied:
            remedy = "configure the fast driver, or its register map, to read it"
            section.refuse("is read by no driver", remedy, signal)
    for key, signals in SENSORS.items():
        entry = root.get(key)
        if entry is not None and entry.value is True and supplied.isdisjoint(signals):
            limit = f"needs a driver that reads {' or '.join(signals)}"
            entry.refuse(limit, f"configure one, or write `{key}: false`", "true")


def check_rates(root: Located, loop: LoopSettings, drivers: tuple[PlacedDriver, ...]) -> None:
    """Check that the rates of loop, filters and fast device fit; record a problem for each mistake.

    The loop must run at the filters' rate of 1 kHz. If the fast device is slower than the loop, the
    file must allow that. The exchange's timeout must be below the loop's `stale_limit`.
    """
    if loop.exchange_timeout >= loop.stale_limit:
        limit = f"is not below the stale_limit of {show(loop.stale_limit, 's')}"
        remedy = "a late reply must not be old when it is given up: write less"
        value = show(loop.exchange_timeout, "s")
        root.find("loop").refuse(limit, remedy, value, "exchange_timeout")
    if abs(loop.rate * TICK - 1.0) > 1e-9:
        limit = f"is not the {show(1.0 / TICK, 'Hz')} of filters and recordings"
        remedy = "leave it out; for a slower device write `slower_device: hold`"
        root.find("loop").refuse(limit, remedy, show(loop.rate, "Hz"), "rate")
        return
    for driver in drivers:
        if driver.spec.kind == "fast" and driver.spec.rate_hz < loop.rate:
            _check_slower(root.find("loop"), loop, driver)


def check_rungs(
    item: Located | None, rungs: tuple[ChannelLimit, ...], drivers: tuple[PlacedDriver, ...]
) -> None:
    """Record a problem for each channel with a limit that the fast driver does not read.

    `item` is the section `limits`, and `rungs` are the limits under its key `channels`.
    """
    supplied = {signal for spec, _ in drivers if spec.kind == "fast" for signal in spec.inputs}
    for rung in rungs:
        if item is not None and rung.channel not in supplied:
            limit = "has a limit and is not read by the fast driver"
            remedy = "add it to the driver's register map, or remove the limit"
            item.refuse(limit, remedy, rung.channel, "channels")


def _check_fast(section: Located, drivers: tuple[PlacedDriver, ...]) -> None:
    fast = [driver for driver in drivers if driver.spec.kind == "fast"]
    if not fast:
        remedy = "add one that exchanges samples with the loop, such as modbus_daq"
        section.refuse("have no fast driver", remedy, "")
    for second in fast[1:]:
        limit = f"is a second fast driver beside {fast[0].spec.name}"
        second.item.refuse(limit, "the loop has one: remove one", "")
    for driver in fast:
        if "command_V" not in driver.spec.outputs:
            remedy = "give it a register or output for the valve command"
            driver.item.refuse("does not write command_V", remedy, "")


def _check_shared(drivers: tuple[PlacedDriver, ...]) -> None:
    """Record a problem where two drivers read or write one signal, or use one connection."""
    for use, remedy, things_of in (
        ("read by", "leave it out of one of them", lambda spec: spec.inputs),
        ("written by", "leave it out of one of them", lambda spec: spec.outputs),
        ("the connection of", "give each driver its own device", _connections),
    ):
        first: dict[str, str] = {}
        for driver in drivers:
            taken: dict[str, list[str]] = {}
            for thing in things_of(driver.spec):
                other = first.setdefault(thing, driver.spec.name)
                if other != driver.spec.name:
                    taken.setdefault(other, []).append(thing)
            for other, things in taken.items():
                driver.item.refuse(f"is {use} the driver {other} too", remedy, ", ".join(things))


def _connections(spec: DriverSpec) -> tuple[str, ...]:
    """Return the connection that only this driver may use; () if the driver has none."""
    connection = connection_of(spec.options)
    return () if connection is None else (connection,)


def _check_slower(section: Located, loop: LoopSettings, driver: PlacedDriver) -> None:
    """Record a problem if the file does not allow a fast device that is slower than the loop.

    The setting `slower_device` must not be "refuse", and `stale_limit` must be two periods of the
    device or more. `section` is the section `loop`.
    """
    rate, period = show(driver.spec.rate_hz, "Hz"), 1.0 / driver.spec.rate_hz
    if loop.slower_device == "refuse":
        limit = f"is below the loop's {show(loop.rate, 'Hz')}"
        remedy = "choose a faster device, or hold its values: `loop: {slower_device: hold}`"
        driver.item.refuse(limit, remedy, rate)
    elif loop.stale_limit < 2.0 * period:
        limit = f"is below two periods of {driver.spec.name} at {rate}"
        remedy = f"write {show(2.0 * period, 's')} or more"
        section.refuse(limit, remedy, show(loop.stale_limit, "s"), "stale_limit")
