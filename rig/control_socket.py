"""This module sends requests to the socket that a running campaign has in its folder.

`rig.runner.campaign.control_port` serves it. This module imports neither the loop nor the compiler,
so that asking is quick.
"""

import json
import os
import pwd
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

SOCKET: Final = "control.sock"
"""Name of the socket in a run's folder."""
LONGEST_LINE: Final = 16_384
"""Most bytes of a request."""
LONGEST_ANSWER: Final = 1 << 24
"""Most bytes of an answer; it is large as a campaign's status names all its tests."""
ANSWER_S: Final = 10.0
"""Time in s within which a campaign must answer."""
INTERRUPTED_BY: Final = ".interrupted-by"
"""Name of the file in a run's folder that says who interrupts it by SIGINT, until it is read."""
LONGEST_NOTE: Final = 1000
"""Most bytes that are read of that file."""
_PATIENCE_S: Final = 2.0
_AGAIN_S: Final = 0.02


class ControlError(ValueError):
    """The error of a request that a campaign refused, or that no campaign answered.

    Attributes:
        problems: the reasons, as one line each.
    """

    def __init__(self, *problems: str) -> None:
        self.problems = [*problems]
        super().__init__("\n".join(problems))


class EndlessLineError(ValueError):
    """The error of a received line that does not end in time, or is too long."""


def name_of(uid: int) -> str:
    """Return the name of a user of this machine; the number itself if the user has no name."""
    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return str(uid)


def own_name() -> str:
    """Return the name of the user of this process."""
    return name_of(os.getuid())


def remark_of(text: str, person: str) -> str:
    """Return a request's text without the name of who made it, with which the console begins it."""
    if person and text == person:
        return ""
    return text.removeprefix(f"{person}: ") if person else text


def note_interruption(folder: Path, said: str) -> None:
    """Write into a run's folder who is about to interrupt it, and why; do nothing without one."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW | os.O_CLOEXEC
    with suppress(OSError), open(os.open(folder / INTERRUPTED_BY, flags, 0o600), "wb") as file:
        file.write(said.encode(errors="replace")[:LONGEST_NOTE])


def interrupted_by(folder: Path) -> str:
    """Return who interrupts a run, as `note_interruption` has written it, and remove that file.

    It is empty if nobody has, as when the signal comes from a terminal.
    """
    note = folder / INTERRUPTED_BY
    with suppress(OSError):
        with open(os.open(note, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC), "rb") as file:
            said = file.read(LONGEST_NOTE).decode(errors="replace")
        note.unlink(missing_ok=True)
        return "".join(sign if sign.isprintable() else " " for sign in said).strip()
    return ""


def ask(
    folder: Path,
    request: str,
    text: str = "",
    test: str = "",
    wait_s: float = ANSWER_S,
    person: str = "",
) -> dict[str, Any]:
    """Send a request to the campaign that runs in a folder, and return its answer.

    The answer has the key `reply`, a sentence, or `status`, the value of `Desk.status`.

    Args:
        folder: folder of the run.
        request: the request, one of `rig.runner.campaign.operator_requests.Request`.
        text: text of a note; the settings of a request to set the control of the running test, such
            as "gain=80 V/m, integral_time=0.5 s"; a remark on any other request, recorded with it;
            empty for none.
        test: name of the test to skip or to retry; empty for the present one.
        wait_s: time in s for which an answer is awaited.
        person: name of who asks, if this user's programs are used by several people; else empty.

    Raises:
        ControlError: no campaign runs there, it belongs to another user, it does not answer in time
            or as a campaign does, or it refused the request.
    """
    content = {"request": str(request), "text": text, "test": test}
    if person:
        content["person"] = person
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(wait_s)
        try:
            with address_of(folder) as address:
                _connect(client, address, wait_s)
            # A campaign that refuses hangs up before it has read all, but has sent its answer.
            with suppress(BrokenPipeError, ConnectionResetError):
                client.sendall(json.dumps(content).encode() + b"\n")
            line = line_from(client, LONGEST_ANSWER)
        except (OSError, EndlessLineError) as error:
            raise ControlError(f"{folder}: {_why(error)}") from None
    return _answer(folder, line)


def _connect(client: socket.socket, address: str, wait_s: float) -> None:
    """Connect to a campaign's socket; where too many others wait to be accepted, wait with them.

    Raises:
        OSError: nobody listens at the address, or those who wait are still too many after `wait_s`.
    """
    until = time.monotonic() + wait_s
    while True:
        try:
            return client.connect(address)
        except BlockingIOError:
            if time.monotonic() >= until:
                raise
            time.sleep(_AGAIN_S)


def _answer(folder: Path, line: bytes) -> dict[str, Any]:
    try:
        answer = dict(json.loads(line))
        if answer.pop("ok"):
            return answer
        problem = str(answer["problem"])
    except (ValueError, TypeError, KeyError, RecursionError):
        problem = "what serves its socket does not answer as a campaign does"
    raise ControlError(*(f"{folder}: {line}" for line in problem.splitlines() or [""]))


def _why(error: Exception) -> str:
    if isinstance(error, FileNotFoundError | ConnectionRefusedError | NotADirectoryError):
        return "no campaign is running in it; give the folder of one that is"
    if isinstance(error, PermissionError):
        return "its campaign belongs to another user; ask as that user"
    return f"its campaign does not answer: {error}"


@contextmanager
def address_of(folder: Path) -> Iterator[str]:
    """Give the block the address of the control socket in a folder; the socket need not exist.

    The address is a short path by way of an open descriptor of the folder, as a socket's address
    has at most 107 bytes. It is valid within the block only.

    Raises:
        OSError: the folder cannot be opened.
    """
    opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{opened}/{SOCKET}"
    finally:
        os.close(opened)


def line_from(connection: socket.socket, longest: int = LONGEST_LINE) -> bytes:
    """Receive a line and return it with its newline.

    The connection's timeout, or 2 s if it has none, is the time for the whole line; it is changed
    meanwhile and restored. Bytes that came together with the end of the line are returned too;
    nothing should follow the line, and the caller must refuse what does.

    Args:
        connection: the connection.
        longest: most bytes of the line.

    Raises:
        EndlessLineError: the line does not end in time, or is too long, or the other end closes the
            connection before.
        OSError: the connection is lost.
    """
    received = piece = b""
    timeout_s = connection.gettimeout()
    until = time.monotonic() + (timeout_s or _PATIENCE_S)
    try:
        while b"\n" not in piece:
            # The time limit is for the whole line, so that single bytes do not prolong it.
            if (left := until - time.monotonic()) <= 0.0:
                raise TimeoutError
            connection.settimeout(left)
            piece = connection.recv(LONGEST_LINE)
            received += piece
            if not piece or len(received) > longest:
                raise EndlessLineError("a line that does not end, or is too long")
    except TimeoutError:
        raise EndlessLineError("a line that does not end") from None
    finally:
        connection.settimeout(timeout_s)
    return received
