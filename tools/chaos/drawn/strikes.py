"""Steps of the grammar that the scenarios do not have: pauses, other masters, forged streams."""

import shutil
import signal
import socket
import struct
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final

import yaml
import zenoh

from rig.configuration import load_stream
from rig.stream.messages import key, pack
from rig.stream.sessions import subscriber_session
from tools.chaos.scenario import Step
from tools.chaos.stage import Stage

_WRITE: Final = 16
"""Modbus function "write multiple registers" (Modbus Application Protocol V1.1b3, 6.12)."""
_LOOP_REGISTERS, _CLAIM, _NULL = 0, 640, 768
"""Addresses of the I/O node (docs/io_node.md): what the loop writes, ownership, null request."""
_FULL_EXTENSION: Final = struct.unpack(">4H", struct.pack(">HHf", 1, 1, 10.0))
"""Registers 0 to 3: a counter, the valve's enable, and a command of 10 V."""
_FORGERIES: Final = 20
_ANSWER_S: Final = 0.3
"""How long another master waits for a connection or an answer, s."""
_HEADER: Final = struct.Struct(">HHHBB")
"""Begin of an answer: transaction, protocol, bytes that follow, unit (Modbus/TCP guide V1.0b), and
the function, to which 128 is added in an exception."""
_DEVICE_FAILURE: Final = 4
"""Code of the exception by which a node whose wire fails as `exception` refuses every request."""


class NotTakenError(Exception):
    """Raised by a step whose request the node cannot have taken, so that nothing was struck."""


def pause(part: str, seconds: float) -> Step:
    """Return a step that stops the process of a part for a time, s."""

    def step(stage: Stage) -> None:
        stage.send(signal.SIGSTOP, part)
        time.sleep(seconds)
        stage.send(signal.SIGCONT, part)

    return step


def foreign_write(stage: Stage) -> None:
    """Command full extension of the I/O node as a master that does not own it."""
    _write(stage, _LOOP_REGISTERS, _FULL_EXTENSION)


def foreign_claim(stage: Stage) -> None:
    """Claim the I/O node by a key, which is another one than the owner's (1 in 32767 cases)."""
    _write(stage, _CLAIM, (0x1234,))


def null_request(stage: Stage) -> None:
    """Ask the I/O node for null, which anybody may."""
    _write(stage, _NULL, (1,))


def no_modbus(stage: Stage) -> None:
    """Send the I/O node what is no Modbus, on a connection of its own."""
    stage.injected_ns = time.monotonic_ns()
    with suppress(OSError), _connection(stage) as line:
        line.sendall(b"GET / HTTP/1.1\r\nHost: rig\r\n\r\n")


def remove_folder(stage: Stage) -> None:
    """Remove the run's folder with all that is in it."""
    stage.injected_ns = time.monotonic_ns()
    shutil.rmtree(stage.out, ignore_errors=True)


def forge_stream(stage: Stage) -> None:
    """Say on the live stream, without the rig's key, that the campaign has ended."""
    stage.injected_ns = time.monotonic_ns()
    content = {
        "version": 1, "session": "forged", "sequence": 0, "sent_ns": time.time_ns(),
        "status": "ended", "name": "forged", "tests": [],
    }  # fmt: skip
    with subscriber_session(load_stream(stage.stream)) as session:
        _publish(session, pack(content))


def _publish(session: zenoh.Session, payload: bytes) -> None:
    for _ in range(_FORGERIES):
        session.put(key("emulated", "campaign"), payload)
        time.sleep(0.01)


def _connection(stage: Stage) -> socket.socket:
    return socket.create_connection(("127.0.0.1", _port(stage.folder)), timeout=_ANSWER_S)


def _port(folder: Path) -> int:
    rig = yaml.safe_load((folder / "rig.yaml").read_text())
    return int(rig["drivers"]["daq"]["port"])


def _write(stage: Stage, address: int, words: Sequence[int]) -> None:
    """Write holding registers of the I/O node.

    A refusal because the node has another owner is what is wanted of it. If the other fault lets no
    answer through, the node may have taken the request all the same.

    Raises:
        NotTakenError: no connection was accepted, or the node refused the request unread; the other
            fault is such a one of the node's wire.
    """
    body = struct.pack(
        f">BBHHB{len(words)}H", 1, _WRITE, address, len(words), 2 * len(words), *words
    )
    try:
        with _connection(stage) as line:
            stage.injected_ns = time.monotonic_ns()
            line.sendall(struct.pack(">HHH", 1, 0, len(body)) + body)
            answer = line.recv(260)
    except TimeoutError:
        return
    except OSError as error:
        raise NotTakenError(str(error)) from None
    if not answer or was_refused_unread(answer):
        raise NotTakenError("the node refused the request, or closed the connection")


def was_refused_unread(answer: bytes) -> bool:
    """Return whether an answer of the I/O node to `_write` says that the node itself fails."""
    refusal = _HEADER.pack(1, 0, 3, 1, 128 + _WRITE) + bytes([_DEVICE_FAILURE])
    return answer == refusal
