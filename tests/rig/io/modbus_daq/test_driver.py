import os
import pickle
import re
import socket
import struct
from collections.abc import Iterator
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from rig.io.driver import Driver, DriverError
from rig.io.modbus_daq.compiled_exchange import Tally
from rig.io.modbus_daq.driver import ModbusDaq
from rig.io.modbus_daq.link import ModbusDaqOptions, RefusedError
from rig.io.modbus_daq.register_map import RegisterMap, RegisterValue, Watchdog
from tests.rig.io.conftest import DeviceThread, ManualClock
from tests.rig.io.modbus_bench import UNIT, PymodbusDevice, shipped_map
from tests.waiting import PATIENCE_S

# A server of plain registers has no owner, and echoes nothing.
NODE = replace(shipped_map("io_node"), owner=None, echo="lagging")
READ, WRITE_MANY, READ_WRITE = 3, 16, 23


@pytest.fixture
def device(device_thread: DeviceThread) -> Iterator[PymodbusDevice]:
    device = PymodbusDevice(device_thread, {512: 0x5249, 513: 1, 514: 500, 515: 1000, 516: 4711})
    yield device
    device.end()


@pytest.fixture
def daq(device: PymodbusDevice) -> Iterator[ModbusDaq]:
    daq = daq_of(device)
    daq.open()
    yield daq
    daq.close()


def daq_of(device: PymodbusDevice, register_map: RegisterMap = NODE, **options: Any) -> ModbusDaq:
    given = {
        "port": device.port,
        "unit": UNIT,
        "watchdog": 0.1,
        "timeout": PATIENCE_S,
        "ownership": "none",
        **options,
    }
    return ModbusDaq("daq", ModbusDaqOptions("127.0.0.1", register_map, **given))


def float_registers(value: float) -> list[int]:
    return list(struct.unpack(">2H", struct.pack(">f", value)))


def test_it_is_a_driver_of_the_signals_in_its_map(device: PymodbusDevice) -> None:
    daq = daq_of(device)

    assert isinstance(daq, Driver)
    assert daq.kind == "fast"
    assert daq.rate_hz == 1000
    assert daq.outputs == ("host_counter", "valve_enable", "rearm", "reset_lamp", "command_V")
    assert "position_m" in daq.inputs
    assert "flow_1_m3_per_s" not in daq.inputs


def test_opening_sets_the_watchdog_in_ms_and_drives_nothing(
    device: PymodbusDevice, daq: ModbusDaq
) -> None:
    assert device.read(514) == [100]
    assert device.read(0, 4) == [0, 0, 0, 0]


def test_what_the_device_has_already_is_not_written_again(device: PymodbusDevice) -> None:
    for expected in (1, 0):
        device.asked.clear()
        daq = daq_of(device)
        daq.open()
        daq.close()
        assert device.asked.count(WRITE_MANY) == expected


def test_set_up_is_written_in_order_as_a_whole_and_the_watchdog_armed_last(
    device: PymodbusDevice,
) -> None:
    disarm, arm = RegisterValue(900, "U32", 0), RegisterValue(900, "U32", 1)
    watchdog = Watchdog(904, "U32", 1.0, 1.0, 60.0, (arm,))
    setup = (disarm, RegisterValue(902, "F32", -10.5))
    register_map = replace(NODE, setup=setup, watchdog=watchdog)

    daq = daq_of(device, register_map, watchdog=2.0)
    daq.open()
    daq.close()

    assert device.read(900, 6) == [0, 1, *float_registers(-10.5), 0, 2]
    assert device.asked.count(WRITE_MANY) == 4


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"identity": RegisterValue(512, "U16", 7)}, "its identity is 21065 instead of 7"),
        ({"identity": RegisterValue(60000, "F32", 7)}, "exception 2 (illegal address) instead"),
        ({"version": RegisterValue(513, "U16", 2)}, "its map version is 1 instead of 2"),
    ],
)
def test_another_device_is_refused_by_what_it_is_and_nothing_is_written(
    device: PymodbusDevice, changes: dict[str, Any], found: str
) -> None:
    with pytest.raises(DriverError, match=re.escape(found)) as caught:
        daq_of(device, replace(NODE, **changes)).open()

    assert f"127.0.0.1:{device.port}" in str(caught.value)
    assert set(device.asked) == {READ}


