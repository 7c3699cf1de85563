"""The messages of the stream, version 1: their keys, and how they become bytes; see docs/stream.md.

Every message is one MessagePack map with the keys of `HEADER` and those of its kind. Samples are
packed arrays within it, so that a batch costs the same however many channels it has.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgpack
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Singles = NDArray[np.float32]

VERSION: Final = 1
"""Of the schema, in every key and every message. Keys are added to messages without a new one."""

PREFIX: Final = "rig"
KINDS: Final = (
    "channels", "samples", "decision", "event", "health", "campaign", "progress", "state",
    "heartbeat",
)  # fmt: skip
LASTING: Final = ("channels", "decision", "health", "campaign", "progress", "state", "heartbeat")
"""Kinds of which the newest message stands for what is so now: whoever asks for it gets it."""
KEPT: Final = ("samples", "event")
"""Kinds of which the last seconds are kept for late joiners."""

HEADER: Final = ("version", "session", "sequence", "sent_ns")
LARGEST_MESSAGE: Final = 1 << 20
"""Bytes that a reader takes; the publisher's batches are some kB."""


class MessageError(ValueError):
    """Bytes that are no message of this version."""


def key(rig: str, kind: str) -> str:
    """Return the key of a kind of message of a rig; `*` stands for all of either."""
    return f"{PREFIX}/{rig}/v{VERSION}/{kind}"


def alive_key(rig: str) -> str:
    """Return the key of a rig's liveliness token."""
    return key(rig, "alive")


def command_key(rig: str, command: str) -> str:
    """Return the key of a command to a rig."""
    return key(rig, f"command/{command}")


def rig_and_kind(text: str) -> tuple[str, str]:
    """Return rig and kind of a key.

    Raises:
        MessageError: it is no key of this version.
    """
    parts = text.split("/")
    if len(parts) < 4 or parts[0] != PREFIX or parts[2] != f"v{VERSION}":
        raise MessageError(f"{text}: is no key of version {VERSION}")
    return parts[1], "/".join(parts[3:])


def rig_id(name: str) -> str:
    """Return a rig's name as one part of a key: what Zenoh gives a meaning becomes `-`."""
    kept = "".join(sign if sign.isalnum() or sign in "._-" else "-" for sign in name)
    return kept or "rig"


def pack(content: Mapping[str, Any]) -> bytes:
    """Return a message as bytes."""
    return bytes(msgpack.packb(content, use_bin_type=True))


def unpack(payload: bytes) -> dict[str, Any]:
    """Return a message of this version.

    Raises:
        MessageError: too large, not MessagePack, no map, of another version, or without header.
    """
    if len(payload) > LARGEST_MESSAGE:
        raise MessageError(f"{len(payload)} bytes are too many")
    try:
        content = msgpack.unpackb(payload, raw=False, strict_map_key=True)
    except (ValueError, msgpack.UnpackException, RecursionError) as error:
        raise MessageError(f"is no MessagePack: {error}") from None
    if not isinstance(content, dict) or content.get("version") != VERSION:
        raise MessageError(f"is no message of version {VERSION}")
    if not isinstance(content.get("session"), str) or any(
        type(content.get(name)) is not int for name in ("sequence", "sent_ns")
    ):
        raise MessageError("lacks its header")
    return content


@dataclass(frozen=True)
class Samples:
    """A batch of samples.

    Attributes:
        channels_id: number of the message `channels` that names the columns.
        first_row: number of the first row since the session's start; rows that are missing between
            one batch and the next were lost on the way, or overwritten before they were sent.
        test: number of the test they belong to, 0 outside.
        newest_ns: wall clock at which the newest of them was taken, ns since 1970.
        time_s: (n,) time of each, s.
        values: (n, channels) SI.
    """

    channels_id: int
    first_row: int
    test: int
    newest_ns: int
    time_s: Array
    values: Singles

    def content(self) -> dict[str, Any]:
        """Return what a message holds of it."""
        return {
            "channels_id": self.channels_id,
            "first_row": self.first_row,
            "test": self.test,
            "newest_ns": self.newest_ns,
            "rows": len(self.time_s),
            "time_s": self.time_s.astype("<f8").tobytes(),
            "values": self.values.astype("<f4").tobytes(),
        }

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "Samples":
        """Return the batch that a message holds.

        Raises:
            MessageError: its arrays do not fit each other.
        """
        try:
            rows = content["rows"]
            time_s = np.frombuffer(content["time_s"], "<f8")
            values = np.frombuffer(content["values"], "<f4")
            if not 0 < rows == time_s.size or values.size % rows:
                raise ValueError
            return cls(
                channels_id=int(content["channels_id"]),
                first_row=int(content["first_row"]),
                test=int(content["test"]),
                newest_ns=int(content["newest_ns"]),
                time_s=time_s,
                values=values.reshape(rows, -1),
            )
        except (KeyError, TypeError, ValueError):
            raise MessageError("samples whose arrays do not fit") from None


@dataclass(frozen=True)
class Channels:
    """Names and units of the columns of samples."""

    number: int
    names: tuple[str, ...]
    units: tuple[str, ...]

    def content(self) -> dict[str, Any]:
        """Return what a message holds of it."""
        return {"id": self.number, "names": list(self.names), "units": list(self.units)}

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "Channels":
        """Return the channels that a message names.

        Raises:
            MessageError: it does not.
        """
        try:
            names, units = (tuple(map(str, content[name])) for name in ("names", "units"))
            if len(names) != len(units):
                raise ValueError
            return cls(int(content["id"]), names, units)
        except (KeyError, TypeError, ValueError):
            raise MessageError("channels without names and units") from None


def finite(value: Any) -> Any:
    """Return a value for a message: numbers that are none (NaN, infinite) become None."""
    if isinstance(value, Mapping):
        return {str(name): finite(item) for name, item in value.items()}
    if isinstance(value, str | bytes | bool | int) or value is None:
        return value
    if isinstance(value, Sequence):
        return [finite(item) for item in value]
    number = float(value)
    return number if np.isfinite(number) else None
