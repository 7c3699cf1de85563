"""The phases of a test, in their order, and the deadline of its last."""

import threading
from collections.abc import Callable
from enum import StrEnum
from typing import Final

CLEANUP_S: Final = 60.0
"""How long cleaning up may take: the ramp, the loop's and the recorder's answers, each bounded, add
up to 35 s on hardware."""


class Phase(StrEnum):
    """What a test is doing."""

    SETUP = "setup"
    """Detector, filter and loop are made."""
    POSITIONING = "positioning"
    """The ram is brought to its start, and comes to rest there."""
    SETTLE = "settle"
    """The rest of the settling time, where the runner keeps the pace."""
    INJECT = "inject"
    """Bypass valves are brought to where the test begins; its faults are scheduled."""
    MAIN = "main"
    """The motion, recorded and judged."""
    CLEANUP = "cleanup"
    """Every fault away, ram at rest or held, recording closed."""


class Deadline:
    """Calls somebody if cleaning up takes too long.

    Args:
        seconds: how long it may take.
        overdue: is called once, from a thread of its own; the main thread may hang for good.
    """

    def __init__(self, seconds: float, overdue: Callable[[], None]) -> None:
        self._seconds = seconds
        self._overdue = overdue
        self._timer: threading.Timer | None = None

    def start(self) -> None:
        """Begin to count, unless it does already."""
        if self._timer is None:
            self._timer = threading.Timer(self._seconds, self._overdue)
            self._timer.daemon = True
            self._timer.start()

    def cancel(self) -> None:
        """Everything is cleaned up."""
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
