"""What a session holds from its beginning to its end: its devices' locks, and descriptors."""

from collections.abc import Iterator
from contextlib import contextmanager

from rig.configuration import Rig
from rig.io import DriverError, exclusive
from rig.reserves import Reserve, ShortageError


@contextmanager
def held(rig: Rig, reserve: Reserve) -> Iterator[None]:
    """Hold a reserve of descriptors and the locks of a rig's devices, in a `with` block.

    Raises:
        DriverError: the system grants this process too little for a session, or a device is in use.
    """
    try:
        reserve.take()
    except ShortageError as error:
        raise DriverError(rig.name, error.state, error.action) from None
    try:
        with exclusive(rig.drivers):
            yield
    finally:
        reserve.release()
