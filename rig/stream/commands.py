"""Commands to a rig are signed by their sender, and checked by the publisher before any other use.

A command is a Zenoh query on `rig/<id>/v1/command/<name>`. Its payload is an envelope with the
sender's name, the packed body, and HMAC-SHA256 of the body with the sender's key. A command is
refused if it is too large, malformed, from an unknown sender, not allowed, forged, for another rig
or another session, stale, or a repetition.
"""

import hmac
import os
import secrets
import time
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path
from tempfile import NamedTemporaryFile
from typing import Any, Final

import msgpack

from rig.unique_keys import RepeatedKeyError, unique_keys

from .messages import VERSION, pack
from .settings import COMMANDS, Operator, StreamSettings

LARGEST_COMMAND: Final = 2048
"""Most bytes of a command's payload."""
OTHER_SESSION: Final = "is for another session of this rig's stream"
"""Why a command is refused whose sender has not heard yet that the rig's stream began anew."""
WINDOW_S: Final = 5.0
"""Most difference in s between the sender's time in a command and the rig's clock at its arrival.

A command with a larger difference is stale.
"""
LONGEST_NAME: Final = 64
"""Most characters of an operator's name."""
LONGEST_TEXT: Final = 500
"""Most characters of the sender's remark; a longer one is cut off."""
LONGEST_TEST: Final = 200
"""Most characters of a test's name; a longer one is cut off."""
KEY_BYTES: Final = 32
SENDERS_KEPT: Final = 1024
"""Most senders whose last sequence number is stored, until all they sent is certainly stale."""

_ENVELOPE: Final = {"version": int, "by": str, "body": bytes, "mac": bytes}
_BODY: Final = {
    "rig": str, "session": str, "command": str, "sender": bytes, "sequence": int, "at_ns": int,
    "text": str,
}  # fmt: skip
_FURTHER: Final = {"test": str, "person": str}
"""Further keys of the body of a command that names a test, or who gives it."""


class KeyFileError(ValueError):
    """The error of a key file that cannot be used, with reason and remedy."""


class Refused(Exception):  # noqa: N818 (a refusal, not a failure)
    """The error of a command that is refused.

    Attributes:
        why: the reason in one word, such as `stale`.
        by: the name of the sender that the command claims; empty if it cannot be read.
    """

    def __init__(self, why: str, text: str, by: str = "") -> None:
        self.why, self.by = why, by
        super().__init__(f"{why}: {text}")


@dataclass(frozen=True)
class Command:
    """A command that has passed all checks and is to be obeyed.

    Attributes:
        name: one of `COMMANDS`.
        by: name of the sender.
        text: the sender's remark, in which unprintable characters are spaces.
        number: number of the command among those that passed in this session, from 1 on.
        test: name of the test that the command is about; empty for the present one.
        person: name of who gave the command, as the sender says; empty if it does not. The sender
            itself is proven by its signature, the person is not.
    """

    name: str
    by: str
    text: str
    number: int
    test: str = ""
    person: str = ""


@dataclass(frozen=True)
class Credentials:
    """The name of a sender, and the secret key by which it proves that name.

    The key is left out when credentials are shown, so that it never gets into a log.
    """

    name: str
    key: bytes = field(repr=False)


class Sender:
    """A signer of commands, which gives each command a greater sequence number than the last."""

    def __init__(self, credentials: Credentials) -> None:
        self._credentials = credentials
        self._sender = secrets.token_bytes(8)
        self._sequence = 0

    def sign(
        self, rig: str, session: str, command: str, text: str = "", test: str = "", person: str = ""
    ) -> bytes:
        """Return the signed payload of a command to a rig.

        Args:
            rig: id of the rig.
            session: name of the present session of the rig's stream.
            command: one of `COMMANDS`.
            text: a remark; cut off after `LONGEST_TEXT` characters.
            test: name of the test that it is about; empty for the present one.
            person: name of who gives it; empty if that is not known.
        """
        self._sequence += 1
        body = {
            "rig": rig,
            "session": session,
            "command": command,
            "sender": self._sender,
            "sequence": self._sequence,
            "at_ns": time.time_ns(),
            "text": text[:LONGEST_TEXT],
        }
        if test:
            body["test"] = test
        if person:
            body["person"] = person[:LONGEST_NAME]
        return seal(self._credentials, pack(body))


