"""A session with a rig on hardware, as a bench for the tests of a campaign, and each of its tests.

The campaign runner steps through a `HardwareTest`; its rows are kept by a `TestRecord`.
"""

import json
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimator.filters import FilterMemory
from faults import CampaignTest
from rig.io import METERS, SLOW_INPUTS
from rig.loop import (
    TIMING,
    Drive,
    LoopStoppedError,
    Reaction,
    Timing,
    TripError,
    WireLoop,
    confirmed_fault,
    in_short,
)
from rig.plant import TICK, Model
from rig.supervisor.processes import (
    BeginRecording,
    Child,
    ChildError,
    FinishRecording,
    FollowMoves,
    NoteInRecording,
)

from .arming import arm, bring, home
from .connected_rig import ANSWER_S, ConnectedRig
from .moves import moves, preparing_moves
from .states import Event, State

Array = NDArray[np.float64]

FINISH_S: Final = 10.0
"""How long the recorder may take to complete a file."""


class Session:
    """A rig on hardware, as a bench for the tests of a campaign; a context manager.

    Entering it connects, verifies, arms and homes the rig. Leaving it brings everything to its
    safe state, whatever happened.

    Args:
        rig: not connected yet.

    Attributes:
        rig: while the session is entered, it is armed and homed.

    Raises:
        DriverError: on entering: a device is not there, or not what was configured.
        TripError: on entering: the rig could not be armed or homed.
    """

    live = True

    def __init__(self, rig: ConnectedRig) -> None:
        self.rig = rig

    def __enter__(self) -> "Session":
        self.rig.connect()
        try:
            arm(self.rig)
            home(self.rig)
        except BaseException:
            self.rig.leave()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self.rig.leave()

    def reading(self, channel: str) -> float:
        """Return the newest value of a channel, fast or slow; NaN if it has none."""
        if channel in SLOW_INPUTS and channel not in METERS:
            return self.rig.slow(channel)
        return self.rig.latest(channel)

    def idle(self) -> None:
        """Look after the rig while its ram is held between two tests."""
        self.rig.check()

    def loop(self, test: CampaignTest, memory: FilterMemory, assumed: Model) -> "HardwareTest":
        """Return the loop of a test, before the ram is brought to its start."""
        ticks = round(test.duration_s / TICK)
        open_loop = test.setpoint.quantity == "command"
        segment = self.rig.segment(
            Drive.TRACK,
            memory=memory,
            assumed=assumed.parameters,
            setpoint=np.ascontiguousarray(test.setpoint.sample(np.arange(ticks) * TICK)),
            open_loop=open_loop,
            on_fault=Reaction[test.on_fault.name],
        )
        wire = WireLoop(
            self.rig.board,
            self.rig.parts.loop,
            segment,
            start_position=test.start_position_m,
            settle_ticks=round(test.settle_s / TICK),
            period_s=TICK,
            silence_s=self.rig.configured.loop.loop_silence,
        )
        self._test = HardwareTest(self, wire, test)
        return self._test

    @contextmanager
    def writer(
        self, path: Path, channels: tuple[str, ...], metadata: Mapping[str, Any]
    ) -> Iterator["TestRecord"]:
        """Record the present test to a new file, by the recorder's process."""
        grants = [asdict(grant) for grant in self.rig.opened.grants]
        loop = {"grants": grants, "exchange_rate_hz": self.rig.opened.rate_hz}
        content = {**metadata, "loop": loop}
        begin = BeginRecording(self._test.number, path, channels, content, time.time_ns())
        self._ask_recorder(begin, ANSWER_S)
        record = TestRecord(
            self.rig.parts.recorder, Timing(channels, TICK), self.rig.say, self._ask_recorder
        )
        try:
            yield record
        finally:
            record.finish()

    def _ask_recorder(self, order: object, timeout_s: float) -> None:
        """Ask the recorder for something, and wait for its answer.

        Raises:
            TripError: the recorder is gone, so that the safety thread trips. What the recorder
                flushed before is on disk.
        """
        try:
            self.rig.ask(self.rig.parts.recorder, order, timeout_s)
        except ChildError as error:
            self.rig.wait(lambda: False, ANSWER_S, str(error), "see the session's log")

    def prepare(self, test: CampaignTest, segment: int) -> None:
        """Bring the bypass valves to where a test begins, and schedule its faults."""
        wanted = preparing_moves(self.rig.configured, test.faults)
        bring(self.rig, wanted, "the bypass valves are not where the test begins", "look at them")
        self.rig.parts.field.send(FollowMoves(segment, moves(self.rig.configured, test.faults)))

    def begin(self, event: Event) -> None:
        """Ask the state machine for the next step of a test."""
        self.rig.alive()
        self.rig.handle(event)

    def going_on(self) -> None:
        """Show the safety thread that the supervisor works.

        Raises:
            TripError: somebody tripped, whatever rows still come.
        """
        self.rig.alive()
        if self.rig.has_tripped:
            raise self.rig.tripped()

    def detected(self, what: str) -> None:
        """Note what the detector found, for a trip report."""
        self.rig.note("detector", what)

    def end_test(self, *, completed: bool) -> None:
        """Take every fault away; bring the ram to rest unless the loop holds it already."""
        if self.rig.has_tripped:
            return
        self.rig.write(preparing_moves(self.rig.configured, ()))
        if completed:
            # A test that is ended before its first tick never ran.
            to_armed = {State.POSITIONING: Event.POSITIONED, State.RUNNING: Event.DONE}
            if self.rig.state in to_armed:
                self.rig.handle(to_armed[self.rig.state])
        else:
            self.rig.ramp_down()

    def stopped(self, error: LoopStoppedError) -> TripError:
        """Return the error for a test that the loop ended by itself."""
        return self.rig.stopped(error)


class HardwareTest:
    """One test on the hardware rig, as the campaign runner steps through it.

    Each step drives the loop on the wire and reports to the session, which is open already and
    stays open: the session checks that the step is allowed, sets the bypass valves, schedules the
    faults, and turns a stop of the loop into a `TripError`.

    Attributes:
        channels: names of the columns of the rows that `advance` returns.
    """

    def __init__(self, session: Session, wire: WireLoop, test: CampaignTest) -> None:
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
        # If the recorder is gone, `finish` raises an error for that.
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
