"""The part of CANopen (CiA 301) that a drive's driver needs: identifiers, SDO, heartbeat, EMCY.

It has expedited SDO transfers only (section 7.2.4), since every object that is used fits into four
bytes. Sections are those of CiA 301 version 4.2.0.
"""

import struct
from dataclasses import dataclass
from enum import IntEnum
from typing import Final

# Identifiers of the predefined connection set, to which the node id is added (section 7.3.3).
NMT: Final = 0x000
EMERGENCY: Final = 0x080
TPDO1: Final = 0x180
RPDO1: Final = 0x200
SDO_REPLY: Final = 0x580
SDO_REQUEST: Final = 0x600
HEARTBEAT: Final = 0x700


class NmtCommand(IntEnum):
    """The command of a master to a node, first byte of the NMT message (section 7.2.8)."""

    START = 0x01
    STOP = 0x02
    PRE_OPERATIONAL = 0x80
    RESET_NODE = 0x81
    RESET_COMMUNICATION = 0x82


class NmtState(IntEnum):
    """The communication state of a node, which its heartbeat contains (section 7.2.8)."""

    BOOT_UP = 0x00
    STOPPED = 0x04
    OPERATIONAL = 0x05
    PRE_OPERATIONAL = 0x7F


@dataclass(frozen=True)
class Entry:
    """One entry of a node's object dictionary; `layout` is its `struct` format."""

    index: int
    subindex: int
    layout: str

    def __str__(self) -> str:
        return f"object 0x{self.index:04X}:{self.subindex}"


DEVICE_TYPE: Final = Entry(0x1000, 0, "<I")
CONSUMER_HEARTBEAT: Final = Entry(0x1016, 1, "<I")
PRODUCER_HEARTBEAT: Final = Entry(0x1017, 0, "<H")


class SdoError(Exception):
    """Raised when a node refuses a transfer; `code` is the abort code (section 7.2.4)."""

    def __init__(self, code: int) -> None:
        self.code = code
        super().__init__(ABORTS.get(code, f"abort code 0x{code:08X}"))


NO_OBJECT: Final = 0x0602_0000
READ_ONLY: Final = 0x0601_0002
WRONG_LENGTH: Final = 0x0607_0010
UNKNOWN_COMMAND: Final = 0x0504_0001

ABORTS: Final = {
    NO_OBJECT: "the object does not exist",
    READ_ONLY: "the object is read only",
    WRONG_LENGTH: "the length does not match",
    0x0609_0030: "the value is out of range",
    0x0800_0022: "not in the present device state",
    UNKNOWN_COMMAND: "unknown command",
    0x0604_0041: "the object cannot be mapped to a PDO",
    0x0609_0011: "the sub-index does not exist",
    0x0800_0020: "the device cannot store it",
}

_READ: Final = 0x40
_READ_REPLY: Final = 0x43
_WRITE: Final = 0x23
_WRITE_REPLY: Final = 0x60
_ABORT: Final = 0x80
_SIZE_SHIFT: Final = 2


def _frame(command: int, index: int, subindex: int, value: bytes = b"") -> bytes:
    return struct.pack("<BHB4s", command, index, subindex, value)


def _with_value(command: int, entry: Entry, value: int) -> bytes:
    """Return the 8 bytes of an SDO transfer that carries a value.

    Bits 2 and 3 of the command count the bytes of the value field that are not used.
    """
    data = struct.pack(entry.layout, value)
    unused = (4 - len(data)) << _SIZE_SHIFT
    return _frame(command | unused, entry.index, entry.subindex, data)


def read_request(entry: Entry) -> bytes:
    """Return the 8 bytes that ask a node for an entry (upload)."""
    return _frame(_READ, entry.index, entry.subindex)


def write_request(entry: Entry, value: int) -> bytes:
    """Return the 8 bytes that set an entry (download)."""
    return _with_value(_WRITE, entry, value)


def read_reply(entry: Entry, value: int) -> bytes:
    """Return the 8 bytes by which a node answers `read_request`."""
    return _with_value(_READ_REPLY, entry, value)


def write_reply(entry: Entry) -> bytes:
    """Return the 8 bytes by which a node answers `write_request`."""
    return _frame(_WRITE_REPLY, entry.index, entry.subindex)


def abort_reply(index: int, subindex: int, code: int) -> bytes:
    """Return the 8 bytes by which a node refuses a request for an entry, with an abort code."""
    return _frame(_ABORT, index, subindex, struct.pack("<I", code))


def answers(data: bytes, entry: Entry) -> bool:
    """Return whether the data of a node's reply are 8 bytes and concern an entry."""
    return len(data) == 8 and struct.unpack_from("<HB", data, 1) == (entry.index, entry.subindex)


def value_of(data: bytes, entry: Entry) -> int:
    """Return the value in a reply to `read_request`; return 0 for a reply to `write_request`.

    Raises:
        SdoError: the reply is a refusal.
        ValueError: the reply is of another kind, or its value is not as long as the entry.
    """
    command = data[0]
    if command == _ABORT:
        raise SdoError(struct.unpack_from("<I", data, 4)[0])
    if command == _WRITE_REPLY:
        return 0
    size = struct.calcsize(entry.layout)
    if command != _READ_REPLY | (4 - size) << _SIZE_SHIFT:
        raise ValueError(f"reply 0x{command:02X} is not {size} bytes of {entry}")
    return int(struct.unpack_from(entry.layout, data, 4)[0])


def value_to_write(request: bytes) -> bytes | None:
    """Return the bytes that an SDO request of 8 bytes writes into its entry; None if it reads it.

    Raises:
        SdoError: the request is no expedited transfer.
    """
    command = request[0]
    if command == _READ:
        return None
    if command & 0xF3 != _WRITE:
        raise SdoError(UNKNOWN_COMMAND)
    return request[4 : 8 - (command >> _SIZE_SHIFT & 0b11)]


_EMERGENCIES: Final = {
    0x00: "error reset",
    0x10: "generic error",
    0x20: "current",
    0x21: "current, device input side",
    0x22: "current inside the device",
    0x23: "current, device output side",
    0x30: "voltage",
    0x31: "mains voltage",
    0x32: "voltage inside the device",
    0x33: "output voltage",
    0x40: "temperature",
    0x41: "ambient temperature",
    0x42: "device temperature",
    0x50: "device hardware",
    0x60: "device software",
    0x61: "internal software",
    0x62: "user software",
    0x63: "data set",
    0x70: "additional modules",
    0x80: "monitoring",
    0x81: "communication",
    0x82: "protocol error",
    0x83: "control monitoring",
    0x90: "external error",
    0xF0: "additional functions",
    0xFF: "device specific",
}

_PARTICULAR_EMERGENCIES: Final = {
    0x8110: "CAN overrun, messages lost",
    0x8120: "CAN in error passive mode",
    0x8130: "heartbeat of the host lost",
    0x8140: "recovered from bus off",
    0x8150: "CAN identifier used twice",
    0x8250: "RPDO timeout",
    0x8301: "position control monitoring",
}


def emergency_words(code: int) -> str:
    """Return an emergency's error code in words (section 7.2.7; 83xx: CiA 408)."""
    return _PARTICULAR_EMERGENCIES.get(code) or _EMERGENCIES.get(code >> 8, "unknown error")
