"""A sample is stored as a protobuf message, and a run of samples as one packed numpy array.

Every channel is a protobuf double, so all messages of a file have the same length. One numpy
structured dtype therefore covers MCAP record header, field tags and values, and a second of data is
converted to bytes, or bytes to columns, without a Python call per sample.
"""

import struct
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

MESSAGE_NAME: Final = "rig.Sample"
OVERVIEW_NAME: Final = "rig.Overview"
DETAILS_NAME: Final = "rig.Details"
MAX_CHANNELS: Final = 2047  # field numbers whose tag takes at most two bytes
MESSAGE_OPCODE: Final = 0x05  # MCAP: Message
RECORD_PREFIX: Final = 9  # MCAP: opcode (1 byte) and content length (8 bytes)

_ONE_BYTE_TAGS: Final = 15  # field numbers 1 to 15 have a tag of one byte
_WIRE_DOUBLE: Final = 1
_WIRE_BYTES: Final = 2
_WIRE_FLOAT: Final = 5
_LABEL_OPTIONAL: Final = 1
_TYPE_DOUBLE: Final = 1
_TYPE_FLOAT: Final = 2
_TYPE_FIXED64: Final = 6
_TYPE_FIXED32: Final = 7
_TYPE_BYTES: Final = 12


def _varint(value: int) -> bytes:
    encoded = bytearray()
    while value > 0x7F:
        encoded.append(value & 0x7F | 0x80)
        value >>= 7
    encoded.append(value)
    return bytes(encoded)


def _bytes_field(number: int, payload: bytes | str) -> bytes:
    data = payload.encode() if isinstance(payload, str) else payload
    return _varint(number << 3 | _WIRE_BYTES) + _varint(len(data)) + data


def _int_field(number: int, value: int) -> bytes:
    return _varint(number << 3) + _varint(value)


def sample_schema(channels: Sequence[str]) -> bytes:
    """Return the serialised FileDescriptorSet of message rig.Sample, with one double per channel.

    Field numbers are those of google/protobuf/descriptor.proto.
    """
    return _schema(MESSAGE_NAME, "rig/sample.proto", [(name, _TYPE_DOUBLE) for name in channels])


def overview_schema(channels: Sequence[str]) -> bytes:
    """Return the FileDescriptorSet of message rig.Overview, with one float per channel."""
    return _schema(OVERVIEW_NAME, "rig/overview.proto", [(name, _TYPE_FLOAT) for name in channels])


def details_schema() -> bytes:
    """Return the FileDescriptorSet of message rig.Details, which `details_message` makes."""
    fields = [("first", _TYPE_FIXED64), ("rows", _TYPE_FIXED32), ("columns", _TYPE_BYTES)]
    return _schema(DETAILS_NAME, "rig/details.proto", fields)


def _schema(full_name: str, path: str, named: Sequence[tuple[str, int]]) -> bytes:
    """Return the FileDescriptorSet of a message with these fields, each with the number of a type.

    Field numbers are 1, 2, and so on.
    """
    fields = b""
    for number, (name, kind) in enumerate(named, 1):
        # json_name (field 10) is given, as its default would turn pressure_1_Pa into pressure1Pa.
        descriptor = (
            _bytes_field(1, name)
            + _int_field(3, number)
            + _int_field(4, _LABEL_OPTIONAL)
            + _int_field(5, kind)
            + _bytes_field(10, name)
        )
        fields += _bytes_field(2, descriptor)
    package, message = full_name.split(".")
    file = (
        _bytes_field(1, path)
        + _bytes_field(2, package)
        + _bytes_field(4, _bytes_field(1, message) + fields)
        + _bytes_field(12, "proto3")
    )
    return _bytes_field(1, file)


_DETAILS_HEAD: Final = struct.Struct("<BQBIB")
"""Tag and value of the fields `first` and `rows`, and the tag of `columns`."""
_DETAILS_TAGS: Final = (1 << 3 | _WIRE_DOUBLE, 2 << 3 | _WIRE_FLOAT, 3 << 3 | _WIRE_BYTES)


def details_message(first: int, rows: int, columns: bytes) -> bytes:
    """Return a message rig.Details: packed columns of some rows, from row number `first` on."""
    tags = _DETAILS_TAGS
    head = _DETAILS_HEAD.pack(tags[0], first, tags[1], rows, tags[2])
    return head + _varint(len(columns)) + columns


