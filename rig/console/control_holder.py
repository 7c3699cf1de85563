"""Who has control: one of those who watch may act on the rigs, and everybody sees who it is."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from .visitors import Visitor


class NotInControl(Exception):  # noqa: N818 (a refusal, not a failure)
    """A visitor may not act or take control; the message says who has control, or that nobody has.

    `ControlHolder.take` raises it if somebody else has control, `ControlHolder.require` also if
    nobody has.
    """


@dataclass
class ControlHolder:
    """Who may act; nobody, to begin with.

    Attributes:
        say: is called with a sentence on every change.
        clock_ns: wall clock, ns since 1970.
    """

    say: Callable[[str], None]
    clock_ns: Callable[[], int] = time.time_ns
    holder: Visitor | None = None
    since_ns: int = 0

    def take(self, visitor: Visitor, *, over: bool = False) -> None:
        """Give a visitor control.

        Args:
            visitor: who asks.
            over: whether it may be taken from somebody else, as was asked for in so many words.

        Raises:
            NotInControl: somebody else has it.
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
        """Let go of control, if this visitor has it."""
        if self.holder == visitor:
            self.holder = None
            self.since_ns = self.clock_ns()
            self.say(f"{visitor.name} gives control up")

    def require(self, visitor: Visitor) -> None:
        """Look whether a visitor may act.

        Raises:
            NotInControl: no.
        """
        if self.holder is None:
            raise NotInControl("nobody has control; take it first")
        if self.holder != visitor:
            raise NotInControl(f"{self.holder.name} has control")

    def content(self) -> dict[str, Any]:
        """Return what everybody may know of who has control."""
        holder = self.holder
        return {
            "number": None if holder is None else holder.number,
            "name": None if holder is None else holder.name,
            "since_ms": self.since_ns // 10**6,
        }
