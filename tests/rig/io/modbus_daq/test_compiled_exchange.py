import os
import re
import struct
import subprocess
import sys
from collections.abc import Iterator
from math import isnan
from pathlib import Path
from typing import Any, Literal

import pytest
from hypothesis import example, given, strategies as st
from pymodbus.client import ModbusTcpClient

from rig.io.driver import ExchangeStatus
from rig.io.modbus_daq.compiled_exchange import Tally, exception_name
from rig.io.modbus_daq.register_map import WORDS, ExchangeMode, Register, RegisterMap, RegisterType
from rig.io.signals import FAST_INPUTS
from tests.rig.io.modbus_bench import UNIT, Line, framed, map_of, registers_of, shipped_map

NODE = shipped_map("io_node")
ANYTHING = bytes(40)


def reply(sequence: int, data: bytes = ANYTHING) -> bytes:
    return framed(sequence, bytes((23, len(data))) + data)


@pytest.fixture
def line() -> Iterator[Line]:
    with Line(NODE) as line:
        yield line


def test_the_request_carries_id_unit_and_outputs(line: Line) -> None:
    line.exchange(0x1234, {"command_V": -2.5, "valve_enable": 1, "host_counter": 513, "rearm": 1})

    head = struct.pack(">BHHHHB", 23, 256, 20, 0, 4, 8)
    values = struct.pack(">HHf", 513, 0b011, -2.5)
    assert line.received() == framed(0x1234, head + values)


def test_a_switch_that_goes_off_again_is_written_off(line: Line) -> None:
    line.exchange(1, {"valve_enable": 1, "reset_lamp": 1})
    line.received()
    line.exchange(2, {"reset_lamp": 1})

    assert line.received()[19:21] == b"\x00\x04"


def test_what_the_node_answers_is_read_in_si(line: Line) -> None:
    values = (7, 0b10101, 3, 0, 1_000_000, -20_000, 5e3, 2.5e3, 13.8e3, -120.0, 1500.0, 2.5)
    line.send(reply(1, struct.pack(">HHHHIiffffff", *values)))

    assert line.exchange(1) is ExchangeStatus.OK
    found = {name: line.input(name) for name in FAST_INPUTS if not isnan(line.input(name))}
    assert found == pytest.approx(
        {
            "position_m": -0.6,
            "pressure_1_Pa": 5e6,
            "pressure_2_Pa": 2.5e6,
            "spool_m": -120e-6,
            "supply_pressure_Pa": 13.8e6,
            "load_N": 1500.0,
            "estop_closed": 1.0,
            "reset_button": 0.0,
            "valve_enabled": 1.0,
            "watchdog_tripped": 0.0,
            "encoder_fault": 1.0,
            "device_counter": 7.0,
            "device_echo": 3.0,
            "device_command_V": 2.5,
        }
    )


def test_no_reply_until_the_deadline_is_a_timeout_and_reads_nothing(line: Line) -> None:
    line.send(reply(1))
    line.exchange(1)

    assert line.exchange(2) is ExchangeStatus.TIMEOUT
    assert all(map(isnan, line.inputs))


def test_a_reply_that_comes_too_late_is_dropped_and_counted(line: Line) -> None:
    line.exchange(1)
    line.exchange(2)
    fresh = struct.pack(">HH", 99, 0) + ANYTHING[4:]
    line.send(reply(1), reply(2), reply(3, fresh))

    assert line.exchange(3) is ExchangeStatus.OK
    assert line.input("device_counter") == 99
    assert line.plan.tally[Tally.LATE] == 2


def test_late_replies_are_known_as_such_when_the_id_starts_over(line: Line) -> None:
    line.exchange(0xFFFF)
    line.send(reply(0xFFFF), reply(0x10000))

    assert line.exchange(0x10000) is ExchangeStatus.OK


def test_a_reply_cut_in_two_is_put_together(line: Line) -> None:
    whole = reply(1)
    for cut in (3, 6, 20):
        line.send(whole[:cut])
        assert line.exchange(1) is ExchangeStatus.TIMEOUT
        line.send(whole[cut:])
        assert line.exchange(1) is ExchangeStatus.OK


