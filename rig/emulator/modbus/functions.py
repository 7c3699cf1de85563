"""Serves Modbus functions on a device's registers: a reply PDU is made of each request PDU.

Functions 3, 4, 6, 16 and 23 follow the Modbus Application Protocol V1.1b3; function 76 is LabJack's
"feedback" of the T series (Direct Modbus TCP, protocol details).
"""

from collections.abc import Callable
from struct import Struct
from typing import Final

from .io_device import IoDevice

ILLEGAL_FUNCTION: Final = 1
ILLEGAL_ADDRESS: Final = 2
ILLEGAL_VALUE: Final = 3
BUSY: Final = 6
"""Another master owns the device."""

_READ_LIMIT: Final = 125
_WRITE_LIMIT: Final = 123
_READ_WRITE_LIMIT: Final = 121
FEEDBACK_LIMIT: Final = 1040
"""Greatest number of bytes of a LabJack packet, MBAP header included."""

_MBAP_BYTES: Final = 7
_TWO: Final = Struct(">HH")
_FOUR: Final = Struct(">HHHH")
_FRAME: Final = Struct(">BHB")
_READ_FRAME: Final = 0
_WRITE_FRAME: Final = 1


class ModbusException(Exception):  # noqa: N818 (the protocol's word)
    """Raised when a device refuses a request; `code` is that of its exception reply."""

    def __init__(self, code: int) -> None:
        super().__init__(f"Modbus exception {code}")
        self.code = code


def serve(device: IoDevice, request: bytes) -> bytes:
    """Return a device's reply PDU to a request PDU of at least a byte.

    It is an exception reply if the device does not serve the function or refuses the request. The
    parts of a feedback request (function 76) that come before the refused one have been done.
    """
    try:
        if request[0] not in device.functions:
            raise ModbusException(ILLEGAL_FUNCTION)
        return request[:1] + _FUNCTIONS[request[0]](device, request[1:])
    except ModbusException as refused:
        return exception_reply(request, refused.code)


def exception_reply(request: bytes, code: int) -> bytes:
    """Return the exception reply with a code to a request PDU."""
    return bytes((request[0] | 0x80, code))


def _require(granted: bool) -> None:
    if not granted:
        raise ModbusException(ILLEGAL_VALUE)


def _read(device: IoDevice, body: bytes) -> bytes:
    _require(len(body) == _TWO.size)
    address, count = _TWO.unpack(body)
    _require(1 <= count <= _READ_LIMIT)
    return bytes((2 * count,)) + device.read(address, count)


def _write_one(device: IoDevice, body: bytes) -> bytes:
    _require(len(body) == _TWO.size)
    device.write(_TWO.unpack(body)[0], body[2:])
    return body


def _write_many(device: IoDevice, body: bytes) -> bytes:
    _require(len(body) > _TWO.size)
    address, count = _TWO.unpack_from(body)
    _require(1 <= count <= _WRITE_LIMIT and body[4] == 2 * count == len(body) - 5)
    device.write(address, body[5:])
    return body[:4]


def _read_write(device: IoDevice, body: bytes) -> bytes:
    """Write first and then read, as in the standard; write nothing if the read is refused."""
    _require(len(body) > _FOUR.size)
    read_at, read_count, write_at, write_count = _FOUR.unpack_from(body)
    _require(1 <= read_count <= _READ_LIMIT and 1 <= write_count <= _READ_WRITE_LIMIT)
    _require(body[8] == 2 * write_count == len(body) - 9)
    if not device.has(read_at, read_count):
        raise ModbusException(ILLEGAL_ADDRESS)
    device.write(write_at, body[9:])
    return bytes((2 * read_count,)) + device.read(read_at, read_count)


def _feedback(device: IoDevice, body: bytes) -> bytes:
    """Serve the frames of a request in order, and return what its reads yield.

    A frame is a read `00 address16 count8` or a write `01 address16 count8 data`.
    """
    replies: list[bytes] = []
    at = 0
    while at < len(body):
        _require(len(body) - at >= _FRAME.size)
        kind, address, count = _FRAME.unpack_from(body, at)
        at += _FRAME.size
        _require(kind in (_READ_FRAME, _WRITE_FRAME) and count > 0)
        if kind == _READ_FRAME:
            replies.append(device.read(address, count))
        else:
            data = body[at : at + 2 * count]
            _require(len(data) == 2 * count)
            device.write(address, data)
            at += 2 * count
    _require(bool(body))
    reply = b"".join(replies)
    _require(len(reply) + _MBAP_BYTES + 1 <= FEEDBACK_LIMIT)
    return reply


_FUNCTIONS: Final[dict[int, Callable[[IoDevice, bytes], bytes]]] = {
    3: _read,
    4: _read,
    6: _write_one,
    16: _write_many,
    23: _read_write,
    76: _feedback,
}
