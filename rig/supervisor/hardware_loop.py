"""One test on a rig on hardware, as the runner of campaigns sees it: its loop and its recording."""

import json
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from faults import CampaignTest
from rig.loop import (
    TIMING,
    LoopStoppedError,
    Timing,
    TripError,
    WireLoop,
    confirmed_fault,
    in_short,
)
from rig.supervisor.processes import Child, ChildError, FinishRecording, NoteInRecording

from .states import Event

Array = NDArray[np.float64]

FINISH_S: Final = 10.0
"""How long the recorder may take to complete a file."""


class _Session(Protocol):
    """The part of a session that a test on it needs."""

    def prepare(self, test: CampaignTest, segment: int) -> None:
        """Bring the bypass valves to where a test begins, and schedule its faults."""

    def begin(self, event: Event) -> None:
        """Ask the state machine for the next step of a test; `TripError` if it refuses."""

    def going_on(self) -> None:
        """Show the safety thread that the supervisor works; raise `TripError` after a trip."""

    def detected(self, what: str) -> None:
        """Note what the detector found."""

    def end_test(self, *, completed: bool) -> None:
        """Take every fault away; bring the ram to rest unless the loop holds it already."""

    def stopped(self, error: LoopStoppedError) -> TripError:
        """Return the error for a test that the loop ended by itself."""


class HardwareTest:
    """One test on the hardware rig, as the campaign runner steps through it.

    Each step drives the loop on the wire and reports to the session, which is open already and
    stays open: the session checks that the step is allowed, sets the bypass valves, schedules the
    faults, and turns a stop of the loop into a `TripError`.

    Attributes:
        channels: names of the columns of the rows that `advance` returns.
    """

    def __init__(self, session: _Session, wire: WireLoop, test: CampaignTest) -> None:
        self.channels = wire.channels
        self._session = session
        self._wire = wire
        self._test = test
        self._begun = False
        self._early = False
        self._found = ""
        self._ended = False

    @property
    def number(self) -> int:
        """Number of the test's segment; the loop gets ready for it."""
        return self._wire.ready()

    @property
    def ticks_left(self) -> int:
        """Ticks of the test that are still to come."""
        return self._wire.ticks_left

    def position(self) -> None:
        """Bring the ram to its start.

        Raises:
            TripError: the rig tripped, or cannot be brought there.
        """
        try:
            self._session.begin(Event.POSITION)
            self._wire.position()
        except LoopStoppedError as error:
            raise self._session.stopped(error) from None

    def inject(self) -> None:
        """Bring the bypass valves to where the test begins, and schedule its faults.

        Raises:
            TripError: the rig tripped, or cannot be brought there.
        """
        try:
            self._session.prepare(self._test, self.number)
            self._session.begin(Event.POSITIONED)
        except LoopStoppedError as error:
            raise self._session.stopped(error) from None

    def advance(self, ticks: int) -> Array:
        """Return the rows of the next ticks; see `rig.runner.campaign.bench.Loop`.

        Raises:
            TripError: the rig tripped, or left the motion that was asked for.
        """
        if not self._begun:
            self._session.begin(Event.RUN)
            self._begun = True
        self._session.going_on()
        try:
            return self._wire.advance(ticks)
        except LoopStoppedError as error:
            raise self._session.stopped(error) from None

    def decided(self, row: Array) -> None:
        """Hand the loop a decision, and note a fault that it confirms."""
        found = confirmed_fault(row)
        if found and found != self._found:
            self._session.detected(found)
        self._found = found
        self._wire.decided(row)

    def end_early(self) -> None:
        """Have the ram held when the test is ended, instead of the valve disabled."""
        self._early = True

    def safe_state(self) -> None:
        """End the test: every fault away; a ram that is still under way is brought to rest."""
        if self._ended:
            return
        self._ended = True
        completed = self._early or (self._begun and not self._wire.ticks_left)
        if completed:
            self._wire.safe_state()
        self._session.end_test(completed=completed)


class TestRecord:
    """The recording of a test by the recorder's process; rows reach it through the ring."""

    __test__ = False  # not a pytest class, whatever its name

    def __init__(
        self,
        process: Child,
        timing: Timing,
        say: Callable[[str], None],
        ask: Callable[[object, float], None],
    ) -> None:
        self._process = process
        self._timing = timing
        self._say = say
        self._ask = ask
        self._rows = 0
        self._last_s = 0.0

    def write(self, rows: Array) -> None:
        """Count rows that the recorder takes from the ring itself."""
        self._timing.take(rows)
        self._rows += len(rows)
        self._last_s = float(rows[-1, 0]) if len(rows) else self._last_s

    def event(self, time_s: float, kind: str, text: str) -> None:
        """Note something that happened at a time of the test."""
        # Of a recorder that is gone, `finish` tells.
        with suppress(ChildError):
            self._process.send(NoteInRecording(time_s, kind, text))

    def timing(self) -> Mapping[str, Any]:
        """Return how well the loop kept its time so far."""
        return self._timing.summary()

    def finish(self) -> None:
        """Add the loop's timing, show it in short, and have the file completed.

        Raises:
            TripError: the recorder is gone; what it flushed is on disk.
        """
        summary = self._timing.summary()
        self.event(self._last_s, TIMING, json.dumps(summary))
        self._say(f"      loop: {in_short(summary)}")
        self._ask(FinishRecording(self._rows), FINISH_S)
