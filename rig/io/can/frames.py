"""Takes frames off a CAN bus on which anybody may send anything.

A multicast group stands for the bus of an emulated rig, and any program may send bytes to it that
are no frame. They are counted and passed over, and no reader ends by them.
"""

from typing import Final

from .libraries import python_can as can

_MOST_FRAMES: Final = 500
"""Greatest number of frames that one call takes.

Somebody who sends without end must not keep the program that reads from its other work.
"""


class FrameReader:
    """Takes data frames of classical CAN off an open bus.

    Error frames, remote frames and frames of CAN FD are left out; no device of this software uses
    them.

    Args:
        bus: the bus; it stays open.

    Attributes:
        unreadable: number of calls of the bus so far that gave an error instead of a frame, as for
            bytes that are no frame.
    """

    def __init__(self, bus: can.BusABC) -> None:
        self._bus = bus
        self.unreadable = 0

    def take(self, wait: float = 0.0) -> list[can.Message]:
        """Return the data frames that have come in; at most 500 of all kinds are looked at.

        If nothing at all has come in, it waits up to `wait` seconds for the first frame. It raises
        no error for a bus that cannot be read: nothing comes then, which whoever waits for a
        device's messages notices.
        """
        frames: list[can.Message] = []
        for _ in range(_MOST_FRAMES):
            try:
                frame = self._bus.recv(wait)
            except (can.CanError, OSError):
                self.unreadable += 1
                continue
            finally:
                wait = 0.0
            if frame is None:
                break
            if _is_data(frame):
                frames.append(frame)
        return frames


def _is_data(frame: can.Message) -> bool:
    # The identifier of a frame that came by multicast may be of any type that compares with one.
    return type(frame.arbitration_id) is int and not (
        frame.is_error_frame or frame.is_remote_frame or frame.is_fd
    )
