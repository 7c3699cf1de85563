"""The emulated rig as a whole, behind the drivers of the real one."""

import socket
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from rig.configuration.rigs.rig import Rig, load_rig
from rig.emulator.addresses import (
    HOST,
    Address,
    AddressError,
    Endpoints,
    PortNameError,
    endpoints_of,
)
from rig.emulator.running import EmulatorThread
from rig.emulator.script.fault_script import Script
from rig.io.can.ds408 import DriveState
from rig.io.registry import DriverSpec
from tests.rig.patience import long_watchdogs, patient
from tests.waiting import until


@pytest.fixture(autouse=True)
def long() -> Iterator[None]:
    """Let nothing here depend on how long this machine takes."""
    with long_watchdogs():
        yield


@pytest.fixture(scope="module")
def emulated() -> Rig:
    return load_rig("emulated")


def spec(rig: Rig, name: str) -> DriverSpec:
    return next(spec for spec in rig.drivers if spec.name == name)


def test_devices_are_served_where_the_rig_file_has_its_drivers_look(emulated: Rig) -> None:
    at = endpoints_of(emulated, control=0)
    assert at.daq == Address(HOST, spec(emulated, "daq").options.port)
    assert at.bypass == Address(HOST, spec(emulated, "bypass").options.port)
    assert at.drive is spec(emulated, "drive").options
    assert at.pump is spec(emulated, "pump").options
    assert str(at.meters) == spec(emulated, "meters").options.port
    assert at.control == Address(HOST, 0)


def test_a_simulated_rig_is_served_on_the_ports_of_the_emulated_one(
    simulated: Rig, emulated: Rig
) -> None:
    simple, full = endpoints_of(simulated), endpoints_of(emulated)
    assert (simple.daq, simple.bypass) == (full.daq, full.bypass)


def test_another_port_can_be_given_for_a_driver_that_there_is(emulated: Rig) -> None:
    assert endpoints_of(emulated, {"daq": 0}).daq == Address(HOST, 0)
    with pytest.raises(PortNameError, match="did you mean daq"):
        endpoints_of(emulated, {"dag": 0})


@pytest.mark.parametrize("part", ["daq", "bypass", "control"])
def test_a_port_in_use_is_named_with_the_remedy_and_nothing_is_served(
    simulated: Rig, part: str
) -> None:
    with socket.create_server((HOST, 0)) as taken:
        port = taken.getsockname()[1]
        anywhere = Address(HOST, 0)
        free = Endpoints(anywhere, bypass=anywhere, control=anywhere)
        taken_by_another: dict[str, Any] = {part: Address(HOST, port)}
        endpoints = replace(free, **taken_by_another)
        refused = EmulatorThread(simulated, endpoints=endpoints)
        told = f"{part}: port {port} of {HOST} is in use.*another port"
        with pytest.raises(AddressError, match=told), refused:
            pass


class Host:
    """A controller that commands 1 V through the rig's own driver."""

    def __init__(self, rig: Rig, emulator: EmulatorThread) -> None:
        self.driver: Any = patient(spec(rig, "daq"), port=int(emulator.ports["daq"])).create()
        self.driver.open()
        self.counter = 0

    def tick(self) -> None:
        self.counter += 1
        counter = float(self.counter % 65536)
        on = {"valve_enable": 1.0, "reset_lamp": 1.0, "rearm": 0.0}
        self.driver.write({"command_V": 1.0, "host_counter": counter, **on})


@pytest.fixture
def host(emulator: EmulatorThread, emulated: Rig) -> Iterator[Host]:
    host = Host(emulated, emulator)
    yield host
    host.driver.close()


def test_the_rigs_driver_enables_the_valve_moves_the_ram_and_leaves_it_safe(
    emulator: EmulatorThread, host: Host
) -> None:
    start = emulator.status()["plant"]["position"]

    def moved() -> bool:
        host.tick()
        return bool(emulator.status()["plant"]["position"] > start + 5e-3)

    until(moved)
    host.driver.safe_state()
    events = [event["event"] for event in list(emulator.record.events)]
    assert events.index("reset") < events.index("valve_enabled") < events.index("valve_disabled")
    assert emulator.status()["daq"]["output_V"] == 0.0


def test_a_bypass_opened_by_its_driver_makes_the_plant_leak(
    emulator: EmulatorThread, emulated: Rig, simulated: Rig
) -> None:
    driver = patient(spec(emulated, "bypass"), port=int(emulator.ports["bypass"])).create()
    driver.open()
    try:
        driver.write({"internal_leakage_ball": 1.0, "internal_leakage_needle": 0.5})
        expected = simulated.bypass_valves["internal_leakage"].effective(0.5, 1.0)
        until(lambda: emulator.status()["plant"]["internal_leakage"] == pytest.approx(expected))
        driver.safe_state()
        until(lambda: emulator.status()["plant"]["internal_leakage"] == 0.0)
    finally:
        driver.close()


@pytest.fixture
def on_virtual_can(emulated: Rig) -> dict[str, Any]:
    """Return the options of the rig's CAN drivers, on a bus inside this process."""
    return {
        name: patient(spec(emulated, name), interface="virtual", channel="emulator tests").options
        for name in ("drive", "pump")
    }


def test_a_rig_with_a_pump_unit_starts_unloaded_and_gets_pressure_when_it_is_loaded(
    simulated: Rig, emulated: Rig, on_virtual_can: dict[str, Any]
) -> None:
    endpoints = Endpoints(Address(HOST, 0), pump=on_virtual_can["pump"])
    with EmulatorThread(simulated, endpoints=endpoints) as emulator:
        assert emulator.status()["plant"]["supply_pressure"] == 0.0
        driver = DriverSpec.of("pump", "can_pump", on_virtual_can["pump"]).create()
        driver.open()
        try:
            driver.write({"pump_load": 1.0})

            def loaded() -> bool:
                driver.read()
                return bool(emulator.status()["plant"]["supply_pressure"] > 13e6)

            until(loaded)
            driver.safe_state()
            until(lambda: emulator.status()["plant"]["supply_pressure"] < 1e3)
        finally:
            driver.close()
    assert "pump_unloaded" in [event["event"] for event in emulator.record.events]


def test_a_spool_follows_the_analog_command_only_while_its_electronics_are_active(
    simulated: Rig, emulated: Rig, on_virtual_can: dict[str, Any]
) -> None:
    endpoints = Endpoints(Address(HOST, 0), drive=on_virtual_can["drive"])
    script = Script(attentive=True)
    with EmulatorThread(simulated, endpoints=endpoints, script=script) as emulator:
        host = Host(emulated, emulator)
        valve = DriverSpec.of("drive", "can_valve", on_virtual_can["drive"]).create()
        valve.open()
        spool = simulated.plant.parameters.valve_gain * 1.0

        def at(opening: float) -> bool:
            host.tick()
            valve.read()
            status = emulator.status()
            there = status["plant"]["spool"] == pytest.approx(opening, abs=1e-7)
            return bool(status["daq"]["output_V"] == 1.0 and there)

        try:
            until(lambda: at(0.0))
            valve.write({"drive_target": float(DriveState.ACTIVE)})
            until(lambda: at(spool))
            emulator.inject(fault="drive_fault")
            until(lambda: emulator.status()["can"]["drive"] != "ACTIVE")
        finally:
            valve.close()
            host.driver.close()
