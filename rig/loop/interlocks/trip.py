"""The errors that are raised when a trip or a stop ends the motion of the rig."""

import errno
from pathlib import Path
from typing import Final

from .ladder import Action, Cause, explain

FULL: Final = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
"""Values of `errno` for a file that cannot grow: no space, or a quota or limit is reached."""


class LoopStoppedError(Exception):
    """Raised when the loop ended a test: it tripped, ramped down, holds the ram, or is silent.

    Attributes:
        action: the action that the loop took.
        cause: the cause of the action.
        channel: name of the channel that the cause concerns; empty if none.
        explanation: sentence and remedy for the operator.
    """

    def __init__(self, action: Action, cause: Cause, channel: str = "") -> None:
        self.action, self.cause, self.channel = action, cause, channel
        sentence, remedy = explain(cause, channel)
        self.explanation = f"{sentence}; {remedy}"
        super().__init__(f"{action.name.lower()}: {self.explanation}")


class TripError(Exception):
    """Raised when the rig tripped, was stopped, or does not do what was asked of it.

    The message says why, and what the operator is to do.

    Attributes:
        report: path of the trip report; None if there is none.
        cause: the cause of a trip; None for what did not trip the rig.
    """

    def __init__(
        self, message: str, report: Path | None = None, cause: Cause | None = None
    ) -> None:
        self.report, self.cause = report, cause
        super().__init__(message)


class StopRequestedError(TripError):
    """Raised when somebody asked for the rig to stop; nothing was wrong with the rig."""
