"""The socket in the folder of a running campaign, and how one asks something there.

What serves it is `rig.runner.campaign.control_port`; to ask, one needs neither the loop nor the
compiler.
"""

import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

SOCKET: Final = "control.sock"
"""Its name in a run's folder."""
LONGEST_LINE: Final = 16_384
"""Bytes of a request."""
LONGEST_ANSWER: Final = 1 << 24
"""Bytes; the status of a campaign names all its tests."""
ANSWER_S: Final = 10.0
"""How long a campaign may take to answer."""
_PATIENCE_S: Final = 2.0


class ControlError(ValueError):
    """A request that a campaign did not take.

    Attributes:
        problems: why, one line each.
    """

    def __init__(self, problem: str) -> None:
        self.problems = [problem]
        super().__init__(problem)


class EndlessLineError(ValueError):
    """What was received is no line: it does not end in time, or is too long."""


def ask(
    folder: Path, request: str, text: str = "", test: str = "", wait_s: float = ANSWER_S
) -> dict[str, Any]:
    """Ask something of the campaign that runs in a folder; return its answer.

    The answer has `reply`, a sentence, or `status` (`Desk.status`).

    Args:
        folder: of the run.
        request: what (`rig.runner.campaign.operator_requests.Request`).
        text: of a note; may go with anything else.
        test: name of the test to skip or to retry.
        wait_s: how long an answer is waited for.

    Raises:
        ControlError: no campaign runs there, or it refused, with the reason.
    """
    content = {"request": str(request), "text": text, "test": test}
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as client:
        client.settimeout(wait_s)
        try:
            with address_of(folder) as address:
                client.connect(address)
            # Who refuses hangs up without hearing it all; the answer is there all the same.
            with suppress(BrokenPipeError, ConnectionResetError):
                client.sendall(json.dumps(content).encode() + b"\n")
            line = line_from(client, LONGEST_ANSWER)
        except (OSError, EndlessLineError) as error:
            raise ControlError(f"{folder}: {_why(error)}") from None
    return _answer(folder, line)


def _answer(folder: Path, line: bytes) -> dict[str, Any]:
    try:
        answer = dict(json.loads(line))
        if answer.pop("ok"):
            return answer
        problem = str(answer["problem"])
    except (ValueError, TypeError, KeyError, RecursionError):
        problem = "what serves its socket does not answer as a campaign does"
    raise ControlError(f"{folder}: {problem}")


def _why(error: Exception) -> str:
    if isinstance(error, FileNotFoundError | ConnectionRefusedError | NotADirectoryError):
        return "no campaign is running in it; give the folder of one that is"
    if isinstance(error, PermissionError):
        return "its campaign belongs to another user; ask as that user"
    return f"its campaign does not answer: {error}"


@contextmanager
def address_of(folder: Path) -> Iterator[str]:
    """Give the socket's address; by the folder's descriptor, as no address may exceed 107 bytes.

    Raises:
        OSError: the folder cannot be opened.
    """
    opened = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{opened}/{SOCKET}"
    finally:
        os.close(opened)


def line_from(connection: socket.socket, longest: int = LONGEST_LINE) -> bytes:
    """Return a line, with its end, for which the connection's timeout is waited in all.

    Args:
        connection: to receive it from.
        longest: bytes that are taken.

    Raises:
        EndlessLineError: it does not end in time, or is too long.
        OSError: the connection is lost.
    """
    received = b""
    until = time.monotonic() + (connection.gettimeout() or _PATIENCE_S)
    while not received.endswith(b"\n"):
        try:
            # In all, not for each piece: who sends a byte now and then is no client.
            connection.settimeout(max(until - time.monotonic(), 1e-3))
            piece = connection.recv(LONGEST_LINE)
        except TimeoutError:
            raise EndlessLineError("a line that does not end") from None
        received += piece
        if not piece or len(received) > longest:
            raise EndlessLineError("a line that does not end, or is too long")
    return received
