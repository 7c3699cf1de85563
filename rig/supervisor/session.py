"""A session with a real rig: its processes, from connecting to every way out; a bench for tests.

The supervisor's main thread is here. It asks the state machine before it orders anything.
"""

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from estimator.filters import FilterMemory, start_memory
from faults.campaign import CampaignTest
from rig.configuration.rig import Rig
from rig.io.ds408 import DriveState
from rig.io.settings import HomingSettings
from rig.io.signals import FAST_INPUTS, SLOW_INPUTS
from rig.loop import orders
from rig.loop.board import Board, Word
from rig.loop.homing import Homing, HomingError, HomingSample, Phase
from rig.loop.ladder import Action, Cause, explain, limit_table
from rig.loop.ring import RingReader
from rig.loop.timing import Timing
from rig.loop.tolerances import tolerances
from rig.loop.trip import TripError
from rig.loop.wire_layout import Drive, wire_channels
from rig.loop.wire_loop import LoopStoppedError, WireLoop
from rig.plant import Model
from rig.plant.integrator import TICK

from . import field, recorder
from .child import Child, ChildError, News
from .hardware_test import HardwareTest, TestRecord
from .moves import moves, preparing_moves
from .states import VALVE_ENABLED, Conditions, Event, SessionState, State
from .trip_report import Confirmation, Note, TripReport, write_trip_report
from .watch import Parts, Watch, trips_of

Array = NDArray[np.float64]

OPEN_S: Final = 300.0
"""How long opening may take: the loop may have to be compiled first."""
ANSWER_S: Final = 10.0
SETTLE_S: Final = 20.0
"""How long pump and valves may take to be where they were asked to be."""
RESET_S: Final = 120.0
"""How long the operator may take to press reset."""
STOP_S: Final = 5.0
"""How long bringing the motion to rest may take."""
POLL_S: Final = 0.01
LAST_S: Final = 2.0
"""What a trip report shows of all channels."""
LOG: Final = "session.log"
"""What the processes write to stderr, in the run's folder; removed if it stays empty."""


WITHIN_LIMITS_M: Final = 0.02
"""How far within its limits the ram is when they begin to be watched."""
NULL_V: Final = 0.05
"""An output this near to 0 V is at null, as the loop takes it."""
NEEDLE_TOLERANCE: Final = 0.02
"""Of its stroke, by which a needle may be off: what its driver takes for arrived."""

_FEEDBACK: Final = {"drive_target": "drive_state", "pump_load": "pump_loaded"}
"""The slow inputs that tell of outputs of another name."""


class Stop(Protocol):
    """Whether somebody asked for an end; see `rig.runner.stopping.StopFlag`."""

    @property
    def requested(self) -> bool:
        """Whether the session shall end."""

    @property
    def reason(self) -> str:
        """Why."""