def details_of(message: bytes) -> tuple[int, int, bytes]:
    """Return first row, number of rows and packed columns of a message of `details_message`.

    Raises:
        ValueError, struct.error: the message is not laid out as `details_message` does.
    """
    tag_1, first, tag_2, rows, tag_3 = _DETAILS_HEAD.unpack_from(message)
    at, length, shift = _DETAILS_HEAD.size, 0, 0
    # A length of 64 bits has ten bytes at most.
    while at < len(message) and shift < 70:
        byte = message[at]
        length |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte <= 0x7F:
            break
    if (tag_1, tag_2, tag_3) != _DETAILS_TAGS or at + length != len(message):
        raise ValueError(f"a message is not laid out as {DETAILS_NAME} of this program")
    return first, rows, message[at:]


class SampleLayout:
    """The layout of MCAP Message records with samples of `channels`, as a packed numpy dtype.

    Values are doubles, or floats if `single`.

    Attributes:
        channels: names of the channels.
        dtype: the dtype of one record.

    Raises:
        ValueError: there is no channel, or there are more than MAX_CHANNELS.
    """

    def __init__(self, channels: Sequence[str], *, single: bool = False) -> None:
        if not 0 < len(channels) <= MAX_CHANNELS:
            raise ValueError(f"{len(channels)} channels, must be 1 to {MAX_CHANNELS}")
        self.channels: Final = tuple(channels)
        wire, value = (_WIRE_FLOAT, "<f4") if single else (_WIRE_DOUBLE, "<f8")
        tags = [_varint(number << 3 | wire) for number in range(1, len(channels) + 1)]
        self._narrow = np.array([tag[0] for tag in tags[:_ONE_BYTE_TAGS]], dtype="u1")
        self._wide = np.frombuffer(b"".join(tags[_ONE_BYTE_TAGS:]), dtype="<u2")
        self.dtype: Final = np.dtype(
            [
                ("opcode", "u1"),
                ("length", "<u8"),
                ("channel_id", "<u2"),
                ("sequence", "<u4"),
                ("log_time", "<u8"),
                ("publish_time", "<u8"),
                ("narrow", [("tag", "u1"), ("value", value)], self._narrow.shape),
                ("wide", [("tag", "<u2"), ("value", value)], self._wide.shape),
            ]
        )
        self._content_length = self.dtype.itemsize - RECORD_PREFIX

    def blank(self, n: int, channel_id: int) -> NDArray[Any]:
        """Return n new sample records, shape (n,), whose sequence, times and values are still 0."""
        records = np.zeros(n, self.dtype)
        records["opcode"] = MESSAGE_OPCODE
        records["length"] = self._content_length
        records["channel_id"] = channel_id
        records["narrow"]["tag"] = self._narrow
        records["wide"]["tag"] = self._wide
        return records

    def set_values(self, records: NDArray[Any], rows: NDArray[np.float64]) -> None:
        """Set the values of records, shape (n,), in place to rows of shape (n, n_channels)."""
        records["narrow"]["value"] = rows[:, :_ONE_BYTE_TAGS]
        records["wide"]["value"] = rows[:, _ONE_BYTE_TAGS:]

    def values(self, records: NDArray[Any]) -> NDArray[np.float64]:
        """Return the values of records, shape (n,), as rows of shape (n, n_channels).

        Raises:
            ValueError: a field tag differs from this layout's.
        """
        if (records["narrow"]["tag"] != self._narrow).any() or (
            records["wide"]["tag"] != self._wide
        ).any():
            raise ValueError(f"messages are not laid out as {MESSAGE_NAME} of this file")
        rows = np.empty((len(records), len(self.channels)))
        rows[:, :_ONE_BYTE_TAGS] = records["narrow"]["value"]
        rows[:, _ONE_BYTE_TAGS:] = records["wide"]["value"]
        return rows

    def run_at(self, data: bytes, offset: int, channel_id: int) -> NDArray[Any]:
        """Return the unbroken run of sample records, shape (n,), that begins at data[offset].

        It ends before the first record that is incomplete, or no sample of this channel id.
        """
        count = (len(data) - offset) // self.dtype.itemsize
        records = np.frombuffer(data, self.dtype, count, offset)
        alike = (
            (records["opcode"] == MESSAGE_OPCODE)
            & (records["length"] == self._content_length)
            & (records["channel_id"] == channel_id)
        )
        return records if alike.all() else records[: int(np.argmin(alike))]
