"""The request frames of an exchange as bytes, with the place of each value in them.

The requests follow the Modbus Application Protocol V1.1b3, sections 6.3 (read), 6.12 (write) and
6.17 (both), in the frame of "Modbus Messaging on TCP/IP" V1.0b, section 3.1.3. Function 76 follows
LabJack's "Protocol Details".
"""

import struct
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from .register_map import ExchangeMode, RegisterMap, Span, block, spans

TRANSACTION_AT: Final = 0
"""Byte of a frame at which its transaction id begins, high byte first."""

LENGTH_AT: Final = 4
"""Byte of a frame at which the number of bytes after that number begins, high byte first."""

UNIT_AT: Final = 6
FUNCTION_AT: Final = 7

_READ, _WRITE, _READ_WRITE, _FEEDBACK = 3, 16, 23, 76
_FEEDBACK_READ, _FEEDBACK_WRITE = 0, 1


class Request(NamedTuple):
    """One transaction: the frame that is sent, and the form of its reply.

    Attributes:
        frame: the frame with transaction id 0 and all values 0.
        reply_head: the bytes that the reply must have from its function code up to its values.
        reply_size: length of the reply in bytes.
        written: byte of the frame at which the value of each written register begins, by address.
        returned: byte of the reply at which the value of each read register begins, by address.
    """

    frame: bytes
    reply_head: bytes
    reply_size: int
    written: Mapping[int, int]
    returned: Mapping[int, int]


def exchange_requests(
    register_map: RegisterMap, mode: ExchangeMode, unit: int, *, owned: bool = False
) -> tuple[tuple[Request, ...], Request]:
    """Return the transactions that exchange all outputs and inputs, and one that only reads.

    Args:
        register_map: the device's registers.
        mode: one of the modes in the map's `exchange`.
        unit: unit id, 0 to 255.
        owned: whether the registers of ownership are exchanged too.

    Returns:
        The transactions of an exchange in the order of sending, and the transaction that reads all
        inputs and writes no output.
    """
    read, written = register_map.exchanged(owned=owned)
    if mode == "fc76":
        look = feedback(unit, spans(read), ())
        return (feedback(unit, spans(read), spans(written)),), look
    look = read_registers(unit, block(read))
    if mode == "fc23":
        return (read_write(unit, block(read), block(written)),), look
    return (write_registers(unit, block(written)), look), look


def read_registers(unit: int, read: Span) -> Request:
    """Return a request of function 3, read holding registers."""
    pdu = struct.pack(">BHH", _READ, *read)
    return _request(unit, pdu, bytes((_READ, 2 * read.size)), (), (read,))


def write_registers(unit: int, written: Span) -> Request:
    """Return a request of function 16, write multiple registers."""
    head = struct.pack(">BHH", _WRITE, *written)
    pdu = head + bytes((2 * written.size,))
    return _request(unit, pdu, head, ((len(pdu), written),), ())


def read_write(unit: int, read: Span, written: Span) -> Request:
    """Return a request of function 23, which writes first and then reads."""
    pdu = struct.pack(">BHHHHB", _READ_WRITE, *read, *written, 2 * written.size)
    head = bytes((_READ_WRITE, 2 * read.size))
    return _request(unit, pdu, head, ((len(pdu), written),), (read,))


def feedback(unit: int, read: Sequence[Span], written: Sequence[Span]) -> Request:
    """Return a request of LabJack's function 76, which writes first and then reads.

    The device carries out the parts of the request in their order.
    """
    pdu = bytes((_FEEDBACK,))
    places = []
    for span in written:
        pdu += struct.pack(">BHB", _FEEDBACK_WRITE, *span)
        places.append((len(pdu), span))
        pdu += bytes(2 * span.size)
    for span in read:
        pdu += struct.pack(">BHB", _FEEDBACK_READ, *span)
    return _request(unit, pdu, bytes((_FEEDBACK,)), places, read)


def _request(
    unit: int,
    pdu: bytes,
    reply_head: bytes,
    written: Sequence[tuple[int, Span]],
    read: Sequence[Span],
) -> Request:
    """Return the request of a protocol data unit, put into a frame.

    Args:
        unit: unit id.
        pdu: the protocol data unit; zeros are appended if the values of its last run are missing.
        reply_head: the bytes that the reply must begin with, from its function code on.
        written: runs of registers that are written, each with the byte of `pdu` at which its values
            begin.
        read: runs of registers that the reply holds, in order.
    """
    room = max((at + 2 * span.size for at, span in written), default=0)
    pdu = pdu.ljust(room, b"\0")
    places = {
        span.address + word: FUNCTION_AT + at + 2 * word
        for at, span in written
        for word in range(span.size)
    }
    registers = [span.address + word for span in read for word in range(span.size)]
    values_at = FUNCTION_AT + len(reply_head)
    returned = {address: values_at + 2 * index for index, address in enumerate(registers)}
    header = struct.pack(">HHHB", 0, 0, 1 + len(pdu), unit)
    return Request(header + pdu, reply_head, values_at + 2 * len(registers), places, returned)
