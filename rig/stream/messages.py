"""The stream's messages, version 1, with their Zenoh keys and their bytes; see docs/stream.md.

Every message is one MessagePack map with the keys of `HEADER` and those of its kind, both in
`rig.stream.fields`. Samples are packed arrays within it, so that the time to pack a batch hardly
depends on the number of channels.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import msgpack
import numpy as np
from numpy.typing import NDArray

from rig.unique_keys import RepeatedKeyError, unique_keys

from .fields import FIELDS, HEADER, NEEDED, wrong_keys

VERSION: Final = 1
"""Version of the schema, which is in every Zenoh key and in every message. It does not change when
keys are added to messages."""

PREFIX: Final = "rig"
KINDS: Final = tuple(FIELDS)
LASTING: Final = ("channels", "decision", "health", "campaign", "progress", "state", "heartbeat")
"""Kinds whose newest message is the present state; the publisher sends it to readers who ask."""
KEPT: Final = ("samples", "event")
"""Kinds of which the publisher stores past messages for readers who join late."""

LARGEST_MESSAGE: Final = 1 << 20
"""Most bytes of a message that a reader accepts; the publisher's batches are some kB."""
LONGEST_TEST_S: Final = 1e9
"""Largest magnitude in s of a sample's time, 32 years; a message with a larger one is refused."""

_OF_A_BATCH: Final = ("channels_id", "first_row", "test", "newest_ns")
"""Attributes of `Samples` that are in the message under their own names."""


class MessageError(ValueError):
    """The error of bytes, or of content, that are no message of this version."""


def key(rig: str, kind: str) -> str:
    """Return the Zenoh key of a rig's messages of a kind; `*` means all rigs, or all kinds."""
    return f"{PREFIX}/{rig}/v{VERSION}/{kind}"


def alive_key(rig: str) -> str:
    """Return the Zenoh key of a rig's liveliness token."""
    return key(rig, "alive")


def command_key(rig: str, command: str) -> str:
    """Return the Zenoh key of a command to a rig."""
    return key(rig, f"command/{command}")


def rig_and_kind(text: str) -> tuple[str, str]:
    """Return the rig's id and the rest of a Zenoh key: a kind, `alive` or `command/<name>`.

    Whether such a kind exists is not checked.

    Raises:
        MessageError: the text is no key of this version, or does not name a single rig.
    """
    parts = text.split("/")
    if len(parts) < 4 or parts[0] != PREFIX or parts[2] != f"v{VERSION}":
        raise MessageError(f"{text}: is no key of version {VERSION}")
    if parts[1] != rig_id(parts[1]):
        raise MessageError(f"{text}: names no rig")
    return parts[1], "/".join(parts[3:])


def rig_id(name: str) -> str:
    """Return a rig's id, a part of every Zenoh key, from the rig's name.

    In it `-` stands for each character that is no letter, no digit, and neither `.` nor `_`. The id
    for an empty name is "rig".
    """
    kept = "".join(sign if sign.isalnum() or sign in "._-" else "-" for sign in name)
    return kept or "rig"


def pack(content: Mapping[str, Any]) -> bytes:
    """Return a message as bytes; a lone surrogate in a text becomes `?`."""
    return bytes(msgpack.packb(content, use_bin_type=True, unicode_errors="replace"))


def unpack(payload: bytes) -> dict[str, Any]:
    """Return the content of a message after checking its header; `read` checks the rest.

    Raises:
        MessageError: the payload is too large, not MessagePack, no map, of another version, or
            without a valid header.
    """
    if len(payload) > LARGEST_MESSAGE:
        raise MessageError(f"{len(payload)} bytes are too many")
    try:
        content = msgpack.unpackb(
            payload, raw=False, strict_map_key=True, object_pairs_hook=unique_keys
        )
    except RepeatedKeyError as error:
        raise MessageError(str(error)) from None
    except Exception as error:  # the parser may raise anything, as the bytes may be anything
        raise MessageError(f"is no MessagePack: {error}") from None
    if not isinstance(content, dict) or content.get("version") != VERSION:
        raise MessageError(f"is no message of version {VERSION}")
    _check_header(content)
    return content


