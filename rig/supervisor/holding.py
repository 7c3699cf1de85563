"""What a session holds from beginning to end: a lease, its devices' locks, descriptors."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rig.configuration import Rig
from rig.io import DriverError, exclusive
from rig.reserves import Reserve, ShortageError
from rig.supervisor.processes import Errand

from .leases import leased


@contextmanager
def held(
    rig: Rig, reserve: Reserve, errand: Errand, look: Callable[[], None]
) -> Iterator[tuple[int, ...]]:
    """Hold a reserve of descriptors and the locks of a rig's devices, in a `with` block.

    If a station owns the rig, its lease is held besides. The block is given the descriptors that
    each process which may touch the devices has to keep open, so that the station knows when the
    last of them has ended; without a station there are none.

    Args:
        rig: the rig.
        reserve: the reserve of descriptors.
        errand: what the rig is wanted for, which a station is told.
        look: is called while a station leaves the rig; it may raise an error, which ends that.

    Raises:
        DriverError: the system grants this process too little for a session, a device is in use, or
            the station does not lend the rig.
    """
    try:
        reserve.take()
    except ShortageError as error:
        raise DriverError(rig.name, error.state, error.action) from None
    try:
        with leased(rig, errand, look) as kept, exclusive(rig.drivers):
            yield kept
    finally:
        reserve.release()
