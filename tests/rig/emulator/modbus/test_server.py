import socket
from collections.abc import Iterator
from struct import pack, unpack
from typing import Any

import pytest
from pymodbus.client import ModbusTcpClient

from rig.emulator.running import EmulatorThread
from tests.waiting import PATIENCE_S, until


@pytest.fixture
def client(emulator: EmulatorThread) -> Iterator[Any]:
    client = ModbusTcpClient("127.0.0.1", port=int(emulator.ports["daq"]), timeout=PATIENCE_S)
    assert client.connect()
    yield client
    client.close()


@pytest.fixture
def line(emulator: EmulatorThread) -> Iterator[socket.socket]:
    address = ("127.0.0.1", int(emulator.ports["daq"]))
    with socket.create_connection(address, timeout=PATIENCE_S) as line:
        yield line


def request(pdu: bytes, transaction: int = 1, protocol: int = 0) -> bytes:
    return pack(">HHHB", transaction, protocol, len(pdu) + 1, 1) + pdu


def reply(line: socket.socket) -> tuple[int, bytes]:
    """Return transaction and PDU of the next reply; an end of the line is an empty PDU."""
    header = exactly(line, 7)
    if not header:
        return 0, b""
    transaction, _, length, _ = unpack(">HHHB", header)
    return transaction, exactly(line, length - 1)


def exactly(line: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        try:
            more = line.recv(count - len(data))
        except ConnectionResetError:
            more = b""
        if not more:
            return b""
        data += more
    return data


IDENTITY = b"\x03\x02\x00\x00\x01"


def test_pymodbus_reads_and_writes_by_every_function_that_it_has(client: Any) -> None:
    assert client.read_holding_registers(512, count=2).registers == [0x5249, 1]
    assert client.read_input_registers(512, count=2).registers == [0x5249, 1]
    assert not client.write_register(514, 250).isError()
    assert client.read_holding_registers(514, count=1).registers == [250]
    assert not client.write_registers(0, [7, 4]).isError()
    both = client.readwrite_registers(read_address=0, read_count=2, address=0, values=[8, 0])
    assert both.registers == [8, 0]


def test_pymodbus_sees_the_exceptions_of_the_standard(client: Any) -> None:
    assert client.read_holding_registers(100, count=1).exception_code == 2
    assert client.write_register(514, 0).exception_code == 3
    assert client.read_coils(0, count=1).exception_code == 1


def test_feedback_answers_in_one_packet(line: socket.socket) -> None:
    frames = pack(">BHB", 1, 514, 1) + b"\0\xc8" + pack(">BHB", 0, 512, 1) + pack(">BHB", 0, 514, 1)
    line.sendall(request(b"\x4c" + frames, transaction=9))
    assert reply(line) == (9, b"\x4c\x52\x49\0\xc8")


def test_requests_sent_in_one_go_are_all_answered_in_order(line: socket.socket) -> None:
    line.sendall(b"".join(request(IDENTITY, transaction=n) for n in range(50)))
    assert [reply(line)[0] for _ in range(50)] == list(range(50))


def test_a_request_may_come_in_pieces(line: socket.socket) -> None:
    whole = request(IDENTITY, transaction=3)
    line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    for byte in whole:
        line.send(bytes((byte,)))
    assert reply(line) == (3, b"\x03\x02\x52\x49")


@pytest.mark.parametrize(
    "sent",
    [request(IDENTITY, protocol=1), pack(">HHHB", 1, 0, 1, 1) + b"\x03", b"GET / HTTP/1.1\r\n\r\n"],
    ids=["another protocol", "no function", "another program"],
)
def test_what_is_not_modbus_ends_the_connection(
    emulator: EmulatorThread, line: socket.socket, sent: bytes
) -> None:
    line.sendall(sent)
    assert reply(line) == (0, b"")
    assert any(event["event"] == "not_modbus" for event in list(emulator.record.events))


def test_several_clients_are_served_and_counted(client: Any, line: socket.socket) -> None:
    line.sendall(request(IDENTITY))
    reply(line)
    assert client.read_holding_registers(517, count=1).registers == [2]


def until_received(emulator: EmulatorThread, requests: int) -> None:
    until(lambda: emulator.status()["daq"]["requests"] >= requests, "the request to come")


@pytest.mark.parametrize(("what", "watchdog_ms"), [("replies", 200), ("requests", 100)])
def test_a_device_acts_on_what_reaches_it_whether_or_not_its_reply_does(
    emulator: EmulatorThread, line: socket.socket, what: str, watchdog_ms: int
) -> None:
    number = emulator.inject(fault="drop", what=what)
    line.sendall(request(b"\x06\x02\x02\0\xc8", transaction=1))
    until_received(emulator, 1)
    emulator.clear(number)
    line.sendall(request(IDENTITY, transaction=2))
    assert reply(line)[0] == 2
    assert emulator.status()["daq"]["watchdog_ms"] == watchdog_ms


def test_a_wrong_transaction_is_anybodys_but_ours(
    emulator: EmulatorThread, line: socket.socket
) -> None:
    emulator.inject(fault="wrong_transaction")
    line.sendall(request(IDENTITY, transaction=1))
    transaction, pdu = reply(line)
    assert transaction != 1
    assert pdu == b"\x03\x02\x52\x49"


def test_garbage_has_the_length_of_a_reply_and_nothing_else_of_it(
    emulator: EmulatorThread, line: socket.socket
) -> None:
    emulator.inject(fault="garbage")
    line.sendall(request(IDENTITY))
    received = exactly(line, 11)
    assert len(received) == 11
    assert received != request(b"\x03\x02\x52\x49")


def test_a_refusing_device_answers_with_the_exception_and_does_nothing(
    emulator: EmulatorThread, line: socket.socket
) -> None:
    emulator.inject(fault="exception", code=6)
    line.sendall(request(b"\x06\x02\x02\0\xc8"))
    assert reply(line)[1] == b"\x86\x06"
    assert emulator.status()["daq"]["watchdog_ms"] == 100


def test_a_late_reply_arrives(emulator: EmulatorThread, line: socket.socket) -> None:
    emulator.inject(fault="delay", by="20 ms")
    line.sendall(request(IDENTITY, transaction=5))
    assert reply(line) == (5, b"\x03\x02\x52\x49")


def test_a_device_that_disconnects_refuses_everybody_until_it_is_back(
    emulator: EmulatorThread, line: socket.socket
) -> None:
    line.sendall(request(IDENTITY))
    reply(line)
    number = emulator.inject(fault="disconnect")
    assert reply(line) == (0, b"")
    address = ("127.0.0.1", int(emulator.ports["daq"]))
    with socket.create_connection(address, timeout=PATIENCE_S) as refused:
        assert reply(refused) == (0, b"")
    emulator.clear(number)
    with socket.create_connection(address, timeout=PATIENCE_S) as accepted:
        accepted.sendall(request(IDENTITY))
        assert reply(accepted)[1] == b"\x03\x02\x52\x49"