def test_half_a_reply_does_not_spoil_the_next(line: Line) -> None:
    line.send(reply(1)[:20])
    assert line.exchange(1) is ExchangeStatus.TIMEOUT
    line.send(reply(1)[20:], reply(2))

    assert line.exchange(2) is ExchangeStatus.OK


@pytest.mark.parametrize(
    "wrong",
    [
        reply(0x4242),
        framed(1, bytes((23, 40)) + ANYTHING, unit=UNIT + 1),
        framed(1, bytes((3, 40)) + ANYTHING),
        framed(1, bytes((23, 38)) + ANYTHING[2:]),
        framed(1, bytes((23, 38)) + ANYTHING),
    ],
    ids=["transaction", "unit", "function", "length", "byte count"],
)
def test_a_reply_to_something_else_is_refused_and_the_next_one_is_taken(
    line: Line, wrong: bytes
) -> None:
    line.send(wrong)

    assert line.exchange(1) is ExchangeStatus.WRONG_REPLY
    assert all(map(isnan, line.inputs))
    line.send(reply(2))
    assert line.exchange(2) is ExchangeStatus.OK
    assert line.plan.tally[Tally.LATE] == 0


def test_an_exception_is_kept_with_its_name(line: Line) -> None:
    line.send(framed(1, bytes((23 | 0x80, 3))))

    assert line.exchange(1) is ExchangeStatus.EXCEPTION
    assert exception_name(int(line.plan.tally[Tally.EXCEPTION])) == "exception 3 (illegal value)"
    line.send(reply(2))
    assert line.exchange(2) is ExchangeStatus.OK
    assert line.plan.tally[Tally.LATE] == 0


@pytest.mark.parametrize(
    "garbage",
    [b"GET / HTTP/1.1\r\n\r\n", bytes(60), b"\x00\x01\x00\x00\xff\xff" + bytes(9)],
    ids=["text", "zeros", "endless"],
)
def test_garbage_is_dropped_whole_and_the_line_recovers(line: Line, garbage: bytes) -> None:
    line.send(garbage)

    assert line.exchange(1) is ExchangeStatus.GARBAGE
    line.send(reply(2))
    assert line.exchange(2) is ExchangeStatus.OK


@given(noise=st.binary(max_size=400))
@example(noise=b"\x00\x01\x00\x00\x00\x02")
def test_whatever_comes_the_exchange_ends_and_recovers_once_it_is_quiet(noise: bytes) -> None:
    with Line(NODE) as line:
        line.send(noise)
        statuses = [line.exchange(sequence) for sequence in range(0x7000, 0x7080)]

        # What is left may be the start of a frame, which what comes next completes.
        line.send(bytes(1100))
        line.exchange(0x7090)
        line.exchange(0x7091)
        line.send(reply(0x7092))
        recovered = line.exchange(0x7092)

    assert ExchangeStatus.DISCONNECTED not in statuses
    assert recovered is ExchangeStatus.OK


def test_a_closed_connection_is_distinguished_from_a_silent_one(line: Line) -> None:
    line.device.close()

    assert line.exchange(1) is ExchangeStatus.DISCONNECTED


def test_a_connection_closed_after_half_a_reply_is_lost(line: Line) -> None:
    line.send(reply(1)[:20])
    assert line.exchange(1) is ExchangeStatus.TIMEOUT
    line.received()
    line.device.close()

    assert line.exchange(2) is ExchangeStatus.DISCONNECTED


def test_a_device_that_takes_nothing_any_more_does_not_hold_up_the_loop(line: Line) -> None:
    # Nobody reads at the other end, so the line fills up sooner or later.
    statuses = {line.exchange(sequence) for sequence in range(30_000)}

    assert statuses <= {ExchangeStatus.TIMEOUT, ExchangeStatus.DISCONNECTED}


def test_writing_and_reading_apart_takes_both_replies() -> None:
    with Line(NODE, "fc16_fc3") as line:
        wrote = framed(2, struct.pack(">BHH", 16, 0, 4))
        line.send(wrote, framed(3, bytes((3, 40)) + struct.pack(">H", 77) + ANYTHING[2:]))

        assert line.exchange(1, {"command_V": 1.0}) is ExchangeStatus.OK
        assert line.input("device_counter") == 77
        written = framed(2, struct.pack(">BHHBHHf", 16, 0, 4, 8, 0, 0, 1.0))
        assert line.received() == written + framed(3, struct.pack(">BHH", 3, 256, 20))