def seal(credentials: Credentials, body: bytes) -> bytes:
    """Return the payload of a command: its packed body in a signed envelope."""
    mac = hmac.digest(credentials.key, body, "sha256")
    return pack({"version": VERSION, "by": credentials.name, "body": body, "mac": mac})


class Gate:
    """The check that every command must pass before it is obeyed.

    Args:
        rig: the rig's id.
        session: name of the publisher's session. Commands to an earlier session are refused, so
            that no sequence numbers have to be stored over a restart.
        operators: name -> credentials and allowed commands of each operator.
    """

    def __init__(
        self, rig: str, session: str, operators: Mapping[str, tuple[Credentials, frozenset[str]]]
    ) -> None:
        self._rig, self._session = rig, session
        self._operators = operators
        self._seen: dict[bytes, tuple[int, int]] = {}
        self._passed = 0

    def judge(self, name: str, payload: bytes) -> Command:
        """Check a payload that came on the Zenoh key of the command `name`; return its command.

        The command's number is stored, so that the same payload is refused when it comes again.

        Raises:
            Refused: the command must not be obeyed. Nobody may command here, or too many senders
                do (`SENDERS_KEPT`); the payload is too large or malformed; its sender is unknown or
                not allowed this command; its signature does not fit; it is for another rig or
                session, or stale; or its number is not above the last one from its sender.
        """
        if not self._operators:
            raise Refused("denied", "this stream takes no commands")
        if len(payload) > LARGEST_COMMAND:
            raise Refused("oversized", f"{len(payload)} bytes, at most {LARGEST_COMMAND}")
        envelope = _mapping(payload, _ENVELOPE, {}, "")
        if envelope["version"] != VERSION:
            raise Refused("malformed", f"is not of version {VERSION}")
        by = str(envelope["by"])[:LONGEST_NAME]
        credentials, allowed = self._operators.get(by, (None, frozenset()))
        # An unknown name is compared too, so that the time does not show which names are known.
        key = credentials.key if credentials is not None else bytes(KEY_BYTES)
        genuine = hmac.compare_digest(hmac.digest(key, envelope["body"], "sha256"), envelope["mac"])
        if credentials is None:
            raise Refused("unauthenticated", "nobody of this name may command", by)
        if not genuine:
            raise Refused("forged", "its signature does not fit", by)
        body = _mapping(envelope["body"], _BODY, _FURTHER, by)
        self._check(name, body, by, allowed)
        self._passed += 1
        said = _printable(str(body["text"])[:LONGEST_TEXT])
        person = _printable(str(body.get("person", ""))[:LONGEST_NAME]).strip()
        test = str(body.get("test", ""))[:LONGEST_TEST]
        return Command(name, by, said, self._passed, test, person)

    def _check(self, name: str, body: Mapping[str, Any], by: str, allowed: frozenset[str]) -> None:
        if body["command"] != name or name not in COMMANDS:
            raise Refused("malformed", "is no command, or another than its key says", by)
        if name not in allowed:
            raise Refused("denied", f"{by} may not {name}", by)
        if body["rig"] != self._rig:
            raise Refused("misdirected", "is for another rig", by)
        if body["session"] != self._session:
            raise Refused("replayed", OTHER_SESSION, by)
        now_ns = time.time_ns()
        late_s = 1e-9 * (now_ns - body["at_ns"])
        if abs(late_s) > WINDOW_S:
            text = f"its clock is {late_s:.0f} s behind the rig's; commands last {WINDOW_S:g} s"
            raise Refused("stale", text, by)
        sender = bytes(body["sender"])
        last, _ = self._seen.get(sender, (0, 0))
        if body["sequence"] <= last:
            raise Refused("replayed", f"number {body['sequence']} came before", by)
        if sender not in self._seen and len(self._seen) >= SENDERS_KEPT:
            oldest_ns = now_ns - round(2e9 * WINDOW_S)
            self._seen = {who: seen for who, seen in self._seen.items() if seen[1] > oldest_ns}
            if len(self._seen) >= SENDERS_KEPT:
                raise Refused("denied", "too many senders at once", by)
        self._seen[sender] = body["sequence"], now_ns


def _printable(text: str) -> str:
    """Return a text with a space in the place of each character that is not printable."""
    return "".join(c if c.isprintable() else " " for c in text)


