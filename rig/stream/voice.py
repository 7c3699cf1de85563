"""What a rig says on this machine is signed, so that no other program can speak in its name.

On loopback whoever is on the machine may publish on a rig's keys. There a rig signs its messages
and answers by a key of the user who runs it, in a file that only that user may read. A message
bears its signature as its last key, `mac`: HMAC-SHA256 of the Zenoh key, a zero byte, and all bytes
of the message before the signature. Profiles with certificates or passwords say who may publish by
access control, and sign nothing.
"""

import hmac
from collections.abc import Mapping
from contextlib import suppress
from typing import Any, Final

from .commands import KeyFileError, own_key
from .messages import pack
from .settings import StreamSettings

MAC: Final = "mac"
"""Key of the signature in a message."""
_MAC_BYTES: Final = 32
_HEAD: Final = b"\xa3mac\xc4\x20"
"""MessagePack of the text `mac` and of the type and length of the 32 bytes that follow."""
_PURPOSE: Final = b"hydraulic-rig stream, version 1: what a rig says"
"""What the user's key is used for here: commands are signed by the key itself, so that no signature
of the one passes for the other."""


class Voice:
    """Signs what a rig says, and tells whether it has said something.

    Args:
        key: secret key of the user who runs the rig.
    """

    def __init__(self, key: bytes) -> None:
        self._key = hmac.digest(key, _PURPOSE, "sha256")

    def signed(self, zenoh_key: str, content: Mapping[str, Any]) -> bytes:
        """Return a message, or an answer, as bytes that end in the signature.

        Args:
            zenoh_key: the Zenoh key on which it is sent.
            content: its content, which has no key `mac`.
        """
        payload = pack({**content, MAC: bytes(_MAC_BYTES)})
        said = payload[:-_MAC_BYTES]
        return said + self._mac(zenoh_key, said)

    def said(self, zenoh_key: str, payload: bytes) -> bool:
        """Return whether these bytes were signed by this voice for this Zenoh key."""
        said, mac = payload[:-_MAC_BYTES], payload[-_MAC_BYTES:]
        return said.endswith(_HEAD) and hmac.compare_digest(self._mac(zenoh_key, said), mac)

    def _mac(self, zenoh_key: str, said: bytes) -> bytes:
        return hmac.digest(self._key, zenoh_key.encode() + b"\0" + said, "sha256")


def said(content: Mapping[str, Any], zenoh_key: str, voice: Voice | None) -> bytes:
    """Return a message or an answer as bytes, signed by a voice if there is one."""
    return pack(content) if voice is None else voice.signed(zenoh_key, content)


def voice_of(settings: StreamSettings) -> Voice | None:
    """Return the voice of this user's rigs by a profile; None if rigs sign nothing by it.

    The user's key is made if there is none.

    Raises:
        KeyFileError: the key cannot be made or used.
    """
    known = settings.tls or settings.login or settings.access
    if known or not settings.is_local or settings.mode != "peer":
        return None
    return Voice(own_key("stream.key")[0])


def reader_s_voice_of(settings: StreamSettings) -> Voice | None:
    """Return the same for a reader, and None if its key cannot be used: it can prove nothing."""
    with suppress(KeyFileError):
        return voice_of(settings)
    return None
