"""What commissioning asks of the operator: his word before each motion, and what he saw."""

from collections.abc import Callable
from typing import Protocol


class DeclinedError(Exception):
    """Raised when the operator does not agree to a motion; nothing more is moved."""


class Operator(Protocol):
    """Somebody who stands beside the rig, or what takes his place.

    Attributes:
        sees: whether he can tell which way the rod moved.
    """

    sees: bool

    def agrees(self, motion: str, alive: Callable[[], None]) -> bool:
        """Return whether he agrees to a motion, which is described in one sentence or two.

        `alive` is called at least once a second meanwhile; it raises an error if the rig trips or
        the command is stopped.
        """

    def way(self, alive: Callable[[], None]) -> int:
        """Return which way the rod just moved: 1 out, -1 in, 0 if he did not see it."""


class Yes:
    """Agrees to everything and sees nothing, for emulated rigs and tests."""

    sees = False

    def agrees(self, motion: str, alive: Callable[[], None]) -> bool:
        """Return True."""
        return True

    def way(self, alive: Callable[[], None]) -> int:
        """Return 0."""
        return 0
