"""At most one visitor at a time has control and may act on the rigs; everybody sees who it is."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .visitors import Visitor


class NotInControl(Exception):  # noqa: N818 (a refusal, not a failure)
    """The error of a visitor who may not act, or may not take control.

    The message says who has control, or that nobody has. `ControlHolder.take` raises it if somebody
    else has control, `ControlHolder.require` also if nobody has control.
    """


@dataclass
class ControlHolder:
    """The record of which visitor has control; at first nobody has.

    Attributes:
        say: is called with a sentence on every change.
        clock_ns: returns the wall clock in ns since 1970.
        holder: the visitor who has control; None if nobody has.
        since_ns: time of the last change, ns since 1970; 0 if there was none.
    """

    say: Callable[[str], None]
    clock_ns: Callable[[], int] = time.time_ns
    holder: Visitor | None = None
    since_ns: int = 0

    def take(self, visitor: Visitor, *, over: bool = False) -> None:
        """Give a visitor control; do nothing if the visitor has it already.

        Args:
            visitor: the visitor who asks for control.
            over: whether control is taken from somebody else who has it, for which the visitor must
                have asked explicitly.

        Raises:
            NotInControl: somebody else has control, and `over` is false.
        """
        before = self.holder
        if before == visitor:
            return
        if before is not None and not over:
            raise NotInControl(f"{before.name} has control; take over, if it is agreed")
        self.holder, self.since_ns = visitor, self.clock_ns()
        taken = f" over from {before.name}" if before is not None else ""
        self.say(f"{visitor.name} takes{taken or ' control'}")

    def release(self, visitor: Visitor) -> None:
        """Release control if this visitor has it; otherwise do nothing."""
        if self.holder == visitor:
            self.holder = None
            self.since_ns = self.clock_ns()
            self.say(f"{visitor.name} gives control up")

    def require(self, visitor: Visitor) -> None:
        """Raise unless this visitor has control.

        Raises:
            NotInControl: somebody else has control, or nobody has.
        """
        if self.holder is None:
            raise NotInControl("nobody has control; take it first")
        if self.holder != visitor:
            raise NotInControl(f"{self.holder.name} has control")

    def content(self) -> dict[str, Any]:
        """Return number and name of the visitor in control (None if nobody), and since when."""
        holder = self.holder
        return {
            "number": None if holder is None else holder.number,
            "name": None if holder is None else holder.name,
            "since_ms": self.since_ns // 10**6,
        }