def test_nothing_is_read_where_the_write_is_refused() -> None:
    with Line(NODE, "fc16_fc3") as line:
        line.send(framed(2, bytes((16 | 0x80, 2))))

        assert line.exchange(1) is ExchangeStatus.EXCEPTION
        assert len(line.received()) == 21


def test_a_labjack_s_switches_can_be_turned_round() -> None:
    t7 = shipped_map("labjack_t7")
    with Line(t7, "fc76") as line:
        # AIN0 to AIN4, FIO5 and FIO6, FIO_STATE, DIO0_EF_READ_A, by address.
        data = struct.pack(">5fHHHi", 2.0, 1.0, 5.0, -2.5, 0.5, 0, 1, 0b10000, -100)
        line.send(framed(1, b"\x4c" + data))

        assert line.exchange(1, {"command_V": 4.0, "valve_enable": 1}) is ExchangeStatus.OK
        assert line.input("estop_closed") == 1
        assert line.input("reset_button") == 0
        assert line.input("valve_enabled") == 1
        assert line.input("pressure_1_Pa") == pytest.approx(4.14e6)
        assert line.input("spool_m") == pytest.approx(-100e-6)
        assert line.input("position_m") == pytest.approx(-3e-3)
        assert isnan(line.input("device_command_V"))
        writes = struct.pack(">BHBHBHBHBHBf", 1, 2004, 1, 1, 1, 2007, 1, 0, 1, 30004, 2, 4.0)
        assert line.received()[8:].startswith(writes)


def test_nan_is_never_commanded(line: Line) -> None:
    line.exchange(1, {"command_V": float("nan"), "valve_enable": float("nan")})

    assert line.received()[-8:] == bytes(8)


def node_of(kind: RegisterType, scale: float, offset: float, *, low_first: bool) -> RegisterMap:
    """Return a map with one output and one input of a type."""
    return map_of(
        Register("command_V", 0, kind, "w", scale=scale, offset=offset, unit="V"),
        Register("device_command_V", 256, kind, "r", scale=scale, offset=offset, unit="V"),
        word_order="low_first" if low_first else "high_first",
    )


TYPES = {
    "U16": ModbusTcpClient.DATATYPE.UINT16,
    "I16": ModbusTcpClient.DATATYPE.INT16,
    "U32": ModbusTcpClient.DATATYPE.UINT32,
    "I32": ModbusTcpClient.DATATYPE.INT32,
    "F32": ModbusTcpClient.DATATYPE.FLOAT32,
}
LOWEST = {"U16": 0, "I16": -(2**15), "U32": 0, "I32": -(2**31)}
HIGHEST = {"U16": 2**16 - 1, "I16": 2**15 - 1, "U32": 2**32 - 1, "I32": 2**31 - 1}
scales = st.floats(1e-6, 1e3).flatmap(lambda scale: st.sampled_from([scale, -scale]))


@given(
    kind=st.sampled_from(["U16", "I16", "U32", "I32", "F32"]),
    scale=scales,
    offset=st.floats(-100.0, 100.0),
    low_first=st.booleans(),
    data=st.data(),
)
def test_every_type_order_and_scale_goes_out_as_pymodbus_reads_it_and_comes_back(
    kind: RegisterType, scale: float, offset: float, low_first: bool, data: st.DataObject
) -> None:
    number: float
    if kind == "F32":
        number = data.draw(st.floats(-1e6, 1e6, width=32))
    else:
        number = data.draw(st.integers(LOWEST[kind], HIGHEST[kind]))
    value = scale * number + offset
    with Line(node_of(kind, scale, offset, low_first=low_first)) as line:
        line.exchange(1, {"command_V": value})
        sent = line.received()[-2 * WORDS[kind] :]
        line.send(framed(2, bytes((23, len(sent))) + sent))
        status = line.exchange(2)
        back = line.input("device_command_V")

    order: Literal["big", "little"] = "little" if low_first else "big"
    registers = list(struct.unpack(f">{len(sent) // 2}H", sent))
    read: Any = ModbusTcpClient.convert_from_registers(registers, TYPES[kind], word_order=order)
    # Adding the offset rounds: by that much the number may be another one.
    lost = 4e-16 * (abs(value) + abs(offset)) / abs(scale)
    assert read == pytest.approx(number, rel=1e-6, abs=lost if kind == "F32" else 0.5 + lost)
    assert status is ExchangeStatus.OK
    assert back == scale * read + offset


