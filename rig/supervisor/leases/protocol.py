"""Where the socket of a rig's station is, and the lines that are sent over it.

Each line is a JSON object, in UTF-8. The first line of a client has the keys `protocol`, `version`
and `request` ("lease", "status" or "ended"), and with a lease also `rig`, `what`, `by` and `pid`.
The station answers with one line: `protocol`, `version` and `ok`; if `ok` is false, `problem` says
why; with a status, `status` holds it. A client that has done sends `END`, and closes the
connection; by another one, with "ended", it says how that was (`ending`).
"""

import hashlib
import json
import os
import socket
import struct
import tempfile
from collections.abc import Mapping
from pathlib import Path
from stat import S_ISDIR
from typing import Any, Final

from rig import __version__
from rig.configuration import Rig
from rig.control_socket import line_from
from rig.io import connection_of
from rig.unique_keys import unique_keys

PROTOCOL: Final = 1
"""Number of the protocol; programs with different numbers do not talk to each other."""
END: Final = b'{"end": true}\n'
"""What a client sends when it has left the rig safe, before it closes the connection."""
LONGEST_WORD: Final = 1 << 20
"""Most bytes of a client's request: as many as of a message of the live stream, which lists a
campaign's tests too."""
_PEER: Final = "3i"
"""Layout of the kernel's `struct ucred`: process, user and group of the other end (unix(7))."""


def name_of_station(rig: Rig) -> str:
    """Return the name by which the station of a rig is known on this machine.

    It is that of the rig's fast device, so that two rig files with the same one share a station.
    """
    fast = next((spec for spec in rig.drivers if spec.kind == "fast"), None)
    connection = None if fast is None else connection_of(fast.options)
    return f"station of {connection or rig.name}"


def folder_of_station(rig: Rig) -> Path:
    """Return the folder in which the station of a rig, of this user, has its socket."""
    digest = hashlib.sha256(name_of_station(rig).encode()).hexdigest()[:16]
    return Path(tempfile.gettempdir()) / f"rig-stations-{os.getuid()}" / digest


def is_own_folder(folder: Path) -> bool:
    """Return whether a folder is there and belongs to this user, as does the one it is in."""
    for path in (folder.parent, folder):
        try:
            found = path.lstat()
        except OSError:
            return False
        if not S_ISDIR(found.st_mode) or found.st_uid != os.getuid():
            return False
    return True


def send(connection: socket.socket, content: Mapping[str, Any]) -> None:
    """Send a line with a content, the protocol's number and this program's version.

    Raises:
        OSError: the connection is lost.
    """
    line = {"protocol": PROTOCOL, "version": __version__, **content}
    connection.sendall(json.dumps(line).encode() + b"\n")


def received(connection: socket.socket, longest: int) -> dict[str, Any]:
    """Receive a line and return its object.

    Raises:
        ValueError: the line does not end in time, is longer than `longest` bytes, is no object,
            or has a key twice.
        OSError: the connection is lost.
    """
    found = json.loads(line_from(connection, longest), object_pairs_hook=unique_keys)
    if not isinstance(found, dict):
        raise ValueError("the line is no object")
    return found


def ending(request: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return what a request "ended" says; None if that is not what it should be.

    It has `campaign` and `decision`, the contents of the last messages of these kinds on the live
    stream (docs/stream.md), `trips` as in its message `health`, and `folder`, the path of the run.
    """
    said = {name: request.get(name) for name in ("campaign", "decision", "trips")}
    folder = request.get("folder")
    if not all(isinstance(value, dict) for value in said.values()) or not isinstance(folder, str):
        return None
    return {**said, "folder": folder}


def other_end(connection: socket.socket) -> tuple[int, int]:
    """Return process id and user id of the other end of a connection.

    Raises:
        OSError: the kernel does not tell.
    """
    size = struct.calcsize(_PEER)
    pid, uid, _ = struct.unpack(
        _PEER, connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, size)
    )
    return pid, uid
