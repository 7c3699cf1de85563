"""The keeper of a station's leases answers, at its socket, who asks for the rig."""

import os
import selectors
import socket
import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field
from datetime import UTC, datetime
from typing import Any, Final

from rig import __version__
from rig.configuration import Rig
from rig.control_socket import LONGEST_LINE, address_of
from rig.io import DriverError, LockedError, locked
from rig.surviving import Surviving, start

from .protocol import (
    LONGEST_WORD,
    PROTOCOL,
    ending,
    folder_of_station,
    is_own_folder,
    name_of_station,
    other_end,
    received,
    send,
)

REQUEST_S: Final = 2.0
"""Time in s within which a client must have sent its request, which it does at once."""
POLL_S: Final = 0.2
"""Period in s at which the thread looks whether it is to end."""
LONGEST_TEXT: Final = 200
"""Most characters of what a client says that it does, and of its name."""


@dataclass(eq=False)
class Lease:
    """A client that has asked for the rig, from then until its connection is closed.

    Attributes:
        what: what it does with the rig.
        by: who asked for it.
        pid: its process.
        since: when it asked, UTC.
        connection: the connection, which all its processes share.
        granted: whether the station has left the rig to it.
        said_end: whether it has said that it has done.
        told: what it has said of how that ended (`ending` in rig/supervisor/leases/protocol.py),
            until somebody takes it; None before.
    """

    what: str
    by: str
    pid: int
    since: datetime
    connection: socket.socket = field(repr=False)
    granted: bool = False
    said_end: bool = False
    told: Mapping[str, Any] | None = None

    @property
    def sentence(self) -> str:
        """Who drives the rig, since when and what for; also that the process has ended already."""
        said = f"{self.what}, asked by {self.by}, has the rig since {self.since:%H:%M:%S} UTC"
        if _lives(self.pid):
            return f"{said} (process {self.pid})"
        return f"{said}; its process {self.pid} has ended, and its other parts make the rig safe"


