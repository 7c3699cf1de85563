"""Runs one test on a simulated rig for the runner of campaigns, and reports its trips."""

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
from rig.supervisor import News, TripReport, kept_trip_report, trip_error

Array = NDArray[np.float64]

_REPORTED: Final = round(2.0 / TICK)
"""Number of rows in a trip report: those of the last 2 s, as on hardware."""


class SimulatedTest:
    """A `Loop` on a simulated rig, which reports a trip in the same way as a rig on hardware.

    Args:
        loop: the simulated loop, before its first tick.
        directory: folder of the run, to which a trip report is written.
        ladder: the limits of the loop's interlock, for a trip report.
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
        """Number of the test's ticks that have not been run yet."""
        return self._loop.ticks_left

    def position(self) -> None:
        """Move the ram to the test's start position, and wait until it has settled there.

        Raises:
            TripError: the interlock stopped the loop.
        """
        try:
            self._loop.position()
        except LoopStoppedError as error:
            self._last = self._loop.last_sample()
            raise self._stopped(error) from None
        self._show_indicated()

    def inject(self) -> None:
        """Do nothing, as the loop has the faults in a table from its beginning."""

    def end_early(self) -> None:
        """Do nothing, as the next test has a rig of its own."""

    def latest(self, channel: str) -> float | None:
        """Return the newest value of a channel.

        It is NaN if the rig has no such channel, and None before the first row.
        """
        if not len(self._last):
            return None
        if channel not in self.channels:
            return float("nan")
        return float(self._last[-1, self.channels.index(channel)])

    def advance(self, ticks: int) -> Array:
        """Run the next ticks and return their rows; see `rig.runner.campaign.bench.Loop`.

        Raises:
            TripError: the interlock stopped the loop, or a fault was confirmed in a test that shall
                trip on a fault.
        """
        try:
            rows = self._loop.advance(ticks)
        except LoopStoppedError as error:
            raise self._stopped(error) from None
        self._last = np.concatenate([self._last, rows])[-_REPORTED:]
        self._show_indicated()
        return rows

    def decided(self, row: Array) -> None:
        """Give the loop the detector's decision, a row of `rig.loop.decided.DECIDED`."""
        self._found = confirmed_fault(row)
        self._loop.decided(row)

    def safe_state(self) -> None:
        """Put the valve at null, and remove all injected faults."""
        self._loop.safe_state()

    def _show_indicated(self) -> None:
        """Show the operator what the interlock indicates, each time that it changes."""
        indicated = self._loop.indicated
        if indicated not in ((Cause.NONE, ""), self._indicated):
            sentence, remedy = explain(*indicated)
            self._say(f"loop: {sentence}; {remedy}")
        self._indicated = indicated

    def _stopped(self, error: LoopStoppedError) -> TripError:
        """Return the error to raise after the loop has stopped.

        After a trip the rig is made safe and a trip report is written. After a lesser action the
        loop runs until the ram is at rest; a report is written only if it trips meanwhile.
        """
        if error.action is not Action.TRIP:
            self._last = np.concatenate([self._last, self._loop.come_to_rest()])[-_REPORTED:]
            if self._loop.stopped.action is not Action.TRIP:
                return TripError(str(error))
        return self._tripped(self._loop.stopped)

    def _tripped(self, error: LoopStoppedError) -> TripError:
        """Make the rig safe, write the trip report, and return the error to raise."""
        at_ns = time.monotonic_ns()
        self._loop.safe_state()
        safe_ns = time.monotonic_ns()
        report = TripReport(
            trips={"loop": (error.cause, at_ns)},
            confirmations=dict.fromkeys(("valve null", "bypass shut"), safe_ns),
            notes=[News(at_ns, "detector", self._found)] if self._found else [],
            channels=self.channels,
            rows=self._last,
            channel=error.channel,
            limits=self._ladder,
        )
        return trip_error(report, kept_trip_report(report, self._directory, self._say))