def test_a_device_that_is_slower_than_asked_is_refused(device: PymodbusDevice) -> None:
    device.write(515, [250])

    with pytest.raises(DriverError, match="250 exchanges/s, not 1000; write rate: 250 Hz"):
        daq_of(device).open()


def test_a_port_where_nobody_serves_is_named() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        options = ModbusDaqOptions("127.0.0.1", NODE, port=port, watchdog=0.1)

        with pytest.raises(DriverError, match=f"127.0.0.1:{port} cannot be reached"):
            ModbusDaq("daq", options).open()


@pytest.mark.parametrize(
    ("options", "problem"),
    [
        ({"rate": 2000.0}, "daq, rate: 2000 Hz is not for generic I/O node; at most 1000 Hz"),
        ({"watchdog": None}, "daq, watchdog: no time is given for its watchdog; write 0.003 to 1"),
        ({"watchdog": 0.002}, "daq, watchdog: 0.002 s is not for"),
        ({"rate": 10.0, "watchdog": 0.1}, "write 0.3 to 1 s"),
        ({"watchdog": 2.0}, "daq, watchdog: 2 s is not for"),
        ({"map": replace(NODE, watchdog=None)}, "0.1 s is not for generic I/O node; leave it out"),
        ({"map": shipped_map("labjack_t7"), "exchange": "fc23"}, "LabJack T7; use fc76"),
    ],
)
def test_options_that_do_not_fit_the_map_are_refused_before_anything_is_opened(
    options: dict[str, Any], problem: str
) -> None:
    given = {"map": NODE, "watchdog": 0.1, **options}

    with pytest.raises(DriverError, match=re.escape(problem)):
        ModbusDaq("daq", ModbusDaqOptions("127.0.0.1", **given))


@pytest.mark.parametrize(
    ("mode", "functions"), [("fc23", [READ_WRITE]), ("fc16_fc3", [WRITE_MANY, READ])]
)
def test_pymodbus_s_server_takes_and_answers_the_exchange(
    device: PymodbusDevice, mode: Any, functions: list[int]
) -> None:
    device.write(264, float_registers(5000.0))
    daq = daq_of(device, exchange=mode)
    daq.open()
    device.asked.clear()

    daq.write({"command_V": -1.5, "valve_enable": 1})
    found = daq.read()
    daq.close()

    assert device.asked == [*functions, *functions]
    assert found["pressure_1_Pa"] == 5e6
    assert device.read(0, 4) == [2, 1, *float_registers(-1.5)]


def test_a_server_without_the_function_is_distinguished_from_a_silent_one(
    device: PymodbusDevice,
) -> None:
    daq = daq_of(device, exchange="fc76")
    daq.open()

    with pytest.raises(DriverError, match="generic I/O node at 127"):
        daq.read()
    daq.close()


def test_an_exception_is_reported_by_code_and_name(device: PymodbusDevice) -> None:
    daq = daq_of(device, replace(NODE, registers=beyond_the_device()))
    daq.open()

    with pytest.raises(DriverError, match=re.escape("exception 2 (illegal address)")):
        daq.read()
    daq.close()


def beyond_the_device() -> tuple[Any, ...]:
    return tuple(
        replace(register, address=register.address + 1000) if register.access == "r" else register
        for register in NODE.registers
    )


def test_the_socket_is_as_compiled_code_needs_it(daq: ModbusDaq) -> None:
    assert os.get_blocking(daq.fileno())
    with socket.socket(fileno=os.dup(daq.fileno())) as found:
        assert found.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)


def test_the_device_going_away_is_an_error_that_names_it(
    device: PymodbusDevice, daq: ModbusDaq
) -> None:
    daq.read()
    device.vanish()

    with pytest.raises(DriverError, match=f"127.0.0.1:{device.port}"):
        daq.read()


