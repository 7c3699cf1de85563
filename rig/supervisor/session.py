"""A session with a rig on hardware is a bench on which a campaign runs its tests.

The campaign runner steps through a `HardwareTest`, which it records by a `TestRecord`.
"""

import json
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, Final, NoReturn

import numpy as np
from numpy.typing import NDArray

from control import ControlSettings
from estimator.filters import FilterMemory
from faults import CampaignTest
from rig.configuration import gain_for
from rig.io import METERS, SLOW_INPUTS
from rig.loop import (
    TIMING,
    Action,
    Cause,
    Reaction,
    RungPassed,
    Timing,
    TripError,
    WireLoop,
    confirmed_fault,
    in_short,
    rungs_of,
)
from rig.plant import TICK, Model
from rig.supervisor.processes import (
    BeginRecording,
    ChildError,
    FinishRecording,
    FollowMoves,
    NoteInRecording,
)

from .arming import arm, bring, home
from .connected_rig import ANSWER_S, ConnectedRig
from .guiding import basis_for, guide_for
from .locking import LockedRig
from .moves import moves, preparing_moves
from .states import Event, State

Array = NDArray[np.float64]

OVERDUE_S: Final = 5.0
"""Longest time in s for the rig to become safe before a supervisor that hangs is ended."""
FINISH_S: Final = 10.0
"""Time in s within which the recorder must complete a file."""


