"""A session asks the station of its rig for it, if there is one."""

import shlex
import socket
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from select import select
from typing import Any, Final

from rig import __version__
from rig.configuration import Rig
from rig.control_socket import LONGEST_ANSWER, address_of, own_name
from rig.io import DriverError, in_use
from rig.supervisor.processes import Errand

from .protocol import END, PROTOCOL, folder_of_station, is_own_folder, received, send

ANSWER_S: Final = 5.0
"""Time in s within which a station answers a question, which it does at once."""
GRANT_S: Final = 60.0
"""Time in s within which a station must have left the rig.

It needs at most 5 s to bring the motion to rest, 20 s for the slow drivers and 10 s for the loop
(`ConnectedRig.leave`), or 3 s to end an attempt to connect; the rest is for a machine that stalls.
"""
_LOOK_S: Final = 0.2
_LONGEST_COMMAND: Final = 120
"""Most characters of a command line that stands for what a session is for."""


@contextmanager
def leased(rig: Rig, errand: Errand, look: Callable[[], None]) -> Iterator[tuple[int, ...]]:
    """Hold the lease of a rig's station in a `with` block, which the station has left then.

    The block is given the descriptor of the lease, or () if the rig has no station. The lease lasts
    until every process that has the descriptor has closed it.

    Args:
        rig: the rig.
        errand: what the rig is wanted for.
        look: is called while the lease is awaited; it may raise an error, which gives it up.

    Raises:
        DriverError: somebody else has the rig, the station could not leave it safe, its program
            has another protocol, or it does not answer.
    """
    connection = None if errand.of_station else _connected(rig, ANSWER_S)
    if connection is None:
        yield ()
        return
    with connection:
        asked = {
            "request": "lease",
            "rig": rig.name,
            "what": errand.what or _command_line(),
            "by": errand.by or own_name(),
        }
        _require_granted(rig, _answer(rig, connection, asked, GRANT_S, look))
        yield (connection.fileno(),)
        with suppress(OSError):
            connection.sendall(END)


def word_of_station(rig: Rig) -> dict[str, Any] | None:
    """Return what the station of a rig tells of itself (`Keeper.status`); None if there is none.

    Raises:
        DriverError: the station does not answer, or its program has another protocol.
    """
    connection = _connected(rig, ANSWER_S)
    if connection is None:
        return None
    with connection:
        answer = _answer(rig, connection, {"request": "status"}, ANSWER_S, lambda: None)
    _require_granted(rig, answer)
    status = answer.get("status")
    return status if isinstance(status, dict) else {}


def tell_station(rig: Rig, ended: Mapping[str, Any]) -> None:
    """Tell the station of a rig, if there is one, how what this process did with the rig has ended.

    Nothing depends on it: a station that does not take it is not asked again.

    Args:
        rig: the rig.
        ended: what is told, as `ending` in rig/supervisor/leases/protocol.py describes it.
    """
    with suppress(DriverError):
        connection = _connected(rig, ANSWER_S)
        if connection is not None:
            with connection:
                _answer(rig, connection, {"request": "ended", **ended}, ANSWER_S, lambda: None)


def why_busy(rig: Rig) -> str:
    """Return why a rig cannot be used now, in a sentence; "" if it can.

    A rig that its station only reads can be used. Nothing is locked: what is free now may be in use
    a moment later.
    """
    try:
        status = word_of_station(rig)
    except DriverError as error:
        return str(error)
    if status is None or status.get("state") == "no devices":
        # A station that has no devices has no lock either: who has one is somebody else.
        return in_use(rig.drivers)
    return str(status.get("text")) if status.get("state") == "driven" else ""


def _connected(rig: Rig, wait_s: float) -> socket.socket | None:
    """Return a connection to the station of a rig; None if nobody of this user serves one."""
    folder = folder_of_station(rig)
    if not is_own_folder(folder):
        return None
    client = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    client.settimeout(wait_s)
    try:
        with address_of(folder) as address:
            client.connect(address)
    except OSError:
        # A station that was killed has left its socket, at which nobody listens.
        client.close()
        return None
    return client


def _answer(
    rig: Rig,
    connection: socket.socket,
    request: dict[str, Any],
    wait_s: float,
    look: Callable[[], None],
) -> dict[str, Any]:
    until = time.monotonic() + wait_s
    try:
        send(connection, request)
        while not select([connection], [], [], _LOOK_S)[0]:
            look()
            if time.monotonic() > until:
                raise ValueError(f"no answer within {wait_s:g} s")
        return received(connection, LONGEST_ANSWER)
    except (OSError, ValueError) as error:
        state = f"its station does not answer: {error}"
        raise DriverError(rig.name, state, "end the station, or ask again") from None


def _require_granted(rig: Rig, answer: dict[str, Any]) -> None:
    if answer.get("protocol") != PROTOCOL:
        state = (
            f"its station is version {answer.get('version')} with protocol "
            f"{answer.get('protocol')}, this program is version {__version__} with protocol "
            f"{PROTOCOL}"
        )
        raise DriverError(rig.name, state, "restart the station with this version")
    if answer.get("ok") is not True:
        remedy = str(answer.get("remedy") or "ask again later")
        raise DriverError(rig.name, str(answer.get("problem")), remedy)


def _command_line() -> str:
    """Return the command line of this process, cut after `_LONGEST_COMMAND` characters."""
    words = ["rig" if sys.argv[0].endswith("__main__.py") else sys.argv[0], *sys.argv[1:]]
    return shlex.join(words)[:_LONGEST_COMMAND]