def test_an_output_that_the_device_lacks_is_refused_and_nothing_is_sent(
    device: PymodbusDevice, daq: ModbusDaq
) -> None:
    device.asked.clear()

    with pytest.raises(DriverError, match="drive_target: generic I/O node has no such output"):
        daq.write({"command_V": 1.0, "drive_target": 3.0})
    assert device.asked == []
    daq.read()
    assert device.read(2, 2) == [0, 0]


def test_a_driver_that_is_not_open_says_so(device: PymodbusDevice) -> None:
    with pytest.raises(DriverError, match="is not open"):
        daq_of(device).read()


def test_opening_and_closing_twice_does_no_harm(device: PymodbusDevice, daq: ModbusDaq) -> None:
    daq.read()
    before = device.connections
    daq.open()
    daq.close()
    daq.close()
    assert device.connections == before


def test_half_a_reply_does_not_spoil_the_next_connection(daq: ModbusDaq) -> None:
    daq.plan().tally[Tally.RECEIVED] = 20  # as if the device had gone in the middle of one
    daq.close()
    daq.open()

    assert daq.read()["device_command_V"] == 0.0


def test_null_is_asked_for_over_a_connection_of_its_own(
    device: PymodbusDevice, daq: ModbusDaq
) -> None:
    daq.read()
    before = device.connections
    daq.safe_state()
    daq.safe_state()

    assert device.connections == before + 2
    assert device.read(768) == [1]


def test_null_needs_no_driver_that_was_ever_opened(device: PymodbusDevice) -> None:
    daq_of(device).safe_state()

    assert device.read(768) == [1]


@pytest.mark.parametrize(
    ("address", "values", "left"),
    [
        (274, float_registers(2.5), "device_command_V at 2.5"),
        (257, [0b100], "valve_enabled at 1"),
    ],
)
def test_null_that_the_device_does_not_confirm_is_an_error(
    device: PymodbusDevice,
    monkeypatch: pytest.MonkeyPatch,
    address: int,
    values: list[int],
    left: str,
) -> None:
    device.write(address, values)
    clock = ManualClock()
    time = SimpleNamespace(monotonic=lambda: 1e-9 * clock(), sleep=lambda _: clock.advance(1.0))
    monkeypatch.setattr("rig.io.modbus_daq.link.time", time)

    with pytest.raises(DriverError, match=left):
        daq_of(device).safe_state()


def test_a_device_without_null_request_is_written_zero_volt_and_valve_off(
    device: PymodbusDevice,
) -> None:
    device.write(0, [5, 0b001, *float_registers(4.0)])

    daq_of(device, replace(NODE, null_request=None)).safe_state()

    assert device.read(0, 4) == [5, 0, 0, 0]


def test_an_output_that_fails_does_not_keep_the_relay_closed(device: PymodbusDevice) -> None:
    device.write(1, [0b001])
    moved = [
        replace(register, address=5000) if register.signal == "command_V" else register
        for register in NODE.registers
    ]
    register_map = replace(NODE, null_request=None, exchange=("fc76",), registers=tuple(moved))

    with pytest.raises(DriverError, match="register 5000"):
        daq_of(device, register_map).safe_state()
    assert device.read(1) == [0]


def test_after_null_the_next_exchange_commands_nothing(
    device: PymodbusDevice, daq: ModbusDaq
) -> None:
    daq.write({"command_V": 3.0, "valve_enable": 1})
    daq.safe_state()
    daq.read()

    assert device.read(1, 3) == [0, 0, 0]


def test_diagnostics_tell_what_the_device_says_of_itself(device: PymodbusDevice) -> None:
    device.write(517, [3])

    assert daq_of(device).diagnostics() == {
        "identity": 0x5249,
        "map_version": 1,
        "watchdog_ms": 500,
        "greatest_rate_Hz": 1000,
        "power_up_id": 4711,
        "connections": 3,
    }


def test_a_refusal_survives_the_way_to_another_process() -> None:
    error = RefusedError("daq", "the node refuses", "check the map", "register 514")

    assert str(pickle.loads(pickle.dumps(error))) == str(error)
