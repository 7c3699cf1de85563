"""Serves a device's registers over Modbus/TCP, through a wire that may have faults.

Requests are parsed here and not by a library: each is answered in one call of the event loop, in
the order in which requests arrive.
"""

import asyncio
import random
from dataclasses import dataclass
from struct import Struct
from typing import Final

from rig.emulator.addresses import listen
from rig.emulator.record import Record

from .functions import FEEDBACK_LIMIT, exception_reply, serve
from .io_device import IoDevice

# MBAP header: transaction, protocol (0), bytes that follow, unit (Modbus/TCP guide V1.0b).
_MBAP: Final = Struct(">HHHB")
_HEADER_BYTES: Final = 6


@dataclass
class Wire:
    """The present faults of the line to a device; there are none by default.

    Attributes:
        delay_s: time in s by which replies are late.
        requests_lost: whether requests never arrive.
        replies_lost: whether requests arrive, but their replies do not.
        garbage: whether replies are random bytes of the right length.
        wrong_transaction: whether replies have the number of another transaction.
        exception: code of the exception by which the device refuses every request; 0 for none.
        refuses: whether new connections are refused.
    """

    delay_s: float = 0.0
    requests_lost: bool = False
    replies_lost: bool = False
    garbage: bool = False
    wrong_transaction: bool = False
    exception: int = 0
    refuses: bool = False

    def passed(self, reply: bytes, noise: random.Random) -> bytes:
        """Return what arrives of a reply's frame; it is empty if request or reply is lost."""
        if self.requests_lost or self.replies_lost:
            return b""
        if self.wrong_transaction:
            reply = (int.from_bytes(reply[:2], "big") ^ 0x5555).to_bytes(2, "big") + reply[2:]
        return noise.randbytes(len(reply)) if self.garbage else reply


class ModbusServer:
    """A Modbus/TCP server for one device.

    Args:
        name: name of the device in the record.
        device: the device whose registers are served; any unit number reaches it.
        record: takes note of connections.

    Attributes:
        wire: faults of the line to the device; other code may change them at any time.
        requests: number of requests that came in, with those that the wire lost.
        connections: the clients' connections.
    """

    def __init__(self, name: str, device: IoDevice, record: Record) -> None:
        self.name, self.device, self.record = name, device, record
        self.wire = Wire()
        self.requests = 0
        self.noise = random.Random(0)
        self.connections: set[asyncio.Transport] = set()
        self._server: asyncio.Server | None = None

    async def open(self, host: str, port: int) -> int:
        """Begin to serve; return the port, which the system chooses if 0 is asked for.

        Raises:
            AddressError: the port is in use, or cannot be used.
        """
        self._server, port = await listen(self.name, host, port, lambda: _Connection(self))
        return port

    def close(self) -> None:
        """Close the port and all connections."""
        if self._server is not None:
            self._server.close()
        self.disconnect()

    def disconnect(self) -> None:
        """Close all connections at once; clients may connect again."""
        for connection in tuple(self.connections):
            connection.abort()

    def note(self, event: str, peer: str) -> None:
        """Record that a client's connection was made or lost, and set the device's number of them.

        `event` is "connected" or "disconnected", and `peer` is the client's address.
        """
        self.device.connections = len(self.connections)
        self.record.note(event, device=self.name, peer=peer)


class _Connection(asyncio.Protocol):
    """The connection of one client, which reads requests and answers them in order."""

    def __init__(self, server: ModbusServer) -> None:
        self._server = server
        self._received = bytearray()

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport
        if self._server.wire.refuses:
            transport.abort()
            return
        self._peer = "{}:{}".format(*transport.get_extra_info("peername")[:2])
        self._server.connections.add(transport)
        self._server.note("connected", self._peer)

    def connection_lost(self, exc: Exception | None) -> None:
        if self._transport in self._server.connections:
            self._server.connections.remove(self._transport)
            self._server.note("disconnected", self._peer)

    def data_received(self, data: bytes) -> None:
        self._received += data
        while len(self._received) > _MBAP.size:
            _, protocol, length, _ = _MBAP.unpack_from(self._received)
            if protocol != 0 or not 2 <= length <= FEEDBACK_LIMIT - _HEADER_BYTES:
                # This is not Modbus/TCP: nobody knows where the next request would begin.
                self._server.record.note("not_modbus", device=self._server.name, peer=self._peer)
                self._transport.abort()
                return
            end = _HEADER_BYTES + length
            if len(self._received) < end:
                return
            request = bytes(self._received[:end])
            del self._received[:end]
            self._server.requests += 1
            self._answer(request)

    def _answer(self, request: bytes) -> None:
        """Answer a request through the wire, of whose faults several may act at once."""
        wire, pdu = self._server.wire, request[_MBAP.size :]
        if wire.requests_lost:
            return
        if wire.exception:
            reply = exception_reply(pdu, wire.exception)
        else:
            reply = serve(self._server.device, pdu)
        reply = wire.passed(_framed(request, reply), self._server.noise)
        if wire.delay_s > 0.0:
            loop = asyncio.get_running_loop()
            loop.call_later(wire.delay_s, self._transport.write, reply)
        else:
            self._transport.write(reply)


def _framed(request: bytes, reply: bytes) -> bytes:
    """Return the reply PDU with the header that answers the request."""
    transaction, _, _, unit = _MBAP.unpack_from(request)
    return _MBAP.pack(transaction, 0, len(reply) + 1, unit) + reply
