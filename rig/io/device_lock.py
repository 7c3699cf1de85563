"""One program at a time on a device: a lock that vanishes with the process, however it ends."""

import fcntl
import hashlib
import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from .driver import DriverError
from .registry import DriverSpec


def connection_of(options: Any) -> str | None:
    """Return what only one driver can have: `host:port`, a serial port, or a node of a bus.

    None where the options name no device. The node of a bus is its id, or the DBC of its frames.
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
    """Keep other programs that ask for it on this machine off the drivers' devices.

    A bus is shared by its nature; its nodes are locked, not the bus. Setting up a node anew would
    stop it for the program that drives it.

    Raises:
        DriverError: another program has one of them; names its process.
    """
    with ExitStack() as locks:
        for spec in drivers:
            connection = connection_of(spec.options)
            if connection is not None:
                locks.enter_context(_lock(spec.name, connection))
        yield


@contextmanager
def _lock(driver: str, connection: str) -> Iterator[None]:
    digest = hashlib.sha256(connection.encode()).hexdigest()[:16]
    path = Path(tempfile.gettempdir()) / f"rig-device-{digest}.lock"
    # Any user's run is to be seen by any other's, whatever the umask.
    fd = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, 0o666)
    try:
        try:
            fcntl.flock(fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            owner = os.read(fd, 32).decode(errors="replace").strip() or "unknown"
            state = f"{connection} is in use by the process {owner}"
            raise DriverError(driver, state, "end that run, or wait for its end") from None
        os.truncate(fd, 0)
        os.write(fd, str(os.getpid()).encode())
        yield
    finally:
        os.close(fd)
