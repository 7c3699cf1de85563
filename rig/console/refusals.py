"""What is refused is logged, but not so often that the log is an attacker's to fill."""

import time
from collections.abc import Callable
from typing import Final

MOST_PER_S: Final = 20
"""Refusals that are logged within a second; the rest is counted."""


class Refusals:
    """Logs refusals.

    Args:
        log: is called with a line on each.
        clock: monotonic, s.
    """

    def __init__(
        self, log: Callable[[str], None], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._log = log
        self._clock = clock
        self._since = clock()
        self._count = 0

    def __call__(self, address: str, why: str) -> None:
        """Log a refusal: of whom, and why."""
        self.look()
        self._count += 1
        if self._count <= MOST_PER_S:
            self._log(f"refused, from {address}: {why}")

    def look(self) -> None:
        """Log how many were left out of the second that is over."""
        now = self._clock()
        if now - self._since < 1.0:
            return
        if self._count > MOST_PER_S:
            self._log(f"refused: {self._count - MOST_PER_S} more, not told one by one")
        self._since, self._count = now, 0