@given(kind=st.sampled_from(["U16", "I16", "U32", "I32"]), beyond=st.floats(1.0, 1e12))
def test_what_an_integer_register_cannot_hold_is_clipped(kind: RegisterType, beyond: float) -> None:
    with Line(node_of(kind, 1.0, 0.0, low_first=False)) as line:
        line.exchange(1, {"command_V": HIGHEST[kind] + beyond})
        highest = line.received()[-2 * WORDS[kind] :]
        line.exchange(2, {"command_V": LOWEST[kind] - beyond})
        lowest = line.received()[-2 * WORDS[kind] :]

    signed = kind.startswith("I")
    assert int.from_bytes(highest, "big", signed=signed) == HIGHEST[kind]
    assert int.from_bytes(lowest, "big", signed=signed) == LOWEST[kind]


@pytest.mark.parametrize("mode", ["fc23", "fc76", "fc16_fc3"])
def test_all_ways_to_exchange_write_and_read_the_same(mode: ExchangeMode) -> None:
    values = registers_of(range(1, 21))
    with Line(NODE, mode) as line:
        if mode == "fc23":
            line.send(framed(5, bytes((23, 40)) + values))
        elif mode == "fc76":
            # The spare register 259 and the sample's time, 260 and 261, are no signals.
            line.send(framed(5, b"\x4c" + values[:6] + values[12:]))
        else:
            line.send(framed(10, struct.pack(">BHH", 16, 0, 4)))
            line.send(framed(11, bytes((3, 40)) + values))
        assert line.exchange(5, {"host_counter": 0xABCD}) is ExchangeStatus.OK
        assert line.input("device_counter") == 1
        assert line.input("device_echo") == 3
        assert line.input("position_m") == pytest.approx(0x0007_0008 * 3e-5)
        assert line.received().count(b"\xab\xcd") == 1


def test_the_specification_s_example_is_what_is_sent_and_read() -> None:
    page = (Path(__file__).parents[4] / "docs" / "io_node.md").read_text()
    request, answer = (
        bytes.fromhex(block) for block in re.findall(r"```hex\n(.*?)```", page, re.S)
    )

    with Line(NODE, unit=1) as line:
        line.send(answer)
        outputs = {"host_counter": 42, "valve_enable": 1, "command_V": 1.5}
        assert line.exchange(42, outputs) is ExchangeStatus.OK
        assert line.received() == request
        found = {name: line.input(name) for name in FAST_INPUTS if not isnan(line.input(name))}
    assert found == pytest.approx(
        {
            "position_m": 0.30345,
            "pressure_1_Pa": 5.25e6,
            "pressure_2_Pa": 6.8755e6,
            "spool_m": 41.9e-6,
            "supply_pressure_Pa": 13.8e6,
            "load_N": 0.0,
            "estop_closed": 1.0,
            "reset_button": 0.0,
            "valve_enabled": 1.0,
            "watchdog_tripped": 0.0,
            "encoder_fault": 0.0,
            "device_counter": 1042.0,
            "device_echo": 42.0,
            "device_command_V": 1.5,
        }
    )


@pytest.mark.long
def test_the_exchange_runs_interpreted_too() -> None:
    found = subprocess.run(
        [sys.executable, "-m", "pytest", __file__, "-q", "-p", "no:cacheprovider", "-k",
         "not interpreted and not type and not whatever and not takes_nothing"],
        env={**os.environ, "NUMBA_DISABLE_JIT": "1"},
        capture_output=True,
        text=True,
        check=False,
    )  # fmt: skip
    assert found.returncode == 0, found.stdout
