"""The CAN bus of an emulated rig: python-can's multicast bus, for a group to which anybody sends.

python-can makes a frame of whatever values a datagram has. One of 200 bytes whose data are given as
the number 2**30 would have it fill a gigabyte. Here the types are checked first.
"""

from typing import Any, Final

import msgpack

# python-can is imported here first, without what it need not load.
from .libraries import python_can as can  # isort: skip
from can.interfaces.udp_multicast import UdpMulticastBus

_TYPES: Final[dict[str, tuple[type, ...]]] = {
    "timestamp": (int, float),
    "arbitration_id": (int,),
    "is_extended_id": (bool,),
    "is_remote_frame": (bool,),
    "is_error_frame": (bool,),
    "channel": (str, int, type(None)),
    "dlc": (int,),
    "data": (bytes,),
    "is_fd": (bool,),
    "bitrate_switch": (bool,),
    "error_state_indicator": (bool,),
}
"""Keys of a datagram and the types of their values, which are those that python-can sends."""


class MulticastBus(UdpMulticastBus):
    """A multicast bus on which a datagram that is no frame is an error, and costs next to nothing.

    Args: those of python-can's bus.
    """

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        """Return the next frame, or None after `timeout` s, and that no filter was applied.

        Raises:
            can.CanOperationError: what came is no frame, or nothing can be received.
        """
        received = self._multicast.recv(timeout)
        if received is None:
            return None, False
        datagram, _, timestamp = received
        try:
            return _frame(datagram, timestamp), False
        except Exception as error:  # whatever the bytes are, they are no frame
            raise can.CanOperationError(f"not a frame: {error}") from error


def _frame(datagram: bytes, timestamp: float) -> can.Message:
    """Return the frame in a datagram, with the time in s at which it came.

    Raises:
        Exception: the datagram is no frame; of many types, such as ValueError.
    """
    values: dict[str, Any] = msgpack.unpackb(datagram)
    for key, value in values.items():
        if type(value) not in _TYPES[key]:
            raise ValueError(f"{key} is of type {type(value).__name__}")
    return can.Message(**{**values, "timestamp": timestamp}, check=True)