def _mapping(
    payload: bytes, kinds: Mapping[str, type], optional: Mapping[str, type], by: str
) -> dict[str, Any]:
    """Unpack a map that has all keys of `kinds`, any of `optional`, and no others.

    Each value must be of exactly the type that `kinds` or `optional` gives for its key.

    Raises:
        Refused: the payload is no such map. `by` is the sender that the error names.
    """
    known = {**kinds, **optional}
    try:
        content = msgpack.unpackb(
            payload, raw=False, strict_map_key=True, max_map_len=2 * len(known), max_array_len=0,
            max_ext_len=0, object_pairs_hook=unique_keys,
        )  # fmt: skip
    except RepeatedKeyError as error:
        raise Refused("malformed", str(error), by) from None
    except (ValueError, msgpack.UnpackException, RecursionError) as error:
        raise Refused("malformed", f"is no MessagePack: {error}"[:200], by) from None
    fits = isinstance(content, dict) and kinds.keys() <= content.keys() <= known.keys()
    if not fits or any(type(value) is not known[name] for name, value in content.items()):
        raise Refused("malformed", "has not the fields of a command", by)
    return dict(content)


def gate_of(settings: StreamSettings, rig: str, session: str) -> Gate:
    """Return the gate of a rig's stream, after reading its operators' keys.

    Raises:
        KeyFileError: a key cannot be used.
    """
    operators = {
        operator.name: (credentials_of(operator), frozenset(map(str, operator.allow)))
        for operator in settings.operators
    }
    return Gate(rig, session, operators)


def credentials_of(operator: Operator) -> Credentials:
    """Return an operator's credentials, with the key of its key file or else this user's own key.

    This user's own key is made if there is none yet.

    Raises:
        KeyFileError: the key cannot be made or used.
    """
    key = own_key("stream.key")[0] if operator.key_file is None else read_key(operator.key_file)
    return Credentials(operator.name, key)


def read_key(path: Path) -> bytes:
    """Return the secret key in a file of hexadecimal digits.

    Raises:
        KeyFileError: the file cannot be read, others may read it, or it holds no key.
    """
    try:
        with path.open("rb") as file:
            mode = os.fstat(file.fileno()).st_mode
            text = file.read(1024)
    except OSError as error:
        raise KeyFileError(f"{path}: key cannot be read: {error.strerror}; make it") from None
    if mode & 0o077:
        raise KeyFileError(f"{path}: key may be read by others; chmod 600 {path}")
    key = b""
    with suppress(ValueError):
        key = bytes.fromhex(text.decode("ascii").strip())
    if len(key) != KEY_BYTES:
        made = f"openssl rand -hex {KEY_BYTES}"
        raise KeyFileError(f"{path}: holds no key of {2 * KEY_BYTES} hexadecimal digits; {made}")
    return key


def make_key(path: Path) -> None:
    """Write a new key to a file that only its owner may read, unless the file exists already.

    Raises:
        KeyFileError: the file cannot be written.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        # A temporary file may be read by its owner only, and so may what is linked to it.
        with NamedTemporaryFile("w", prefix=f".{path.name}.", dir=path.parent) as file:
            file.write(secrets.token_hex(KEY_BYTES) + "\n")
            file.flush()
            # If another process made the file meanwhile, its key stays.
            with suppress(FileExistsError):
                os.link(file.name, path)
    except OSError as error:
        raise KeyFileError(f"{path}: key cannot be written: {error.strerror}") from None


def state_folder() -> Path:
    """Return the folder of this user's secrets and state, which need not exist."""
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    return state / "hydraulic-rig"


def own_key(name: str) -> tuple[bytes, Path]:
    """Return a key of this user on this machine, which is made if it does not exist, and its file.

    Args:
        name: name of the file in the folder of this user's secrets and state.

    Raises:
        KeyFileError: the key cannot be made or used.
    """
    path = state_folder() / name
    if not path.exists():
        make_key(path)
    return read_key(path), path


def fingerprint(payload: bytes) -> str:
    """Return 12 hex digits of SHA-256 of a refused payload, to find it in a network capture."""
    return sha256(payload).hexdigest()[:12]


def asked_digest(payload: bytes) -> bytes:
    """Return SHA-256 of a command's payload, by which an answer says what it answers."""
    return sha256(payload).digest()
