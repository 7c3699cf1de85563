"""The control port of a running campaign: a Unix socket in the run's folder, for this user alone.

A request is one line of JSON, and so is its answer. Whoever connects is known by the kernel's word;
a stranger, an oversized, slow or malformed request is refused, and never waited for by the
campaign.
"""

import json
import os
import pwd
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

from .desk import Desk, RefusedError, Request

SOCKET: Final = "control.sock"
"""Its name in a run's folder."""
LONGEST_REQUEST: Final = 16_384
"""Bytes."""
PATIENCE_S: Final = 2.0
"""How long a client may take for its request; others wait meanwhile, the campaign does not."""
ANSWER_S: Final = 10.0
"""How long a campaign may take to answer."""

_ROOT: Final = 0
_PEER: Final = struct.Struct("3i")
_KEYS: Final = frozenset({"request", "text", "test"})


class ControlError(ValueError):
    """A request that a campaign did not take.

    Attributes:
        problems: why, one line each.
    """

    def __init__(self, problem: str) -> None:
        self.problems = [problem]
        super().__init__(problem)


class ControlPort:
    """Serves a desk on the socket of a run's folder; a context manager.

    Args:
        folder: of the run.
        desk: takes the requests.
        refused: is told of what was refused, and why.
    """

    def __init__(self, folder: Path, desk: Desk, refused: Callable[[str], None]) -> None:
        self._folder = folder
        self._desk = desk
        self._refused = refused
        self._thread = threading.Thread(target=self._serve, name="control", daemon=True)

    def __enter__(self) -> "ControlPort":
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            self._bind()
        except OSError as error:
            # A file system without sockets is no reason not to run.
            self._refused(f"there is no control port: {error.strerror}")
            return self
        self._thread.start()
        return self

    def _bind(self) -> None:
        # Whatever a run that was killed has left.
        (self._folder / SOCKET).unlink(missing_ok=True)
        before = os.umask(0o177)
        try:
            with _address(self._folder) as address:
                self._listener.bind(address)
        finally:
            os.umask(before)
        self._listener.listen(8)

    def __exit__(self, *_: object) -> None:
        # Shutting it down ends the accept that the thread is in.
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        if self._thread.ident is not None:
            self._thread.join(PATIENCE_S)
        (self._folder / SOCKET).unlink(missing_ok=True)

    def _serve(self) -> None:
        while True:
            try:
                client, _ = self._listener.accept()
            except OSError:
                return
            with client, suppress(OSError):
                client.settimeout(PATIENCE_S)
                answer = self._answer(client)
                client.sendall(json.dumps(answer).encode() + b"\n")

    def _answer(self, client: socket.socket) -> dict[str, Any]:
        try:
            return {"ok": True, **self._obeyed(client)}
        except RefusedError as error:
            self._refused(str(error))
            return {"ok": False, "problem": str(error)}

    def _obeyed(self, client: socket.socket) -> dict[str, Any]:
        peer = client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
        _, uid, _ = _PEER.unpack(peer)
        if uid not in (os.getuid(), _ROOT):
            raise RefusedError(f"user {_name_of(uid)} may not control this campaign")
        request = _parsed(_line(client))
        if request["request"] is Request.STATUS:
            return {"status": self._desk.status()}
        text, test = request.get("text", ""), request.get("test", "")
        return {"reply": self._desk.ask(request["request"], _name_of(uid), text, test)}


def ask(folder: Path, request: Request, text: str = "", test: str = "") -> dict[str, Any]:
    """Ask something of the campaign that runs in a folder; return its answer.

    The answer has `reply`, a sentence, or `status` (`Desk.status`).

    Raises:
        ControlError: no campaign runs there, or it refused, with the reason.
    """
    content = {"request": str(request), "text": text, "test": test}
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(ANSWER_S)
        try:
            with _address(folder) as address:
                client.connect(address)
            # Who refuses hangs up without hearing it all; the answer is there all the same.
            with suppress(BrokenPipeError, ConnectionResetError):
                client.sendall(json.dumps(content).encode() + b"\n")
            line = _line(client)
        except (OSError, RefusedError) as error:
            raise ControlError(f"{folder}: {_why(error)}") from None
    answer: dict[str, Any] = json.loads(line)
    if not answer.pop("ok"):
        raise ControlError(f"{folder}: {answer['problem']}")
    return answer


def _why(error: Exception) -> str:
    if isinstance(error, FileNotFoundError | ConnectionRefusedError | NotADirectoryError):
        return "no campaign is running in it; give the folder of one that is"
    if isinstance(error, PermissionError):
        return "its campaign belongs to another user; ask as that user"
    return f"its campaign does not answer: {error}"


@contextmanager
def _address(folder: Path) -> Iterator[str]:
    """Give the socket's address; by the folder's descriptor, as no address may exceed 107 bytes."""
    opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{opened}/{SOCKET}"
    finally:
        os.close(opened)


def _line(connection: socket.socket) -> bytes:
    received = b""
    until = time.monotonic() + (connection.gettimeout() or PATIENCE_S)
    while not received.endswith(b"\n"):
        try:
            # In all, not for each piece: who sends a byte now and then is no client.
            connection.settimeout(max(until - time.monotonic(), 1e-3))
            piece = connection.recv(LONGEST_REQUEST)
        except TimeoutError:
            raise RefusedError("a request that does not end") from None
        received += piece
        if not piece or len(received) > LONGEST_REQUEST:
            raise RefusedError("a request that does not end, or is too long")
    return received


def _parsed(line: bytes) -> dict[str, Any]:
    try:
        content = json.loads(line)
        if not isinstance(content, dict) or not content.keys() <= _KEYS:
            raise ValueError
        if not all(isinstance(value, str) for value in content.values()):
            raise ValueError
        return content | {"request": Request(content["request"])}
    except (ValueError, KeyError, RecursionError):
        raise RefusedError("a malformed request") from None


def _name_of(uid: int) -> str:
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)
