import struct

import pytest
from pymodbus.framer import FramerSocket
from pymodbus.pdu import DecodePDU, ModbusPDU
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    WriteMultipleRegistersRequest,
)

from rig.io.modbus_daq.frames import (
    exchange_requests,
    feedback,
    read_registers,
    read_write,
    write_registers,
)
from rig.io.modbus_daq.register_map import Span
from tests.rig.io.modbus_bench import shipped_map

UNIT = 17
SPANS = [Span(0, 1), Span(256, 20), Span(0xFF00, 100)]


def by_pymodbus(request: ModbusPDU) -> bytes:
    request.dev_id = UNIT
    return FramerSocket(DecodePDU(False)).buildFrame(request)


@pytest.mark.parametrize("span", SPANS)
def test_a_read_request_is_pymodbus_s_byte_for_byte(span: Span) -> None:
    expected = ReadHoldingRegistersRequest(address=span.address, count=span.size)

    assert read_registers(UNIT, span).frame == by_pymodbus(expected)


@pytest.mark.parametrize("span", SPANS)
def test_a_write_request_is_pymodbus_s_byte_for_byte(span: Span) -> None:
    expected = WriteMultipleRegistersRequest(address=span.address, registers=[0] * span.size)

    assert write_registers(UNIT, span).frame == by_pymodbus(expected)


@pytest.mark.parametrize("written", SPANS)
def test_a_read_write_request_is_pymodbus_s_byte_for_byte(written: Span) -> None:
    expected = ReadWriteMultipleRegistersRequest(
        read_address=256, read_count=20, write_address=written.address,
        write_registers=[0] * written.size,
    )  # fmt: skip

    assert read_write(UNIT, Span(256, 20), written).frame == by_pymodbus(expected)


def test_values_stand_where_pymodbus_puts_them() -> None:
    values = [0x1234, 0x5678, 0x9ABC]
    expected = by_pymodbus(
        ReadWriteMultipleRegistersRequest(
            read_address=7, read_count=2, write_address=40, write_registers=values
        )
    )

    request = read_write(UNIT, Span(7, 2), Span(40, 3))
    frame = bytearray(request.frame)
    for address, value in zip(range(40, 43), values, strict=True):
        at = request.written[address]
        frame[at : at + 2] = value.to_bytes(2, "big")

    assert bytes(frame) == expected


def test_a_feedback_request_is_laid_out_as_labjack_documents_it() -> None:
    # MBAP: transaction, protocol 0, length, unit; then 76, write frames `01 addr16 n8 data` and
    # read frames `00 addr16 n8` ("Protocol Details", Modbus Feedback).
    request = feedback(1, [Span(0, 4), Span(3000, 2)], [Span(2004, 1), Span(30004, 2)])

    assert request.frame == bytes.fromhex(
        "0000 0000 0018 01 4c01 07d4 01 000001 7534 02 0000000000 0000 0400 0bb8 02"
    )
    assert request.written == {2004: 12, 30004: 18, 30005: 20}


def test_a_feedback_reply_is_its_function_and_the_values_read() -> None:
    request = feedback(1, [Span(0, 4), Span(3000, 2)], [])

    assert request.reply_head == b"\x4c"
    assert request.reply_size == 8 + 12
    assert request.returned == {0: 8, 1: 10, 2: 12, 3: 14, 3000: 16, 3001: 18}


@pytest.mark.parametrize("name", ["labjack_t7", "labjack_t8"])
def test_a_labjack_writes_before_it_reads_and_samples_ain0_before_captures(name: str) -> None:
    (request,), _ = exchange_requests(shipped_map(name), "fc76", 1)

    at, kinds, read = 8, [], []
    while at < len(request.frame):
        kind, address, size = struct.unpack_from(">BHB", request.frame, at)
        kinds.append(kind)
        read += [address] if kind == 0 else []
        at += 4 + 2 * size * kind
    assert kinds == sorted(kinds, reverse=True)
    assert read[0] == 0


def test_two_transactions_write_before_they_read() -> None:
    (write, read), _ = exchange_requests(shipped_map("io_node"), "fc16_fc3", 1)

    assert (write.frame[7], read.frame[7]) == (16, 3)
    assert write.returned == read.written == {}