def read(kind: str, content: Mapping[str, Any]) -> "Samples | Channels | Mapping[str, Any]":
    """Check all of a message, and return its content: `Samples`, `Channels`, or else the map.

    Args:
        kind: kind of the message, one of `KINDS`.
        content: the content, from `unpack`.

    Raises:
        MessageError: the content is no message of this kind, or there is no such kind.
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
    """Raise unless the content of a message has the needed keys and valid values of its kind.

    Raises:
        MessageError: a key is missing, a value is not valid, or there is no such kind.
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
        channels_id: the `id` of the message `channels` that names the columns.
        first_row: number of the batch's first row within the run, which a publisher that restarts
            continues. Rows that are missing between two batches were lost on the way, or dropped or
            overwritten before they were sent.
        test: number of the test that the samples belong to; 0 outside of tests.
        newest_ns: wall clock, ns since 1970, at which the newest row was taken that the publisher
            had by then; it may be a later row than the batch's last.
        time_s: (n,) time of each sample within its test, s.
        values: (n, channels) values, SI, float32.
    """

    channels_id: int
    first_row: int
    test: int
    newest_ns: int
    time_s: NDArray[np.float64]
    values: NDArray[np.float32]

    def content(self) -> dict[str, Any]:
        """Return the batch as the content of a message."""
        return {
            **{name: getattr(self, name) for name in _OF_A_BATCH},
            "rows": len(self.time_s),
            "time_s": self.time_s.astype("<f8").tobytes(),
            "values": self.values.astype("<f4").tobytes(),
        }

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "Samples":
        """Return the batch in the content of a message.

        Raises:
            MessageError: the content is no batch, has no rows, its arrays do not have the stated
                length, or a time is not finite or beyond `LONGEST_TEST_S`.
        """
        _check("samples", content)
        rows, times, values = content["rows"], content["time_s"], content["values"]
        if not rows or len(times) != 8 * rows or len(values) % (4 * rows):
            raise MessageError("samples whose arrays do not fit")
        time_s = np.frombuffer(times, "<f8")
        if not (np.abs(time_s) <= LONGEST_TEST_S).all():
            raise MessageError("samples at no time")
        return cls(
            **{name: content[name] for name in _OF_A_BATCH},
            time_s=time_s,
            values=np.frombuffer(values, "<f4").reshape(rows, -1),
        )


@dataclass(frozen=True)
class Channels:
    """Names and SI units of the columns of samples; batches refer to them by their `number`."""

    number: int
    names: tuple[str, ...]
    units: tuple[str, ...]

    def content(self) -> dict[str, Any]:
        """Return the channels as the content of a message."""
        return {"id": self.number, "names": list(self.names), "units": list(self.units)}

    @classmethod
    def of(cls, content: Mapping[str, Any]) -> "Channels":
        """Return the channels in the content of a message.

        Raises:
            MessageError: the content lacks names, units or number, or has not as many units as
                names.
        """
        _check("channels", content)
        names, units = tuple(content["names"]), tuple(content["units"])
        if len(names) != len(units):
            raise MessageError("channels without names and units")
        return cls(content["id"], names, units)


def finite(value: Any) -> Any:
    """Return a value for a message, with plain types, and None in place of NaN and infinity.

    Maps and sequences are converted throughout, with text keys. Text, bytes, integers and booleans
    stay as they are; any other number, also one of numpy's, becomes a float.
    """
    if isinstance(value, Mapping):
        return {str(name): finite(item) for name, item in value.items()}
    if isinstance(value, str | bytes | bool | int) or value is None:
        return value
    if isinstance(value, Sequence):
        return [finite(item) for item in value]
    number = float(value)
    return number if np.isfinite(number) else None
