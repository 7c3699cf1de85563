"""The phases of a test in their order, and the deadline of the last one, cleaning up."""

import threading
from collections.abc import Callable
from enum import StrEnum
from typing import Final

CLEANUP_S: Final = 60.0
"""How long cleaning up may take, s. On hardware the ramp and the answers of loop and recorder, each
with a limit of its own, add up to 35 s."""


class Phase(StrEnum):
    """The phase that a test is in."""

    SETUP = "setup"
    """The runner makes the detector, the filter and the loop."""
    POSITIONING = "positioning"
    """The ram moves to its start position and comes to rest there."""
    SETTLE = "settle"
    """If the run is paced, the runner waits for the rest of the settling time."""
    INJECT = "inject"
    """The bypass valves move to their first positions, and the faults are scheduled."""
    MAIN = "main"
    """The test's motion runs, and is recorded and judged."""
    CLEANUP = "cleanup"
    """All faults are removed, the ram is stopped or held, and the recording is closed."""


class Deadline:
    """Calls a function if cleaning up takes too long.

    Args:
        seconds: how long cleaning up may take.
        overdue: is called once, from a thread of its own, because the main thread may hang.
    """

    def __init__(self, seconds: float, overdue: Callable[[], None]) -> None:
        self._seconds = seconds
        self._overdue = overdue
        self._timer: threading.Timer | None = None

    def start(self) -> None:
        """Start the time, unless it runs already."""
        if self._timer is None:
            self._timer = threading.Timer(self._seconds, self._overdue)
            self._timer.daemon = True
            self._timer.start()

    def cancel(self) -> None:
        """Stop the time, because everything is cleaned up."""
        timer, self._timer = self._timer, None
        if timer is not None:
            timer.cancel()
