"""The error by which a trip of the rig ends whatever was being done with it."""

from pathlib import Path


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