class Keeper:
    """Keeps the leases of a rig's station, and serves its socket, as a context manager.

    One client has the rig at a time. The station learns by `changed` that somebody asks or has
    done, leaves the rig, and then calls `grant` or `refuse`.

    Args:
        rig: the rig.
        survives: suppresses and reports errors of the thread that serves the socket.

    Attributes:
        changed: is set whenever somebody has asked for the rig or left it; who waits clears it.
        heard: is called, from the thread that serves the socket, when somebody has told how it
            ended what he did with the rig.
    """

    def __init__(self, rig: Rig, survives: Surviving) -> None:
        self._rig = rig
        self._survives = survives
        self._since = datetime.now(UTC)
        self._lease: Lease | None = None
        self._granted: Lease | None = None
        """The lease that was granted last; who had it may still say how that ended."""
        self._state, self._text = "no devices", "the station starts"
        self._lock = threading.Lock()
        self._closing = threading.Event()
        self._ends = ExitStack()
        self._selector = selectors.DefaultSelector()
        self._thread = threading.Thread(target=self._serve, name="leases", daemon=True)
        self.changed = threading.Event()
        self.heard: Callable[[], None] = lambda: None

    def __enter__(self) -> "Keeper":
        """Lock the rig's station and open its socket.

        Raises:
            DriverError: another program is the rig's station, or the socket cannot be opened.
        """
        with self._ends:
            try:
                self._ends.enter_context(locked(name_of_station(self._rig)))
                self._listener = self._ends.enter_context(self._opened())
                self._ends.callback(self._selector.close)
                self._selector.register(self._listener, selectors.EVENT_READ)
                start(self._thread)
            except LockedError as error:
                state = f"its station is the process {error.owner} already"
                raise DriverError(self._rig.name, state, "use that one, or end it") from None
            except OSError as error:
                state = f"the station's socket cannot be opened: {error}"
                remedy = f"look at {folder_of_station(self._rig)}"
                raise DriverError(self._rig.name, state, remedy) from None
            self._ends = self._ends.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        """Close the socket; a client that drives the rig goes on."""
        self._closing.set()
        self._thread.join()
        if self._lease is not None:
            self._lease.connection.close()
        with suppress(OSError), address_of(folder_of_station(self._rig)) as address:
            os.unlink(address)
        self._ends.close()

    @property
    def asked(self) -> Lease | None:
        """The lease that somebody has asked for, and that was not granted yet; None if none."""
        lease = self._lease
        return lease if lease is not None and not lease.granted else None

    def holds(self, lease: Lease) -> bool:
        """Return whether a lease has not ended yet."""
        return self._lease is lease

    def grant(self, lease: Lease) -> bool:
        """Leave the rig to who has asked for it; return False if that client has gone meanwhile."""
        with self._lock:
            if self._lease is not lease:
                return False
            lease.granted = True
            self._granted = lease
        with suppress(OSError):
            # Who has gone meanwhile is noticed as the connection ends.
            send(lease.connection, {"ok": True})
        return True

    def refuse(self, lease: Lease, problem: str, remedy: str) -> None:
        """Tell who has asked for the rig why it is not lent, and end that lease."""
        with self._lock:
            if self._lease is not lease or lease.granted:
                return
            self._lease = None
        with suppress(KeyError, ValueError):
            self._selector.unregister(lease.connection)
        _refuse(lease.connection, problem, remedy)
        lease.connection.close()
        self.changed.set()

    def stands(self, state: str, text: str) -> None:
        """Set what `status` tells while nobody drives: "idle" or "no devices", and a sentence."""
        self._state, self._text = state, text

    @property
    def status(self) -> dict[str, Any]:
        """What the station tells of itself: JSON values by name.

        `state` is "idle" (the station reads, nothing drives), "driven" (a client has the rig, or
        waits until the station has left it) or "no devices" (they do not answer, or are in use);
        `text` says it in a sentence. `rig`, `pid`, `since` and `version` are of the station;
        `devices` are the names of the drivers; `driver` is None, or has `what`, `by`, `pid` and
        `since`.
        """
        lease = self._lease
        content: dict[str, Any] = {
            "rig": self._rig.name,
            "pid": os.getpid(),
            "version": __version__,
            "since": self._since.isoformat(timespec="seconds"),
            "state": self._state,
            "text": self._text,
            "devices": [spec.name for spec in self._rig.drivers],
            "driver": None,
        }
        if lease is not None:
            since = lease.since.isoformat(timespec="seconds")
            driver = {"what": lease.what, "by": lease.by, "pid": lease.pid, "since": since}
            content |= {"state": "driven", "text": lease.sentence, "driver": driver}
        return content

    def _opened(self) -> socket.socket:
        """Return the socket, listening in a folder that only this user can enter.

        Raises:
            OSError: the folder cannot be made, or belongs to another user.
        """
        folder = folder_of_station(self._rig)
        folder.parent.mkdir(mode=0o700, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        if not is_own_folder(folder):
            raise PermissionError(f"{folder} belongs to another user")
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            with address_of(folder) as address:
                # This process has the station's lock, so that nobody listens at a socket left here.
                with suppress(FileNotFoundError):
                    os.unlink(address)
                listener.bind(address)
            listener.listen()
        except BaseException:
            listener.close()
            raise
        return listener

    def _serve(self) -> None:
        while not self._closing.is_set():
            with self._survives:
                for key, _ in self._selector.select(POLL_S):
                    if key.fileobj is self._listener:
                        self._take(self._listener.accept()[0])
                    else:
                        self._hear(key.data)

    def _take(self, connection: socket.socket) -> None:
        """Read the request of a new connection; answer and close it unless it asks for the rig."""
        keeps = False
        try:
            connection.settimeout(REQUEST_S)
            pid, uid = other_end(connection)
            if uid not in (os.getuid(), 0):
                return
            keeps = self._answered(connection, received(connection, LONGEST_WORD), pid)
        except (OSError, ValueError):
            # Who says nothing that can be read gets no answer.
            return
        finally:
            if not keeps:
                connection.close()

    def _answered(self, connection: socket.socket, request: dict[str, Any], pid: int) -> bool:
        """Answer a request; return whether the connection is kept, as that of a lease."""
        if request.get("protocol") != PROTOCOL:
            problem = (
                f"its station is version {__version__} with protocol {PROTOCOL}, the program that "
                f"asks is version {request.get('version')} with {request.get('protocol')}"
            )
            _refuse(connection, problem, "use the same version for both")
        elif request.get("request") == "status":
            send(connection, {"ok": True, "status": self.status})
        elif request.get("request") == "ended":
            self._told(connection, request, pid)
        elif request.get("request") != "lease":
            problem = f"its station knows no request {str(request.get('request'))[:LONGEST_TEXT]}"
            _refuse(connection, problem, "ask for a lease or the status")
        else:
            return self._asks(connection, request, pid)
        return False

    def _asks(self, connection: socket.socket, request: dict[str, Any], pid: int) -> bool:
        what, by = (_line(request.get(key)) for key in ("what", "by"))
        lease = Lease(what, by, pid, datetime.now(UTC), connection)
        with self._lock:
            before = self._lease
            if before is None:
                self._lease = lease
        if before is not None:
            _refuse(connection, before.sentence, "wait for its end, or stop it")
            return False
        self._selector.register(connection, selectors.EVENT_READ, lease)
        self.changed.set()
        return True

    def _told(self, connection: socket.socket, request: dict[str, Any], pid: int) -> None:
        """Take how what drove the rig last has ended, from the process that did."""
        lease, said = self._granted, ending(request)
        if said is None or lease is None or lease.pid != pid:
            _refuse(connection, "nothing of this process has driven the rig last", "say nothing")
            return
        lease.told = said
        send(connection, {"ok": True})
        self.heard()

    def _hear(self, lease: Lease) -> None:
        """Take what the connection of a lease says, which is that it has done, or has ended."""
        try:
            said = lease.connection.recv(LONGEST_LINE)
        except OSError:
            said = b""
        if said:
            lease.said_end = True
            return
        with suppress(KeyError, ValueError):
            self._selector.unregister(lease.connection)
        lease.connection.close()
        with self._lock:
            if self._lease is lease:
                self._lease = None
        self.changed.set()


def _refuse(connection: socket.socket, problem: str, remedy: str) -> None:
    with suppress(OSError):
        send(connection, {"ok": False, "problem": problem, "remedy": remedy})


def _line(text: object) -> str:
    """Return a client's text on one line, at most `LONGEST_TEXT` long; "unknown" if it is empty."""
    shown = "".join(letter for letter in str(text or "") if letter.isprintable())
    return shown[:LONGEST_TEXT].strip() or "unknown"


def _lives(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    except OSError:
        return True
    return True