class Session:
    """A context manager that makes a rig on hardware a bench for the tests of a campaign.

    On entry it connects, verifies, arms and homes the rig. On exit it brings everything to its safe
    state, also after an error, on entry too.

    Args:
        rig: a rig that is not connected yet.

    Attributes:
        rig: the rig, which is armed and homed within the session.

    Raises:
        DriverError: on entry, a device does not answer or is not the configured one.
        TripError: on entry, the rig could not be armed or homed, or was stopped; on exit, a trip
            was not reported yet, or nothing tripped but a device is not safe.
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

    def is_overdue(self) -> None:
        """Trip, as cleaning up hangs and the process is about to end, and write the trip report.

        The report is written although not everything is safe after `OVERDUE_S`; it tells so then.
        """
        self.rig.note("supervisor", "cleaning up takes too long, and its process ends")
        self.rig.safety.trip(Cause.SUPERVISOR_LOST)
        self.rig.tripped(OVERDUE_S)

    def reading(self, channel: str) -> float:
        """Return the newest value of a channel in SI; NaN if there is none.

        A channel of the rows, or a flow, may be at most 0.25 s old; a slow channel of any age.
        """
        if channel in SLOW_INPUTS and channel not in METERS:
            return self.rig.slow(channel)
        return self.rig.latest(channel)

    def idle(self) -> None:
        """Check the rig while its ram is held between two tests.

        Raises:
            TripError: the rig has tripped.
            StopRequestedError: somebody asked for the end.
        """
        self.rig.check()

    def loop(self, test: CampaignTest, memory: FilterMemory, assumed: Model) -> "HardwareTest":
        """Return the object that steps through a test; it has not moved the ram yet.

        The test is the one that `writer` records, until `loop` is called again.

        Args:
            test: the test.
            memory: memory of the filter, at its start.
            assumed: the model that the filter assumes.
        """
        ticks, limits = round(test.duration_s / TICK), rungs_of(test.limits)
        self.rig.event_log.test_limits = limits
        setpoint = np.ascontiguousarray(test.setpoint.sample(np.arange(ticks) * TICK))
        wire = self.rig.tracking(
            test.start_position_m,
            test.settle_s,
            memory=memory,
            assumed=assumed.parameters,
            setpoint=setpoint,
            gain=gain_for(self.rig.configured, test),
            guide=guide_for(self.rig.configured, test, setpoint, assumed),
            open_loop=test.setpoint.quantity == "command",
            on_fault=Reaction[test.on_fault.name],
            limits=limits,
            basis=basis_for(self.rig.configured, test, assumed),
        )
        self._test = HardwareTest(self.rig, wire, test, assumed)
        return self._test

    def lockable(self, test: CampaignTest) -> LockedRig:
        """Bring the ram to mid stroke, let it rest there, and return the rig, to be locked.

        `test` says for how long it rests. The limits of earlier tests hold no longer.

        Raises:
            TripError: the rig tripped or was stopped, or does not follow.
        """
        return LockedRig(self.rig, test.settle_s)

    @contextmanager
    def writer(
        self, path: Path, channels: tuple[str, ...], metadata: Mapping[str, Any]
    ) -> Iterator["TestRecord"]:
        """Have the recorder write the test of the last call of `loop` to a new file in the block.

        The block is given the test's `TestRecord`. At the end of the block, also after an error,
        the file is completed.

        Args:
            path: the file.
            channels: names of the rows' columns.
            metadata: metadata of the recording; the loop's grants and rate are added.

        Raises:
            TripError: the recorder is gone, at the begin or at the end of the block.
        """
        grants = [asdict(grant) for grant in self.rig.opened.grants]
        loop = {"grants": grants, "exchange_rate_hz": self.rig.opened.rate_hz}
        content = {**metadata, "loop": loop}
        record = TestRecord(self.rig, channels)
        begin = BeginRecording(self._test.number, path, channels, content, time.time_ns())
        record.ask(begin, ANSWER_S)
        try:
            yield record
        finally:
            record.finish()


class HardwareTest:
    """One test on the hardware rig, as the campaign runner steps through it.

    Each step drives the loop on the wire of a rig that is connected, armed and homed already. It is
    checked that the step is allowed, and a stop of the loop becomes a `TripError`.

    Attributes:
        channels: names of the columns of the rows that `advance` returns.
    """

    def __init__(
        self, rig: ConnectedRig, wire: WireLoop, test: CampaignTest, assumed: Model
    ) -> None:
        self.channels = wire.channels
        self._assumed = assumed
        self._rig = rig
        self._wire = wire
        self._test = test
        self._begun = self._early = self._ended = self._ramps_down = False
        self._found = ""

    @property
    def number(self) -> int:
        """The number of the test's segment.

        The first reading orders the segment, and waits until the loop is ready to switch to it.
        """
        return self._wire.ready()

    @property
    def ticks_left(self) -> int:
        """Number of ticks of the test whose rows `advance` has not returned yet."""
        return self._wire.ticks_left

    def position(self) -> None:
        """Bring the ram to the start position of the test, and wait until it is there.

        Raises:
            TripError: the rig tripped or its state forbids the motion, or the loop has ended the
                motion by itself.
        """
        with self._rig.reporting_stops():
            self._begin(Event.POSITION)
            self._wire.position()

    def inject(self) -> None:
        """Set the bypass valves for the test's start, wait for them, and schedule its faults.

        The field process will move the valves at the ticks of the faults. The state becomes ARMED.

        Raises:
            TripError: the rig tripped or was stopped, or the valves do not follow within 20 s.
        """
        rig, faults = self._rig, self._test.faults
        with rig.reporting_stops():
            segment, wanted = self.number, preparing_moves(rig.configured, faults)
            bring(rig, wanted, "the bypass valves are not where the test begins", "look at them")
            rig.parts.field.send(FollowMoves(segment, moves(rig.configured, faults)))
            self._begin(Event.POSITIONED)

    def advance(self, ticks: int) -> Array:
        """Wait for the next `ticks` ticks, or those that are left, and return their rows.

        The rows have shape (n, len(channels)). The first call begins the run of the test.

        Raises:
            TripError: the rig tripped, or the loop has ended the motion by itself.
        """
        if not self._begun:
            self._begin(Event.RUN)
            self._begun = True
        self._rig.going_on()
        with self._rig.reporting_stops():
            return self._wire.advance(ticks)

    def change(self, control: ControlSettings) -> float | None:
        """Give the running test another control, without a bump in the command.

        Return the time of the test in s from which it holds; None if the loop has stopped the
        motion, which the next `advance` tells.

        Args:
            control: the control settings, in which the gain is given.

        Raises:
            TripError: the loop did not take the change, or the rig has tripped.
        """
        rig = self._rig
        setpoint, gain = self._wire.test.setpoint, control.gain or rig.configured.gain_V_per_m
        guide = guide_for(rig.configured, self._test, setpoint, self._assumed, control)
        rig.going_on()
        try:
            tick = self._wire.change(gain, guide)
        except ChildError as error:
            # The safety thread is given time to trip for a loop that is gone.
            rig.wait(lambda: False, ANSWER_S, str(error), "see the session's log")
            return None
        return None if tick is None else tick * TICK

    def decided(self, row: Array) -> None:
        """Pass a decision of the detector, a row of `DECIDED`, to the loop.

        A fault that the decision before did not confirm is noted for a trip report.
        """
        found = confirmed_fault(row)
        if found and found != self._found:
            self._rig.note("detector", found)
        self._found = found
        self._wire.decided(row)

    def passed(self) -> list[RungPassed]:
        """Return the limits that the loop found passed in the test since the last call."""
        return self._wire.passed()

    def skip_to(self, place: int, blend_ticks: int) -> int | None:
        """Go on at a later place of the setpoints; see `WireLoop.skip_to`.

        Raises:
            TripError: the rig tripped, or the loop does not go on.
        """
        with self._rig.reporting_stops():
            return self._wire.skip_to(place, blend_ticks)

    def alive(self) -> None:
        """Show the safety thread that the runner works; never raise for a trip or a stop."""
        self._rig.alive()

    def end_early(self) -> None:
        """Make `safe_state` hold the ram, as after a completed test, with the valve enabled."""
        self._early = True

    def limited(self, action: Action, text: str) -> NoReturn:
        """Carry out the action of a limit that the loop itself does not judge.

        A trip is the safety thread's. For a hold, `safe_state` holds the ram; for a ramp down it
        brings the motion to rest.

        Raises:
            TripError: always.
        """
        rig = self._rig
        rig.note("limit", text)
        rig.say(text)
        if action is Action.TRIP:
            rig.safety.trip(Cause.TEST_LIMIT)
            raise rig.tripped()
        self._early, self._ramps_down = action is Action.HOLD, action is Action.RAMP_DOWN
        raise TripError(text)

    def safe_state(self) -> None:
        """End the test and its faults; repeated calls do nothing.

        After a completed test, or `end_early`, the ram is held; otherwise, or if the loop does not
        hold it, or a limit asked to ramp down, the motion is brought to rest and the valve
        disabled.

        Raises:
            TripError: the loop does not hold the ram after a completed test.
        """
        if self._ended:
            return
        self._ended = True
        held = False
        try:
            ends_held = self._early or (self._begun and not self._wire.ticks_left)
            if ends_held and not self._ramps_down:
                with self._rig.reporting_stops():
                    self._wire.safe_state()
                held = True
        finally:
            self._end(held)

    def _begin(self, event: Event) -> None:
        """Go to the state to which `event` leads, for the next step of the test.

        Raises:
            TripError: the state machine refuses the event, or the rig has tripped.
        """
        self._rig.alive()
        self._rig.handle(event)

    def _end(self, held: bool) -> None:
        """Order the end of every fault; unless the ram is `held`, make the rig safe.

        With the ram held, the valves of the faults are not awaited, and the state becomes ARMED.
        Otherwise the session ends: the motion is brought to rest, and the slow drivers to their
        safe state, before anybody waits for the recording. After a trip nothing is done.
        """
        rig = self._rig
        if rig.safety.tripped:
            return
        rig.write(preparing_moves(rig.configured, ()))
        if not held:
            rig.ramp_down()
            if not rig.safety.tripped:
                rig.make_field_safe()
        # A test that is ended before its first tick is in POSITIONING, or in ARMED already.
        elif rig.state is State.POSITIONING:
            rig.handle(Event.POSITIONED)
        elif rig.state is State.RUNNING:
            rig.handle(Event.DONE)


class TestRecord:
    """The recording of a test, which the recorder's process makes of the rows in the ring."""

    __test__ = False  # pytest must not take this for a class of tests because of its name

    def __init__(self, rig: ConnectedRig, channels: tuple[str, ...]) -> None:
        self._rig = rig
        self._timing = Timing(channels, TICK)
        self._last_s = 0.0

    def write(self, rows: Array) -> None:
        """Count rows, and their timing; the recorder reads the rows from the ring itself."""
        self._timing.take(rows)
        self._last_s = float(rows[-1, 0]) if len(rows) else self._last_s

    def event(self, time_s: float, kind: str, text: str) -> None:
        """Add an event at a time of the test, s, to the recording, unless the recorder is gone."""
        # If the recorder is gone, `finish` raises an error for that.
        with suppress(ChildError):
            self._rig.parts.recorder.send(NoteInRecording(time_s, kind, text))

    def timing(self) -> Mapping[str, Any]:
        """Return statistics of the loop's timing in the rows so far (`Timing.summary`)."""
        return self._timing.summary()

    def finish(self) -> None:
        """Record the loop's timing as an event, show it to the operator, and complete the file.

        It waits until the recorder has completed the file.

        Raises:
            TripError: the recorder is gone; samples that it has flushed are on disk.
        """
        summary = self._timing.summary()
        self.event(self._last_s, TIMING, json.dumps(summary))
        if short := in_short(summary):
            self._rig.say(f"      loop: {short}")
        self.ask(FinishRecording(self._timing.ticks), FINISH_S)

    def ask(self, order: object, timeout_s: float) -> None:
        """Send the recorder an order, and wait for its answer.

        Raises:
            TripError: the recorder is gone or does not answer; the safety thread is given time to
                trip before. Samples that the recorder has flushed are on disk.
        """
        try:
            self._rig.ask(self._rig.parts.recorder, order, timeout_s)
        except ChildError as error:
            self._rig.wait(lambda: False, ANSWER_S, str(error), "see the session's log")
