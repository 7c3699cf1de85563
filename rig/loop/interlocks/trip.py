"""The errors by which a trip of the rig ends whatever was being done with it."""

import errno
from pathlib import Path
from typing import Final

from .ladder import Action, Cause, explain

FULL: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""`errno` where a file cannot grow: no space, or its user's quota or limit."""


class LoopStoppedError(Exception):
    """A test that the loop ended: it tripped, ramped down, holds, or is silent.

    Attributes:
        action: what it did.
        cause: why.
        channel: name of the channel concerned, or empty.
        explanation: sentence and remedy.
    """

    def __init__(self, action: Action, cause: Cause, channel: str = "") -> None:
        self.action, self.cause, self.channel = action, cause, channel
        sentence, remedy = explain(cause, channel)
        self.explanation = f"{sentence}; {remedy}"
        super().__init__(f"{action.name.lower()}: {self.explanation}")


class TripError(Exception):
    """The rig tripped, or left the motion that was asked for; the message says why.

    Attributes:
        report: the trip report, if there is one.
    """

    def __init__(self, message: str, report: Path | None = None) -> None:
        self.report = report
        super().__init__(message)


class StopRequestedError(TripError):
    """The operator stopped what was being done; nothing was wrong with the rig."""
