"""Locks that let one program at a time use a device; a lock ends with its process."""

import fcntl
import hashlib
import os
import pwd
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

from .driver import DriverError
from .registry import DriverSpec

OF_ANOTHER_USER: Final = " of the user "
"""Stands between the process id and the user's name of who has a lock."""


def connection_of(options: Any) -> str | None:
    """Return the name by which the device of a driver's options is locked; None if there is none.

    The name is `host:port`, a serial port, or a node with its CAN bus. A node is named by its id,
    or by the DBC file that describes its frames; CAN options without either name no device.
    """
    if getattr(options, "channel", ""):
        return _node_of(options)
    host, port = getattr(options, "host", ""), getattr(options, "port", "")
    if host:
        return f"{host}:{port}"
    serial = port if isinstance(port, str) else getattr(options, "device", "")
    return str(serial) or None


def _node_of(options: Any) -> str | None:
    if hasattr(options, "node"):
        node = f"node {options.node}"
    elif hasattr(options, "dbc"):
        node = Path(options.dbc).stem
    else:
        return None
    emulated = getattr(options, "interface", "") == "udp_multicast"
    bus = f"{options.channel}:{options.port}" if emulated else options.channel
    return f"{node} on {bus}"


@contextmanager
def exclusive(drivers: Iterable[DriverSpec]) -> Iterator[None]:
    """Lock the devices of drivers, in a `with` block, against other programs that use this lock.

    Several programs may share a CAN bus, so that its nodes are locked and not the bus: setting up a
    node anew would stop it for the program that drives it.

    Raises:
        DriverError: another program on this machine has locked one of the devices, or two of the
            drivers name the same device; the message names the process, or the other driver. Or a
            lock cannot be opened.
    """
    first: dict[str, str] = {}
    with ExitStack() as locks:
        for spec in drivers:
            connection = connection_of(spec.options)
            if connection is None:
                continue
            if connection in first:
                other = first[connection]
                state = f"{connection} is the device of the driver {other} of this rig too"
                raise DriverError(spec.name, state, "give each of the two drivers its own device")
            first[connection] = spec.name
            locks.enter_context(_lock(spec.name, connection))
        yield


def in_use(drivers: Iterable[DriverSpec]) -> str:
    """Return which device of drivers another program uses, in a sentence; "" if none is in use.

    Nothing is locked: what is free now may be in use a moment later.
    """
    for spec in drivers:
        connection = connection_of(spec.options)
        owner = "" if connection is None else _owner_of(connection)
        if owner:
            return f"{spec.name}: {connection} is in use by the process {owner}"
    return ""


def _owner_of(name: str) -> str:
    """Return who has the lock of a name (`LockedError.owner`); "" if nobody has it."""
    try:
        fd = os.open(_lock_file(name), os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
    except OSError:
        return ""
    try:
        fcntl.flock(fd, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return _owner_in(fd)
    finally:
        os.close(fd)
    return ""


def _owner_in(fd: int) -> str:
    """Return who has a lock (`LockedError.owner`) by what its file says."""
    pid = os.read(fd, 32).decode(errors="replace").strip()
    if not pid.isdecimal():
        return "unknown"
    try:
        uid = os.stat(f"/proc/{pid}").st_uid
    except OSError:
        return pid
    if uid == os.getuid():
        return pid
    try:
        user = pwd.getpwuid(uid).pw_name
    except KeyError:
        user = str(uid)
    return f"{pid}{OF_ANOTHER_USER}{user}"


def _lock_file(name: str) -> Path:
    """Return the file by which a name is locked."""
    digest = hashlib.sha256(name.encode()).hexdigest()[:16]
    return Path(tempfile.gettempdir()) / f"rig-device-{digest}.lock"


@contextmanager
def _lock(driver: str, connection: str) -> Iterator[None]:
    with ExitStack() as lock:
        try:
            lock.enter_context(locked(connection))
        except LockedError as error:
            state = f"{connection} is in use by the process {error.owner}"
            raise DriverError(driver, state, _remedy(error.owner)) from None
        except OSError as error:
            state = f"the lock of {connection} cannot be opened: {error}"
            remedy = f"delete {error.filename} if no program uses the device"
            raise DriverError(driver, state, remedy) from None
        yield


def _remedy(owner: str) -> str:
    """Return what to do about a device that somebody has (`LockedError.owner`)."""
    _, other, user = owner.partition(OF_ANOTHER_USER)
    if not other:
        return "end that run, or wait for its end"
    return (
        f"wait for its end, or ask {user} to end it; if it is a station, it lends the rig to "
        f"commands of {user} only"
    )


class LockedError(Exception):
    """Raised if somebody else has a lock.

    Attributes:
        owner: process id of who has it, and after `OF_ANOTHER_USER` the name of that user, if it
            is not this one; or "unknown".
    """

    def __init__(self, owner: str) -> None:
        self.owner = owner
        super().__init__(f"the process {owner} has the lock")


@contextmanager
def locked(name: str) -> Iterator[None]:
    """Hold the lock of a name, in a `with` block, that one program on this machine may have.

    Raises:
        LockedError: another program, or another block of this one, has the lock.
        OSError: the lock's file cannot be opened; `filename` is its path.
    """
    fd = _opened(_lock_file(name))
    try:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise LockedError(_owner_in(fd)) from None
        os.truncate(fd, 0)
        os.write(fd, str(os.getpid()).encode())
        yield
    finally:
        os.close(fd)


def _opened(path: Path) -> int:
    """Return a descriptor of a lock file that runs of all users share; make it if it is not there.

    It is first opened without O_CREAT, with which Linux refuses another user's file in /tmp.
    """
    flags = os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW
    try:
        return os.open(path, flags)
    except FileNotFoundError:
        fd = os.open(path, flags | os.O_CREAT, 0o666)
        # The umask has taken from the others what they were given.
        os.fchmod(fd, 0o666)
        return fd
