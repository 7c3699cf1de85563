"""One test on a simulated rig, as the runner of campaigns sees it: its loop, and what trips it."""

import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.io import ChannelLimit
from rig.loop import (
    Action,
    Cause,
    LoopStoppedError,
    SimulatedLoop,
    TripError,
    confirmed_fault,
    explain,
)
from rig.plant import TICK
from rig.supervisor import Confirmation, Note, TripReport, kept_trip_report, trip_error

Array = NDArray[np.float64]

_REPORTED: Final = round(2.0 / TICK)
"""Rows in a trip report: of the last 2 s, as on hardware."""


class SimulatedTest:
    """A simulated loop that reports what stops it as a rig on hardware does.

    Args:
        loop: before its first tick.
        directory: of the run; a trip report goes there.
        ladder: limits that the loop is judged by, for a trip report.
        say: shows a line to the operator.

    Attributes:
        channels: names of the rows' columns.
    """

    def __init__(
        self,
        loop: SimulatedLoop,
        directory: Path,
        ladder: Sequence[ChannelLimit] = (),
        say: Callable[[str], None] = lambda line: None,
    ) -> None:
        self.channels = loop.channels
        self._loop = loop
        self._directory = directory
        self._ladder = ladder
        self._say = say
        self._indicated = Cause.NONE, ""
        self._last = np.empty((0, len(loop.channels)))
        self._found = ""

    @property
    def ticks_left(self) -> int:
        """Ticks of the test that are still to run."""
        return self._loop.ticks_left

    def position(self) -> None:
        """Bring the ram to its start.

        Raises:
            TripError: the interlock stopped it.
        """
        try:
            self._loop.position()
        except LoopStoppedError as error:
            self._last = self._loop.last_sample()
            raise self._stopped(error) from None
        self._show_indicated()

    def inject(self) -> None:
        """Do nothing: the faults are in the loop's table."""

    def end_early(self) -> None:
        """Do nothing: the next test has a rig of its own."""

    def latest(self, channel: str) -> float | None:
        """Return the newest value of a channel, NaN if the rig has none; None before any row."""
        if not len(self._last):
            return None
        if channel not in self.channels:
            return float("nan")
        return float(self._last[-1, self.channels.index(channel)])

    def advance(self, ticks: int) -> Array:
        """Return the rows of the next ticks; see `rig.runner.campaign.bench.Loop`.

        Raises:
            TripError: the interlock stopped it; or a fault was confirmed, and the test asks to
                trip on one.
        """
        try:
            rows = self._loop.advance(ticks)
        except LoopStoppedError as error:
            raise self._stopped(error) from None
        self._last = np.concatenate([self._last, rows])[-_REPORTED:]
        self._show_indicated()
        return rows

    def decided(self, row: Array) -> None:
        """Hand the loop a decision."""
        self._found = confirmed_fault(row)
        self._loop.decided(row)

    def safe_state(self) -> None:
        """Put the valve at null and take every injected fault away."""
        self._loop.safe_state()

    def _show_indicated(self) -> None:
        """Show the operator what the interlock indicates, once each."""
        indicated = self._loop.indicated
        if indicated not in ((Cause.NONE, ""), self._indicated):
            sentence, remedy = explain(*indicated)
            self._say(f"loop: {sentence}; {remedy}")
        self._indicated = indicated

    def _stopped(self, error: LoopStoppedError) -> TripError:
        """Return the error for a test that the loop ended; what is no trip comes to rest first."""
        if error.action is not Action.TRIP:
            self._last = np.concatenate([self._last, self._loop.come_to_rest()])[-_REPORTED:]
            if self._loop.stopped.action is not Action.TRIP:
                return TripError(str(error))
        return self._tripped(self._loop.stopped)

    def _tripped(self, error: LoopStoppedError) -> TripError:
        """Make the rig safe, report the trip, and return it as an error."""
        at_ns = time.monotonic_ns()
        self._loop.safe_state()
        safe_ns = time.monotonic_ns()
        report = TripReport(
            trips={"loop": (error.cause, at_ns)},
            confirmations=[Confirmation(what, safe_ns) for what in ("valve null", "bypass shut")],
            notes=[Note(at_ns, "detector", self._found)] if self._found else [],
            channels=self.channels,
            rows=self._last,
            channel=error.channel,
            limits=self._ladder,
        )
        return trip_error(report, kept_trip_report(report, self._directory, self._say))
