"""The messages of the stream, version 1: their keys, and how they become bytes; see docs/stream.md.

Every message is one MessagePack map with the keys of `HEADER` and those of its kind,
both in `rig.stream.fields`. Samples are
packed arrays within it, so that a batch costs the same however many channels it has.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgpack
import numpy as np
from numpy.typing import NDArray

from .fields import FIELDS, HEADER, NEEDED, wrong_keys

Array = NDArray[np.float64]
Singles = NDArray[np.float32]

VERSION: Final = 1
"""Version of the schema, which is in every key and every message. Keys are added to messages
without a new one."""

PREFIX: Final = "rig"
KINDS: Final = (
    "channels", "samples", "decision", "event", "health", "campaign", "progress", "state",
    "heartbeat",
)  # fmt: skip
LASTING: Final = ("channels", "decision", "health", "campaign", "progress", "state", "heartbeat")
"""Kinds of which the newest message stands for what is so now: whoever asks for it gets it."""
KEPT: Final = ("samples", "event")
"""Kinds of which the last seconds are kept for late joiners."""

LARGEST_MESSAGE: Final = 1 << 20
"""Bytes that a reader takes; the publisher's batches are some kB."""
LONGEST_TEST_S: Final = 1e9
"""32 years: what is beyond is no time within a test, and its square is still a number."""


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
        MessageError: it is no key of this version, or of no single rig.
    """
    parts = text.split("/")
    if len(parts) < 4 or parts[0] != PREFIX or parts[2] != f"v{VERSION}":
        raise MessageError(f"{text}: is no key of version {VERSION}")
    if parts[1] != rig_id(parts[1]):
        raise MessageError(f"{text}: names no rig")
    return parts[1], "/".join(parts[3:])


def rig_id(name: str) -> str:
    """Return a rig's name as one part of a key: what Zenoh gives a meaning becomes `-`."""
    kept = "".join(sign if sign.isalnum() or sign in "._-" else "-" for sign in name)
    return kept or "rig"


def pack(content: Mapping[str, Any]) -> bytes:
    """Return a message as bytes; of a text that is none (a lone surrogate) `?` is sent."""
    return bytes(msgpack.packb(content, use_bin_type=True, unicode_errors="replace"))


def unpack(payload: bytes) -> dict[str, Any]:
    """Return a message of this version, its header checked; `read` checks the rest.

    Raises:
        MessageError: too large, not MessagePack, no map, of another version, or without header.
    """
    if len(payload) > LARGEST_MESSAGE:
        raise MessageError(f"{len(payload)} bytes are too many")
    try:
        content = msgpack.unpackb(payload, raw=False, strict_map_key=True)
    except Exception as error:  # whatever a parser makes of bytes that may be anything
        raise MessageError(f"is no MessagePack: {error}") from None
    if not isinstance(content, dict) or content.get("version") != VERSION:
        raise MessageError(f"is no message of version {VERSION}")
    _check_header(content)
    return content


def read(kind: str, content: Mapping[str, Any]) -> "Samples | Channels | Mapping[str, Any]":
    """Return what a message of a kind holds, once all of it was checked.

    Args:
        kind: one of `KINDS`; others are of no meaning here.
        content: a message, from `unpack`.

    Raises:
        MessageError: it is no message of this kind.
    """
    _check_header(content)
    if kind == "samples":
        return Samples.of(content)
    if kind == "channels":
        return Channels.of(content)
    _check(kind, content)
    return content


def _check_header(content: Mapping[str, Any]) -> None:
    if wrong_keys({name: content.get(name) for name in HEADER}, HEADER):
        raise MessageError("lacks its header")


def _check(kind: str, content: Mapping[str, Any]) -> None:
    """Look whether what a message holds is of its kind.

    Raises:
        MessageError: it is not.
    """
    if kind not in FIELDS:
        raise MessageError(f"{kind[:40]}: is no kind of message")
    missing = [name for name in NEEDED.get(kind, ()) if name not in content]
    if missing:
        raise MessageError(f"{kind} without {', '.join(missing)}")
    wrong = wrong_keys(content, FIELDS[kind])
    if wrong:
        raise MessageError(f"{kind} with {', '.join(wrong[:5])} that cannot be")


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
            MessageError: it holds none, its arrays do not fit each other, or its times are none.
        """
        _check("samples", content)
        rows, packed = content["rows"], (content["time_s"], content["values"])
        row_bytes = len(packed[1]) // rows if rows else 0
        if not rows or len(packed[0]) != 8 * rows or len(packed[1]) != row_bytes * rows:
            raise MessageError("samples whose arrays do not fit")
        if row_bytes % 4:
            raise MessageError("samples whose arrays do not fit")
        time_s = np.frombuffer(packed[0], "<f8")
        if not (np.abs(time_s) <= LONGEST_TEST_S).all():
            raise MessageError("samples at no time")
        return cls(
            channels_id=content["channels_id"],
            first_row=content["first_row"],
            test=content["test"],
            newest_ns=content["newest_ns"],
            time_s=time_s,
            values=np.frombuffer(packed[1], "<f4").reshape(rows, -1),
        )


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
        _check("channels", content)
        names, units = tuple(content["names"]), tuple(content["units"])
        if len(names) != len(units):
            raise MessageError("channels without names and units")
        return cls(content["id"], names, units)


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