class Session:
    """A rig on hardware, as a bench for the tests of a campaign; a context manager.

    Entering connects, verifies, arms and homes; leaving brings everything to its safe state,
    whatever happened.

    Args:
        rig: with its drivers.
        filter_name: the filter that the loop shall run.
        model: what the filter assumes.
        directory: of the run; a trip report goes there.
        stop: whether somebody asked for an end.
        say: shows a line to the operator.

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
    ) -> None:
        self._rig = rig
        self._model = model
        self._memory = lambda: start_memory(filter_name, model, rig.sensors)
        self._directory = directory
        self._stop = stop
        self._say = say
        self._state = SessionState()
        self._notes: list[Note] = []
        self._outputs = {output for spec in rig.drivers for output in spec.outputs}
        self._offset_m = 0.0
        self._report: TripReport | None = None
        self._reported: Path | None = None

    def __enter__(self) -> "Session":
        self._connect()
        try:
            self._arm()
            self._home()
        except BaseException:
            self._leave()
            raise
        return self

    def __exit__(self, *_: object) -> None:
        self._leave()

    def _connect(self) -> None:
        self._handle(Event.CONNECT)
        memory = self._memory()
        self._channels = wire_channels(memory.filter.states, open_loop=False)
        self._board = Board.create(len(self._channels))
        self._board.words[Word.PERIOD_NS] = round(1e9 / self._rig.loop.rate)
        log = self._directory / LOG
        self._parts = Parts(
            *(
                Child(name, f"rig.supervisor.{module}", self._board, log, self._on_news)
                for name, module in (
                    ("loop", "loop_process"),
                    ("field", "field"),
                    ("recorder", "recorder"),
                )
            )
        )
        self._watch = Watch(self._board, self._parts, self._rig.loop, self._rig.drivers, self._note)
        try:
            self._open()
        except BaseException:
            self._handle(Event.CONNECTION_FAILED)
            self._end_parts()
            raise
        self._watch.start()
        self._handle(Event.CONNECTED)

    def _open(self) -> None:
        rig = self._rig
        slow = tuple(spec for spec in rig.drivers if spec.kind == "slow")
        self._parts.field.ask(field.Open(slow, rig.loop), OPEN_S)
        first = orders.Segment(1, Drive.NULL, self._memory(), self._model.parameters, homed=False)
        (fast,) = (spec for spec in rig.drivers if spec.kind == "fast")
        period_s = 1.0 / rig.loop.rate
        self._board.words[Word.SWITCH] = first.number
        opened: orders.Opened = self._parts.loop.ask(
            orders.Open(
                driver=fast,
                settings=rig.loop,
                limits=limit_table(rig.ladder, period_s),
                tolerances=tolerances(
                    self._model.parameters,
                    rig.sensors,
                    frozenset(fast.inputs),
                    period_s,
                    rig.loop.stale_limit,
                    rig.homing or HomingSettings(),
                    rig.limits.command_V,
                ),
                first=first,
            ),
            OPEN_S,
        )
        self._grants = opened.grants
        self._rate_hz = opened.rate_hz

    # What the state machine, the ring and the board say

    def _handle(self, event: Event) -> None:
        self._note("session", event.value)
        self._state.handle(event, self._conditions())

    def _conditions(self) -> Conditions:
        if self._state.state in (State.OFF, State.CONNECTING):
            return Conditions()
        words = self._board.words
        stands = Action(int(words[Word.ACTION])) >= Action.HOLD
        # What a device does not report cannot forbid anything.
        return Conditions(
            estop_closed=self.latest("estop_closed") != 0.0,
            valve_enabled=self.latest("valve_enabled") != 0.0,
            homed=bool(words[Word.HOMED]),
            standing=explain(Cause(int(words[Word.ACTION_CAUSE]))).sentence if stands else "",
        )

    def latest(self, channel: str) -> float:
        """Return the newest value of a channel that came in the last quarter second, else NaN."""
        values = RingReader(self._board).latest(round(0.25 * self._rig.loop.rate))
        known = values[:, self._channels.index(channel)]
        known = known[np.isfinite(known)]
        return float(known[-1]) if known.size else float("nan")

    def slow(self, channel: str) -> float:
        """Return the newest value of a slow channel, NaN if there is none."""
        return float(self._board.slow[SLOW_INPUTS.index(channel)])

    def _ask(self, part: Child, order: object, timeout_s: float) -> Any:
        """Return a part's answer; the watch goes on to beat while it is waited for."""
        part.send(order)
        until = time.monotonic() + timeout_s
        while True:
            self._watch.alive()
            try:
                return part.answer(1.0)
            except ChildError:
                if part.ended or time.monotonic() > until:
                    raise

    def _note(self, who: str, what: str) -> None:
        self._notes.append(Note(time.monotonic_ns(), who, what))

    def _on_news(self, news: News) -> None:
        self._notes.append(Note(news.at_ns, news.who, news.text))
        self._say(f"{news.who}: {news.text}")

    def _wait(self, done: Callable[[], bool], timeout_s: float, state: str, action: str) -> None:
        """Wait for the rig; end by a TripError on a trip, a stop, or if it takes too long."""
        until = time.monotonic() + timeout_s
        self._check()
        while not done():
            if time.monotonic() > until:
                raise TripError(f"{state} after {timeout_s:g} s; {action}")
            time.sleep(POLL_S)
            self._check()

    def _check(self) -> None:
        """Show the watch that the supervisor works; raise on a trip or a stop."""
        self._watch.alive()
        if self._watch.tripped:
            raise self._tripped()
        if self._stop.requested:
            raise TripError(f"stopped by {self._stop.reason}")

    # Arming and homing

    def _segment(self, drive: Drive, **changes: Any) -> orders.Segment:
        """Return a segment that belongs to no test."""
        segment = orders.Segment(
            0,
            drive,
            self._memory(),
            self._model.parameters,
            gain=self._rig.gain_V_per_m,
            limit=self._rig.limits.command_V,
            offset_m=self._offset_m,
            valve_enable=True,
        )
        return replace(segment, **changes)

    def _switch_to(self, segment: orders.Segment) -> None:
        words = self._board.words
        number = int(words[Word.SWITCH]) + 1
        self._parts.loop.ask(replace(segment, number=number), ANSWER_S)
        words[Word.SWITCH] = number

    def _arm(self) -> None:
        wanted = {
            "pump_load": 1.0,
            "drive_target": float(DriveState.ACTIVE),
            **preparing_moves(self._rig, ()),
        }
        self.write(wanted)
        self._wait(
            lambda: not self._off(wanted), SETTLE_S,
            "pump, valve drive or bypass valves are not where they were asked to be",
            "look at them, and at what they report",
        )  # fmt: skip
        self._wait(
            lambda: np.isfinite(self.latest("position_m")), ANSWER_S,
            "no sample came", "check the I/O device",
        )  # fmt: skip
        self._handle(Event.ARM)
        self._switch_to(
            self._segment(
                Drive.HOLD, reset_lamp=True, rearm=True, reset=True, homed=self._rig.homing is None
            )
        )
        if self.latest("valve_enabled") == 0.0:
            self._say("waiting for the reset button: press it on the rig")
        self._wait(
            lambda: self.latest("valve_enabled") != 0.0, RESET_S,
            "the reset button was not pressed", "release the emergency stop and press reset",
        )  # fmt: skip
        self._handle(Event.RESET_PRESSED)

    def _home(self) -> None:
        if self._state.state is not State.NOT_HOMED:
            return
        settings = self._rig.homing
        assert settings is not None
        if not settings.before_run:
            raise TripError("the rig is not homed; set `homing: {before_run: true}`")
        self._handle(Event.HOME)
        self._say(f"homing: {settings.end} at {settings.command:g} V")
        homing = Homing(settings, self._model.parameters, self._rig.sensors.position_resolution)
        command_V, phase = 0.0, Phase.DONE  # noqa: N806
        while True:
            self._check()
            try:
                command_V = homing.next_command(self._homing_sample())  # noqa: N806
            except HomingError as error:
                self._handle(Event.HOMING_FAILED)
                raise TripError(f"homing failed: {error}") from error
            if homing.offset_m is not None:
                break
            if homing.phase is not phase:
                phase = homing.phase
                ticks = round(settings.timeout / TICK)
                self._switch_to(
                    self._segment(
                        Drive.TRACK,
                        open_loop=True,
                        setpoint=np.full(ticks, command_V),
                        limit=abs(command_V),
                    )
                )
            time.sleep(0.02)
        self._offset_m = homing.offset_m
        self._come_within_limits()
        self._switch_to(self._segment(Drive.HOLD, homed=True))
        self._wait(
            lambda: bool(self._board.words[Word.HOMED]), ANSWER_S,
            "the loop did not take the encoder's zero", "look at the session's log",
        )  # fmt: skip
        self._say(f"homed: the encoder's zero is at {1e3 * self._offset_m:.2f} mm")
        self._handle(Event.HOMED)

    def _come_within_limits(self) -> None:
        """Move a ram off its stop, as gently as it came; the limits are trusted from then on."""
        limits = self._rig.limits
        inside = np.clip(
            self.latest("position_m") + self._offset_m,
            limits.position_min_m + WITHIN_LIMITS_M,
            limits.position_max_m - WITHIN_LIMITS_M,
        )
        ticks = round(SETTLE_S / TICK)
        self._switch_to(self._segment(Drive.TRACK, setpoint=np.full(ticks, inside)))
        self._wait(
            lambda: abs(self.latest("position_m") - inside) < 0.5 * WITHIN_LIMITS_M, SETTLE_S,
            "the ram did not come off the end stop", "look at the valve and its supply",
        )  # fmt: skip

    def _homing_sample(self) -> HomingSample:
        return HomingSample(
            time.monotonic(),
            self.latest("position_m"),
            self.latest("pressure_1_Pa"),
            self.latest("pressure_2_Pa"),
        )

    # Slow outputs

    def write(self, outputs: Mapping[str, float]) -> None:
        """Set slow outputs, those that some driver has."""
        mine = {name: value for name, value in outputs.items() if name in self._outputs}
        self._parts.field.send(field.Write(mine))

    def _off(self, wanted: Mapping[str, float]) -> list[str]:
        """Return the slow outputs whose feedback is not where they were asked to be."""
        off = []
        for name, value in wanted.items():
            feedback = _FEEDBACK.get(name, name)
            if name in self._outputs and feedback in SLOW_INPUTS:
                tolerance = NEEDLE_TOLERANCE if name.endswith("_needle") else 0.0
                if not abs(self.slow(feedback) - value) <= tolerance:
                    off.append(name)
        return off

    # Tests

    def loop(self, test: CampaignTest, memory: FilterMemory, assumed: Model) -> "HardwareTest":
        """Return the loop of a test, before the ram is brought to its start."""
        ticks = round(test.duration_s / TICK)
        open_loop = test.setpoint.quantity == "command"
        segment = self._segment(
            Drive.TRACK,
            memory=memory,
            assumed=assumed.parameters,
            setpoint=np.ascontiguousarray(test.setpoint.sample(np.arange(ticks) * TICK)),
            open_loop=open_loop,
        )
        wire = WireLoop(
            self._board,
            self._parts.loop,
            segment,
            start_position=test.start_position_m,
            settle_ticks=round(test.settle_s / TICK),
            period_s=TICK,
            silence_s=self._rig.loop.loop_silence,
        )
        self._test = HardwareTest(self, wire, test)
        return self._test

    @contextmanager
    def writer(
        self, path: Path, channels: tuple[str, ...], metadata: Mapping[str, Any]
    ) -> Iterator["TestRecord"]:
        """Record the present test to a new file, by the recorder's process."""
        grants = [asdict(grant) for grant in self._grants]
        told = {**metadata, "loop": {"grants": grants, "exchange_rate_hz": self._rate_hz}}
        begin = recorder.Begin(self._test.number, path, channels, told, time.time_ns())
        self._parts.recorder.ask(begin, ANSWER_S)
        record = TestRecord(self._parts.recorder, Timing(channels, TICK))
        try:
            yield record
        finally:
            record.finish()

    def prepare(self, test: CampaignTest, segment: int) -> None:
        """Bring the bypass valves to where a test begins, and schedule its faults."""
        wanted = preparing_moves(self._rig, test.faults)
        self.write(wanted)
        self._wait(
            lambda: not self._off(wanted), SETTLE_S,
            "the bypass valves are not where the test begins", "look at them",
        )  # fmt: skip
        self._parts.field.send(field.Moves(segment, moves(self._rig, test.faults)))

    def begin(self, event: Event) -> None:
        """Ask the state machine for the next step of a test."""
        self._watch.alive()
        self._handle(event)

    def going_on(self) -> None:
        """Show the watch that the supervisor works.

        Raises:
            TripError: somebody tripped, whatever rows still come.
        """
        self._watch.alive()
        if self._watch.tripped:
            raise self._tripped()

    def end_test(self, *, completed: bool) -> None:
        """Take every fault away; bring the ram to rest unless the test came to its end."""
        if self._watch.tripped:
            return
        self.write(preparing_moves(self._rig, ()))
        if completed:
            self._handle(Event.DONE)
        else:
            self._ramp_down()

    # Ways out

    def stopped(self, error: LoopStoppedError) -> TripError:
        """Return the error for a test that the loop ended by itself."""
        if error.action is Action.TRIP or self._watch.tripped:
            return self._tripped()
        self._note("loop", str(error))
        return TripError(str(error))

    def _tripped(self) -> TripError:
        """Wait until everything is safe, report the trip, and return it as an error."""
        safe = self._watch.wait_until_safe()
        if self._state.state is not State.TRIPPED:
            self._handle(Event.TRIP)
        if not safe:
            self._note("supervisor", "not everything was made safe in time")
        if self._report is None:
            self._report = self._trip_report()
            self._reported = write_trip_report(self._report, self._directory)
        cause = self._report.first[1]
        remedy = explain(cause, self._report.concerned).remedy
        sentence = f"tripped: {self._report.sentence}; {remedy} ({self._reported})"
        return TripError(sentence, self._reported)

    def _trip_report(self) -> TripReport:
        words = self._board.words
        channel = int(words[Word.ACTION_CHANNEL])
        steps = {
            "valve null": Word.VALVE_NULL_AT,
            "bypass shut": Word.BYPASS_SHUT_AT,
            "pump unloaded": Word.PUMP_UNLOADED_AT,
        }
        return TripReport(
            trips=trips_of(self._board),
            confirmations=[Confirmation(what, int(words[at])) for what, at in steps.items()],
            notes=tuple(self._notes),
            channels=self._channels,
            rows=RingReader(self._board).latest(round(LAST_S * self._rig.loop.rate)),
            channel=FAST_INPUTS[channel] if channel >= 0 else "",
            limits=self._rig.ladder,
        )

    def _ramp_down(self) -> None:
        if self._state.state not in VALVE_ENABLED or self._state.state is State.RAMPING_DOWN:
            return
        self._handle(Event.RAMP_DOWN)
        self._board.words[Word.STOP] = Action.RAMP_DOWN
        until = time.monotonic() + STOP_S
        while time.monotonic() < until and not self._watch.tripped and not self._is_at_rest():
            self._watch.alive()
            time.sleep(POLL_S)
        if not self._watch.tripped:
            if self._is_at_rest():
                self._handle(Event.AT_REST)
            else:
                self._watch.trip(Cause.NULL_NOT_CONFIRMED)

    def _is_at_rest(self) -> bool:
        """Return whether the device shows the valve at null and disabled, as far as it can."""
        enabled, command = self.latest("valve_enabled"), self.latest("device_command_V")
        return not (enabled == 1.0 or abs(command) > NULL_V)

    def _leave(self) -> None:
        """Bring everything to its safe state, and end the processes."""
        try:
            if not self._watch.tripped:
                self._ramp_down()
            if not self._watch.tripped:
                self._make_field_safe()
            if self._watch.tripped:
                self._say(str(self._tripped()))
        finally:
            self._watch.stop()
            self._close_loop()
            self._end_parts()
            self._state.handle(Event.DISCONNECT, Conditions())

    def _make_field_safe(self) -> None:
        try:
            safety: field.Safety = self._ask(self._parts.field, field.Safe(), SETTLE_S)
        except ChildError as error:
            self._note("field", str(error))
            self._watch.trip(Cause.FIELD_LOST)
            return
        for driver, failure in safety.failures.items():
            self._say(f"{driver}: not safe: {failure}")

    def _close_loop(self) -> None:
        try:
            closed: orders.Closed = self._parts.loop.ask(orders.Close(), ANSWER_S)
        except ChildError as error:
            self._note("loop", str(error))
            return
        if closed.failure:
            self._say(f"loop: not safe: {closed.failure}")

    def _end_parts(self) -> None:
        for part in (self._parts.loop, self._parts.field, self._parts.recorder):
            part.end()
        os.close(self._board.fd)
        log = self._directory / LOG
        if log.exists() and not log.stat().st_size:
            log.unlink()
