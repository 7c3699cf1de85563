"""Serves the control port of a running campaign: a Unix socket in the run's folder.

A request is one line of JSON, and so is its answer. The kernel says which user has connected: only
the user who runs the campaign, and root, may make requests. Oversized, slow or malformed requests
are refused, too. The campaign never waits for a request, and no client for another one. A failure
ends one request only: the next one is served.
"""

import json
import os
import socket
import struct
import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from rig.control_socket import SOCKET, EndlessLineError, address_of, line_from, name_of
from rig.surviving import Surviving, failure, start
from rig.unique_keys import RepeatedKeyError, unique_keys

from .operator_requests import Desk, RefusedError, Request

PATIENCE_S: Final = 2.0
"""How long a client may take for its request, and to take its answer, s."""
MOST_CLIENTS: Final = 32
"""How many clients are served at a time, each by a thread of its own. It is more than the operators
and pages of one rig, so that a further one finds them all silent: the oldest is then refused."""

_QUEUE: Final = 128
"""How many connections may wait to be accepted; the kernel refuses further ones at once."""
_AGAIN_S: Final = 0.1
"""Pause after a connection could not be accepted, as without a free file descriptor, s."""
_ROOT: Final = 0
_PEER: Final = struct.Struct("3i")
_KEYS: Final = frozenset({"request", "text", "test", "person"})


class ControlPort:
    """Passes requests that come by the socket in a run's folder to a desk.

    It is a context manager: requests are served while it is entered, by a thread of its own.

    Args:
        folder: folder of the run.
        desk: takes the requests.
        refused: is called with one line that says why, when a request is refused or fails, or when
            the socket cannot be made, so that no request is served.
    """

    def __init__(self, folder: Path, desk: Desk, refused: Callable[[str], None]) -> None:
        self._folder = folder
        self._desk = desk
        self._refused = refused
        self._survives = Surviving("the control port", refused)
        self._ending = threading.Event()
        self._lock = threading.Lock()
        # The connections that are served now, with the thread of each, the oldest first.
        self._clients: dict[socket.socket, threading.Thread] = {}
        self._listener: socket.socket | None = None
        self._thread: threading.Thread | None = None

    def __enter__(self) -> "ControlPort":
        try:
            self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            self._bind(self._listener)
            self._thread = threading.Thread(target=self._serve, name="control", daemon=True)
            start(self._thread)
        except OSError as error:
            # The campaign also runs on a file system that has no sockets.
            self._refused(f"there is no control port: {error.strerror}")
        return self

    def _bind(self, listener: socket.socket) -> None:
        # A run that was killed may have left its socket.
        (self._folder / SOCKET).unlink(missing_ok=True)
        before = os.umask(0o177)
        try:
            with address_of(self._folder) as address:
                listener.bind(address)
        finally:
            os.umask(before)
        listener.listen(_QUEUE)

    def __exit__(self, *_: object) -> None:
        self._ending.set()
        # The thread may be blocked in `accept`; shutting the socket down ends that call.
        if self._listener is not None:
            with suppress(OSError):
                self._listener.shutdown(socket.SHUT_RDWR)
            self._listener.close()
        if self._thread is not None and self._thread.ident is not None:
            self._thread.join(PATIENCE_S)
        # Who was answered with what is done now still gets that answer.
        until = time.monotonic() + PATIENCE_S
        for thread in self._hear_no_more(most=0):
            thread.join(max(until - time.monotonic(), 0.0))
        # The folder may be gone, or a file may be in its place.
        with suppress(OSError):
            (self._folder / SOCKET).unlink(missing_ok=True)

    def _serve(self) -> None:
        """Serve each client by a thread of its own until the port is closed."""
        while not self._ending.is_set():
            with self._survives:
                assert self._listener is not None
                try:
                    client, _ = self._listener.accept()
                except OSError:
                    if self._ending.wait(_AGAIN_S):
                        return
                    raise
                self._hear_no_more(most=MOST_CLIENTS - 1)
                thread = threading.Thread(
                    target=self._serve_client, args=(client,), name="control", daemon=True
                )
                with self._lock:
                    self._clients[client] = thread
                try:
                    thread.start()
                except RuntimeError:  # no thread is to be had: others wait for this client instead
                    self._serve_client(client)

    def _hear_no_more(self, most: int) -> list[threading.Thread]:
        """Hear no more of the oldest clients, so that `most` are left; return their threads.

        One that has not ended its request is refused at once; the others get their answers.
        """
        with self._lock:
            oldest = list(self._clients)[: max(len(self._clients) - most, 0)]
            for client in oldest:
                with suppress(OSError):
                    client.shutdown(socket.SHUT_RD)
            threads = [self._clients.pop(client) for client in oldest]
        return [thread for thread in threads if thread.ident is not None]

    def _serve_client(self, client: socket.socket) -> None:
        """Answer one client's request, and close the connection."""
        with self._survives, suppress(OSError):
            client.settimeout(PATIENCE_S)
            client.sendall(json.dumps(self._answer(client)).encode() + b"\n")
        with self._lock:
            self._clients.pop(client, None)
        client.close()

    def _answer(self, client: socket.socket) -> dict[str, Any]:
        """Read a client's request, carry it out, and return the answer; report a refusal."""
        try:
            return {"ok": True, **self._obeyed(client)}
        except (RefusedError, EndlessLineError) as error:
            why = str(error)
        except Exception as error:  # any failure is answered, and the next request is served
            why = f"it failed: {failure(error)}"
        with self._survives:
            self._refused(why.replace("\n", "; "))
        return {"ok": False, "problem": why}

    def _obeyed(self, client: socket.socket) -> dict[str, Any]:
        peer = client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _PEER.size)
        _, uid, _ = _PEER.unpack(peer)
        if uid not in (os.getuid(), _ROOT):
            raise RefusedError(f"user {name_of(uid)} may not control this campaign")
        request, text, test, person = _parsed(line_from(client))
        if request is Request.STATUS:
            return {"status": self._desk.status()}
        return {"reply": self._desk.ask(request, name_of(uid), text, test, person)}


def _parsed(line: bytes) -> tuple[Request, str, str, str]:
    """Return the request in a line of JSON, its text, its test's name, and who made it.

    Each of the last three is empty if the request does not give it.

    Raises:
        RefusedError: the line is no valid request; the message says why.
    """
    try:
        content = json.loads(line.decode(), object_pairs_hook=unique_keys)
    except UnicodeDecodeError:
        raise RefusedError("a malformed request: is no UTF-8") from None
    except RepeatedKeyError as error:
        raise RefusedError(f"a malformed request: {error}") from None
    except (ValueError, RecursionError):
        raise RefusedError("a malformed request: is no JSON") from None
    if not isinstance(content, dict) or not content.keys() <= _KEYS:
        raise RefusedError("a malformed request: has not the keys of one")
    if not all(isinstance(value, str) for value in content.values()):
        raise RefusedError("a malformed request: has a value that is no text")
    try:
        text, test, person = (content.get(key, "") for key in ("text", "test", "person"))
        return Request(content["request"]), text, test, person
    except (ValueError, KeyError):
        raise RefusedError("a malformed request: asks for nothing that there is") from None
