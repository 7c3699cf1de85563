from struct import pack
from typing import Any

import pytest
from hypothesis import given, strategies as st
from pymodbus.pdu.register_message import (
    ReadHoldingRegistersRequest,
    ReadHoldingRegistersResponse,
    ReadInputRegistersRequest,
    ReadWriteMultipleRegistersRequest,
    ReadWriteMultipleRegistersResponse,
    WriteMultipleRegistersRequest,
    WriteSingleRegisterRequest,
)

from rig.emulator.modbus.functions import ILLEGAL_ADDRESS, ModbusException, serve


class Registers:
    """A hundred registers that can be read and written."""

    functions = frozenset((3, 4, 6, 16, 23, 76))

    def __init__(self) -> None:
        self.connections = 0
        self.data = bytearray(200)

    def has(self, address: int, count: int) -> bool:
        return address + count <= 100

    def read(self, address: int, count: int) -> bytes:
        if address + count > 100:
            raise ModbusException(ILLEGAL_ADDRESS)
        return bytes(self.data[2 * address : 2 * (address + count)])

    def write(self, address: int, data: bytes) -> None:
        if 2 * address + len(data) > 200:
            raise ModbusException(ILLEGAL_ADDRESS)
        self.data[2 * address : 2 * address + len(data)] = data


@pytest.fixture
def device() -> Any:
    return Registers()


def test_what_pymodbus_asks_is_understood_and_the_answer_is_what_it_expects(
    device: Any,
) -> None:
    write = WriteMultipleRegistersRequest(address=10, registers=[1, 2, 65535])
    assert serve(device, b"\x10" + write.encode()) == b"\x10" + pack(">HH", 10, 3)
    for read in (ReadHoldingRegistersRequest, ReadInputRegistersRequest):
        request = read(address=10, count=3)
        reply = serve(device, bytes((request.function_code,)) + request.encode())
        assert reply[0] == request.function_code
        parsed = ReadHoldingRegistersResponse()
        parsed.decode(reply[1:])
        assert parsed.registers == [1, 2, 65535]


def test_one_register_is_written_and_its_request_echoed(device: Any) -> None:
    request = b"\x06" + WriteSingleRegisterRequest(address=7, registers=[513]).encode()
    assert serve(device, request) == request
    assert device.data[14:16] == b"\x02\x01"


def test_function_23_writes_before_it_reads(device: Any) -> None:
    request = ReadWriteMultipleRegistersRequest(
        read_address=0, read_count=4, write_address=1, write_registers=[7, 8]
    )
    reply = serve(device, b"\x17" + request.encode())
    parsed = ReadWriteMultipleRegistersResponse()
    parsed.decode(reply[1:])
    assert parsed.registers == [0, 7, 8, 0]


def test_function_23_writes_nothing_when_it_cannot_read(device: Any) -> None:
    request = ReadWriteMultipleRegistersRequest(
        read_address=99, read_count=4, write_address=1, write_registers=[7]
    )
    assert serve(device, b"\x17" + request.encode()) == b"\x97\x02"
    assert not any(device.data)


def test_feedback_serves_its_frames_in_order_as_labjack_documents() -> None:
    # Direct Modbus TCP, "Modbus Feedback (MBFB, function #76)": read frames are 0, address, number
    # of registers; write frames 1, address, number, data; the reply holds the data read, in order.
    device: Any = Registers()
    request = bytes((76,)) + b"".join(
        (
            pack(">BHB", 0, 5, 1),
            pack(">BHB", 1, 5, 2) + b"\xaa\xbb\xcc\xdd",
            pack(">BHB", 0, 5, 2),
        )
    )
    assert serve(device, request) == bytes((76,)) + b"\0\0" + b"\xaa\xbb\xcc\xdd"


@pytest.mark.parametrize(
    "request_pdu",
    [
        b"\x03\0\0\0\0",
        b"\x03\0\0\0\x7e",
        b"\x03\0\0",
        b"\x10\0\0\0\x01\x02",
        b"\x10\0\0\0\x02\x02\0\0",
        b"\x06\0\0",
        b"\x17\0\0\0\x01\0\0\0\x01\x04\0\0",
        b"\x4c",
        b"\x4c\x02\0\0\x01",
        b"\x4c\x00\0\0",
        b"\x4c\x01\0\0\x02\0\0",
        b"\x4c" + 11 * b"\x00\0\0\x64",
    ],
    ids=str,
)
def test_a_request_that_contradicts_itself_is_an_illegal_value(
    device: Any, request_pdu: bytes
) -> None:
    assert serve(device, request_pdu) == bytes((request_pdu[0] | 0x80, 3))


@pytest.mark.parametrize("function", [1, 2, 5, 15, 43])
def test_functions_of_coils_and_others_are_illegal(device: Any, function: int) -> None:
    assert serve(device, bytes((function, 0, 0, 0, 1))) == bytes((function | 0x80, 1))


@pytest.mark.parametrize(
    "request_pdu",
    [b"\x03\0\x63\0\x02", b"\x06\x00\x64\0\0", b"\x4c\x00\x00\x64\x01"],
    ids=["read", "write", "feedback"],
)
def test_registers_that_there_are_not_are_an_illegal_address(
    device: Any, request_pdu: bytes
) -> None:
    assert serve(device, request_pdu) == bytes((request_pdu[0] | 0x80, 2))


@given(st.binary(min_size=1, max_size=260))
def test_whatever_is_asked_there_is_an_answer_to_that_function(request_pdu: bytes) -> None:
    device: Any = Registers()
    reply = serve(device, request_pdu)
    refused = len(reply) == 2 and reply[0] == request_pdu[0] | 0x80 and reply[1] in (1, 2, 3)
    assert refused or reply[0] == request_pdu[0]
