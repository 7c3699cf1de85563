"""Refusals are logged, but so few per second that an attacker cannot fill the disk with the log."""

import time
from collections.abc import Callable
from typing import Final

MOST_PER_S: Final = 20
"""Most refusals that are logged within a second; further ones are only counted."""


class Refusals:
    """A log of refusals with a limited rate.

    Args:
        log: is called with each line.
        clock: returns a monotonic time in s.
    """

    def __init__(
        self, log: Callable[[str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._log = log
        self._clock = clock
        self._since = clock()
        self._count = 0

    def __call__(self, address: str, why: str) -> None:
        """Log that a request from an address was refused, and why; or only count it."""
        self.look()
        self._count += 1
        if self._count <= MOST_PER_S:
            self._log(f"refused, from {address}: {why}")

    def look(self) -> None:
        """If a second is over, log how many refusals it left out, if any, and begin a new one."""
        now = self._clock()
        if now - self._since < 1.0:
            return
        if self._count > MOST_PER_S:
            self._log(f"refused: {self._count - MOST_PER_S} more, not told one by one")
        self._since, self._count = now, 0
