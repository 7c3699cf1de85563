"""A session with a rig on hardware, as a bench for the tests of a campaign."""

import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from estimator.filters import FilterMemory
from faults import CampaignTest
from rig.configuration import Rig
from rig.io import METERS, SLOW_INPUTS
from rig.loop import Drive, LoopStoppedError, Reaction, Timing, TripError, WireLoop
from rig.plant import TICK, Model
from rig.supervisor.processes import BeginRecording, ChildError, FollowMoves, Onlooker

from .arming import SETTLE_S, arm, home
from .connected_rig import ANSWER_S, ConnectedRig, Stop
from .hardware_loop import HardwareTest, TestRecord
from .moves import moves, preparing_moves
from .states import Event, State


class Session:
    """A rig on hardware, as a bench for the tests of a campaign; a context manager.

    Entering connects, verifies, arms and homes; leaving brings everything to its safe state,
    whatever happened. Takes the arguments of `ConnectedRig`.

    Raises:
        DriverError: on entering: a device is not there, or not what was configured.
        TripError: on entering: the rig could not be armed or homed.
    """

    live = True

    def __init__(
        self,
        rig: Rig,
        filter_name: str,
        model: Model,
        directory: Path,
        stop: Stop,
        say: Callable[[str], None],
        onlooker: Onlooker | None = None,
        journal: Callable[[str], None] = lambda text: None,
    ) -> None:
        self._rig = ConnectedRig(rig, filter_name, model, directory, stop, say, onlooker, journal)

    def __enter__(self) -> "Session":
        self._rig.connect()
        try:
            arm(self._rig)
            home(self._rig)
        except BaseException:
            self._rig.leave()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._rig.leave()

    @property
    def rig(self) -> ConnectedRig:
        """The rig, armed and homed, for what is no test."""
        return self._rig

    def reading(self, channel: str) -> float:
        """Return the newest value of a channel, fast or slow; NaN if it has none."""
        if channel in SLOW_INPUTS and channel not in METERS:
            return self._rig.slow(channel)
        return self._rig.latest(channel)

    def idle(self) -> None:
        """Look after the rig while its ram is held between two tests."""
        self._rig.check()

    def loop(self, test: CampaignTest, memory: FilterMemory, assumed: Model) -> "HardwareTest":
        """Return the loop of a test, before the ram is brought to its start."""
        ticks = round(test.duration_s / TICK)
        open_loop = test.setpoint.quantity == "command"
        segment = self._rig.segment(
            Drive.TRACK,
            memory=memory,
            assumed=assumed.parameters,
            setpoint=np.ascontiguousarray(test.setpoint.sample(np.arange(ticks) * TICK)),
            open_loop=open_loop,
            on_fault=Reaction[test.on_fault.name],
        )
        wire = WireLoop(
            self._rig.board,
            self._rig.parts.loop,
            segment,
            start_position=test.start_position_m,
            settle_ticks=round(test.settle_s / TICK),
            period_s=TICK,
            silence_s=self._rig.configured.loop.loop_silence,
        )
        self._test = HardwareTest(self, wire, test)
        return self._test

    @contextmanager
    def writer(
        self, path: Path, channels: tuple[str, ...], metadata: Mapping[str, Any]
    ) -> Iterator["TestRecord"]:
        """Record the present test to a new file, by the recorder's process."""
        grants = [asdict(grant) for grant in self._rig.opened.grants]
        told = {
            **metadata,
            "loop": {"grants": grants, "exchange_rate_hz": self._rig.opened.rate_hz},
        }
        begin = BeginRecording(self._test.number, path, channels, told, time.time_ns())
        self._ask_recorder(begin, ANSWER_S)
        record = TestRecord(
            self._rig.parts.recorder, Timing(channels, TICK), self._rig.say, self._ask_recorder
        )
        try:
            yield record
        finally:
            record.finish()

    def _ask_recorder(self, order: object, timeout_s: float) -> None:
        """Ask the recorder for something, and wait for its answer.

        Raises:
            TripError: it is gone, for which the safety thread trips; what it flushed is on disk.
        """
        try:
            self._rig.ask(self._rig.parts.recorder, order, timeout_s)
        except ChildError as error:
            self._rig.wait(lambda: False, ANSWER_S, str(error), "see the session's log")

    def prepare(self, test: CampaignTest, segment: int) -> None:
        """Bring the bypass valves to where a test begins, and schedule its faults."""
        wanted = preparing_moves(self._rig.configured, test.faults)
        self._rig.write(wanted)
        self._rig.wait(
            lambda: not self._rig.off(wanted), SETTLE_S,
            "the bypass valves are not where the test begins", "look at them",
        )  # fmt: skip
        self._rig.parts.field.send(FollowMoves(segment, moves(self._rig.configured, test.faults)))

    def begin(self, event: Event) -> None:
        """Ask the state machine for the next step of a test."""
        self._rig.alive()
        self._rig.handle(event)

    def going_on(self) -> None:
        """Show the safety thread that the supervisor works.

        Raises:
            TripError: somebody tripped, whatever rows still come.
        """
        self._rig.alive()
        if self._rig.has_tripped:
            raise self._rig.tripped()

    def detected(self, what: str) -> None:
        """Note what the detector found, for a trip report."""
        self._rig.note("detector", what)

    def end_test(self, *, completed: bool) -> None:
        """Take every fault away; bring the ram to rest unless the loop holds it already."""
        if self._rig.has_tripped:
            return
        self._rig.write(preparing_moves(self._rig.configured, ()))
        if completed:
            # A test that is ended before its first tick never ran.
            to_armed = {State.POSITIONING: Event.POSITIONED, State.RUNNING: Event.DONE}
            if self._rig.state in to_armed:
                self._rig.handle(to_armed[self._rig.state])
        else:
            self._rig.ramp_down()

    def stopped(self, error: LoopStoppedError) -> TripError:
        """Return the error for a test that the loop ended by itself."""
        return self._rig.stopped(error)
