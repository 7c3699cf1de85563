from collections.abc import Iterator
from dataclasses import replace
from struct import pack, unpack
from typing import Any

import pytest

from rig.configuration.rigs.rig import Rig, load_rig
from rig.emulator.addresses import HOST, Address, Endpoints
from rig.emulator.modbus.functions import ModbusException, serve
from rig.emulator.modbus.mapped_device import MappedDevice
from rig.emulator.running import EmulatorThread
from rig.io.modbus_daq.register_map import RegisterMap
from rig.io.registry import DriverSpec

Bench = Any

AIN0, FIO_STATE, READ_A, TDAC2, FIO4, FIO5, PRODUCT_ID = 0, 2500, 3000, 30004, 2004, 2005, 60000


@pytest.fixture(scope="module")
def labjack() -> RegisterMap:
    return daq(load_rig("labjack")).options.map


def daq(rig: Rig) -> DriverSpec:
    return next(spec for spec in rig.drivers if spec.kind == "fast")


@pytest.fixture
def device(bench: Bench, labjack: RegisterMap) -> MappedDevice:
    return MappedDevice(labjack, bench.instruments, bench.plant.drive_valve, bench.record)


def command(device: MappedDevice, volts: float, enable: int) -> None:
    device.write(TDAC2, pack(">f", volts))
    device.write(FIO4, pack(">H", enable))


def arm(device: MappedDevice, seconds: int) -> None:
    device.write(61604, pack(">I", seconds))
    device.write(61600, pack(">I", 1))


def test_it_says_that_it_is_a_t7_and_has_no_function_23(device: MappedDevice) -> None:
    assert device.read(PRODUCT_ID, 2) == pack(">f", 7.0)
    assert serve(device, b"\x17" + bytes(11))[1] == 1


def test_analog_inputs_read_the_volts_of_their_transducers(
    bench: Bench, device: MappedDevice
) -> None:
    pressure_1, pressure_2, supply = unpack(">3f", device.read(AIN0, 6))
    truth = bench.plant.truth
    # 0 to 10 V for 0 to 20.7 MPa.
    assert pressure_1 == pytest.approx(truth.pressure_1 / 2.07e6, abs=0.1)
    assert pressure_2 == pytest.approx(truth.pressure_2 / 2.07e6, abs=0.1)
    assert supply == pytest.approx(truth.supply_pressure / 2.07e6, abs=0.1)


def test_the_valve_is_driven_while_its_relay_is_closed(bench: Bench, device: MappedDevice) -> None:
    command(device, 1.0, enable=0)
    bench.clock.advance(0.1)
    assert bench.plant.truth.spool == pytest.approx(0.0, abs=1e-9)
    command(device, 1.0, enable=1)
    bench.clock.advance(0.1)
    assert bench.plant.truth.spool > 2e-5
    assert int.from_bytes(device.read(FIO_STATE, 1), "big") & 0x10
    assert unpack(">i", device.read(READ_A, 2))[0] > 0


def test_the_emergency_stop_opens_the_relay_and_is_read_as_an_open_contact(
    bench: Bench, device: MappedDevice
) -> None:
    command(device, 1.0, enable=1)
    assert device.read(FIO5, 1) == b"\0\0"
    device.press_estop(True)
    assert device.read(FIO5, 1) == b"\0\1"
    assert not device.enabled
    assert bench.events()[-1] == "valve_disabled"


def test_its_watchdog_opens_the_relay_until_the_next_command(
    bench: Bench, device: MappedDevice
) -> None:
    arm(device, 2)
    command(device, 1.0, enable=1)
    bench.clock.advance(1.9)
    device.read(AIN0, 2)
    bench.clock.advance(1.9)
    device.tend()
    assert device.enabled
    bench.clock.advance(0.2)
    device.tend()
    assert not device.enabled
    command(device, 1.0, enable=1)
    assert device.enabled


def test_a_watchdog_that_is_not_armed_never_trips(bench: Bench, device: MappedDevice) -> None:
    device.write(61604, pack(">I", 2))
    command(device, 1.0, enable=1)
    bench.clock.advance(100.0)
    device.tend()
    assert device.enabled


def test_set_up_is_kept_and_inputs_cannot_be_written(device: MappedDevice) -> None:
    device.write(44100, pack(">I", 10))
    assert device.read(44100, 2) == pack(">I", 10)
    for address in (AIN0, READ_A, 12345):
        with pytest.raises(ModbusException) as refused:
            device.write(address, b"\0\0")
        assert refused.value.code == 2


@pytest.fixture
def served(simulated: Rig, labjack: RegisterMap) -> Iterator[EmulatorThread]:
    with EmulatorThread(simulated, endpoints=Endpoints(Address(HOST, 0), labjack)) as emulator:
        yield emulator


def test_the_rigs_driver_sets_it_up_and_exchanges_by_feedback(served: EmulatorThread) -> None:
    spec = daq(load_rig("labjack"))
    options = replace(spec.options, host=HOST, port=int(served.ports["daq"]), timeout=20.0)
    driver = DriverSpec.of("daq", spec.type, options).create()
    driver.open()
    try:
        driver.write({"command_V": 1.0, "valve_enable": 1.0})
        reading = driver.read()
        assert reading["supply_pressure_Pa"] == pytest.approx(13.8e6, rel=0.02)
        assert reading["estop_closed"] == 1.0
        assert reading["valve_enabled"] == 1.0
        assert served.status()["daq"]["watchdog_ms"] == 2000
        driver.safe_state()
        assert not served.status()["daq"]["valve_enabled"]
    finally:
        driver.close()
