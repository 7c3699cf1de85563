"""A rig to which a session is connected, with its processes, its board and its state machine."""

import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, Final, Protocol

from estimator.filters import start_memory
from rig.compile_cache import telling_of_compiling
from rig.configuration import Rig
from rig.io import SLOW_INPUTS, calibration_doubts, today
from rig.loop import (
    NO_CHANNEL,
    NULL_V,
    Action,
    Board,
    Cause,
    Drive,
    LoopStoppedError,
    RingReader,
    StopRequestedError,
    TripError,
    WireLoop,
    Word,
    explain,
    orders,
    wire_channels,
)
from rig.plant import TICK, Model
from rig.reserves import Reserve
from rig.supervisor.processes import (
    FIELD_WAIT_S,
    Child,
    ChildError,
    MakeSafe,
    Onlooker,
    Parts,
    SafetyThread,
    WriteOutputs,
    loop_channel,
)

from .checks import checks_for
from .holding import held
from .opening import opened
from .states import VALVE_ENABLED, Conditions, Event, IllegalTransition, State, next_state
from .trip_report import EventLog, last_known

ANSWER_S: Final = 10.0
SAFE_S: Final = 20.0
"""Time in s within which slow drivers must reach their safe state."""
STOP_S: Final = 5.0
"""Time in s within which the motion must come to rest."""
POLL_S: Final = 0.01
SHOWN_ROWS: Final = 20
SHOWN_S: Final = 0.2
"""At the end, `SHOWN_ROWS` more rows show the safe state to viewers, within `SHOWN_S` seconds."""
RECENT_S: Final = 0.25
"""Greatest age in s of a value that `ConnectedRig.latest` returns."""
NEEDLE_TOLERANCE: Final = 0.02
"""Fraction of its stroke by which a needle may be off; its driver has the same tolerance."""
LOG: Final = "session.log"
"""File in the run's folder that takes the processes' stderr; it is removed if it stays empty."""

_FEEDBACK: Final = {"drive_target": "drive_state", "pump_load": "pump_loaded"}
"""Slow output -> slow input that is its feedback, where their names differ."""


class Stop(Protocol):
    """A flag by which somebody asks for the end; see `rig.runner.campaign.stopping.StopFlag`."""

    @property
    def requested(self) -> bool:
        """Whether somebody asked for the end of the session."""

    @property
    def reason(self) -> str:
        """Who or what asked for the end, as in "stopped by ..."; empty before anybody did."""


class ConnectedRig:
    """A rig on hardware, connected from `connect` to `leave`, for the supervisor's main thread.

    Args:
        rig: the rig's configuration, with its drivers.
        filter_name: the filter that the loop runs.
        model: the model that the filter assumes.
        directory: folder of the run, in which a trip report is written.
        stop: the flag by which somebody asks for the end.
        say: shows a line to the operator.
        onlooker: is called with the board and its channels as it connects, and with each state.
        journal: is called with a sentence when another master drives a part of the rig.

    Attributes:
        configured: the rig's configuration.
        model: the model that the filter assumes.
        state: the present state of the session; OFF at first.
        offset_m: offset in m that is added to the encoder's position; 0 before homing.
        board: the memory that all processes share; it exists once connected.
        event_log: the log of the session, from which a trip report is made.
        note: `note(who, what)` records for a trip report who did what at the present time.
        parts: the processes; they exist once connected.
        safety: the safety thread; it exists once connected.
        opened: the loop's answer to the order to open the fast device.
    """

    board: Board
    parts: Parts
    safety: SafetyThread
    opened: orders.Opened
    _checks = staticmethod(checks_for)

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
        self.configured = rig
        self.model = model
        self.say = say
        self._onlooker = onlooker or Onlooker()
        self.event_log = EventLog(rig, directory, say, journal)
        self.note = self.event_log.note
        self.offset_m = 0.0
        self._memory = lambda: start_memory(filter_name, model, rig.sensors)
        self._directory = directory
        self._stop = stop
        self.state = State.OFF
        self._outputs = {output for spec in rig.drivers for output in spec.outputs}
        self._devices, self._reserve = ExitStack(), Reserve()
        self._indicated = (0, NO_CHANNEL)

    def connect(self) -> None:
        """Start the processes and the safety thread, open and verify every device; move nothing.

        The operator is told which calibrations of transducers do not hold today. The state is
        DISARMED then. After an error all has ended again, and the state is OFF.

        Raises:
            DriverError: a device is in use, does not answer, or is not the configured one.
            TripError: a process ended or took too long, or somebody asked for the end.
        """
        self._heed_stop()
        for doubt in calibration_doubts(self.configured.calibrations, today()):
            self.say(f"warning: {doubt}")
            self.note("calibrations", doubt)
        holding = held(self.configured, self._reserve, self._onlooker.errand, self._heed_stop)
        kept = self._devices.enter_context(holding)
        self.handle(Event.CONNECT)
        self._channels = wire_channels(self._memory().filter.states, open_loop=False)
        self.board = Board.create(len(self._channels))
        heard = self.event_log.take
        self.parts = Parts.start(self.board, self._directory / LOG, heard, kept)
        self.safety = SafetyThread(
            self.board, self.parts, self.configured, self.note, heard, self._reserve
        )
        try:
            self._onlooker.connects(self.board, self._channels)
            self._open()
            self._devices.enter_context(telling_of_compiling(self._compiles))
            self._heed_stop()
            self.safety.start()
        except BaseException:
            self.handle(Event.CONNECTION_FAILED)
            self._end_parts()
            raise
        self.handle(Event.CONNECTED)

    def _open(self) -> None:
        first = orders.Segment(1, Drive.NULL, self._memory(), self.model.parameters, homed=False)
        self.board.words[Word.SWITCH] = first.number
        checks = partial(self._checks, self.configured, self.model)
        self.opened = opened(
            self.configured, self.parts, first, checks, self._heed_stop, self._onlooker
        )
        grants = self.opened.grants
        given = ", ".join(grant.name for grant in grants if grant.granted) or "nothing granted"
        self.say(f"loop: {self.opened.rate_hz:g} exchanges a second; {given}")
        for lack in (grant for grant in grants if not grant.granted):
            self.say(f"loop: runs without {lack.name} ({lack.why}); to get it: {lack.remedy}")

    def _heed_stop(self) -> None:
        """Raise `StopRequestedError` if somebody asked for the end."""
        if self._stop.requested:
            raise StopRequestedError(f"stopped by {self._stop.reason}")

    def handle(self, event: Event) -> None:
        """Note an event, go to the state that follows on it, and tell the onlooker of that state.

        Raises:
            TripError: the state machine refuses the event; after a trip it is that of `tripped`.
        """
        self.note("session", event.value)
        try:
            self.state = next_state(self.state, event, self._conditions())
        except IllegalTransition as refused:
            if self.safety.tripped:
                raise self.tripped() from None
            raise TripError(str(refused)) from None
        self._onlooker.came_to(self.state.value)

    def _conditions(self) -> Conditions:
        if self.state in (State.OFF, State.CONNECTING):
            return Conditions()
        words = self.board.words
        stands = Action(int(words[Word.ACTION])) >= Action.HOLD
        # A missing reading is NaN, which differs from 0, so it forbids nothing.
        return Conditions(
            estop_closed=self.latest("estop_closed") != 0.0,
            valve_enabled=self.latest("valve_enabled") != 0.0,
            homed=bool(words[Word.HOMED]),
            standing=explain(Cause(int(words[Word.ACTION_CAUSE]))).sentence if stands else "",
        )

    def latest(self, channel: str) -> float:
        """Return the last finite value of a column of the rows of the last 0.25 s; NaN if none."""
        values = RingReader(self.board).latest(round(RECENT_S * self.configured.loop.rate))
        return last_known(values[:, self._channels.index(channel)])

    def slow(self, channel: str) -> float:
        """Return a slow channel's newest value, of any age; NaN if none or the last read failed."""
        return float(self.board.slow[SLOW_INPUTS.index(channel)])

    def ask(self, part: Child, order: object, timeout_s: float) -> Any:
        """Send an order to a part and await its answer; show meanwhile that the supervisor works.

        Raises:
            ChildError: the part has ended, did not answer in time, or its answer cannot be read. An
                answer that is an exception is raised too.
        """
        self.safety.alive()
        return part.ask_patiently(order, timeout_s, 1.0, self.safety.alive)

    def _compiles(self, name: str) -> None:
        """Report that a function is compiled during the session, which delays the supervisor."""
        self.note("supervisor", f"compiles {name}")
        self.say(f"supervisor: compiles {name}, which was to be done before; report this")

    def wait(self, done: Callable[[], bool], timeout_s: float, state: str, action: str) -> None:
        """Wait until `done` returns True. A timeout alone does not trip the rig.

        Raises:
            TripError: it takes longer than `timeout_s`; the message joins the phrases `state` (what
                is wrong then) and `action` (the remedy). Or the rig tripped or was stopped.
        """
        until = time.monotonic() + timeout_s
        self.check()
        while not done():
            if time.monotonic() > until:
                raise TripError(f"{state} after {timeout_s:g} s; {action}")
            time.sleep(POLL_S)
            self.check()

    def check(self) -> None:
        """Raise if the rig has tripped or is to stop; show the safety thread a sign of life.

        The main thread must call this, `going_on` or `alive` at least every 5 s.

        Raises:
            TripError: the rig has tripped, or somebody asked for the end (`StopRequestedError`).
        """
        self.going_on()
        self._heed_stop()

    def going_on(self) -> None:
        """Do as `check`, but go on if somebody asked for the end.

        Raises:
            TripError: a part has tripped, even if rows still come.
        """
        self.alive()
        if self.safety.tripped:
            raise self.tripped()

    def segment(self, drive: Drive, **changes: Any) -> orders.Segment:
        """Return a segment with number 0 and this rig's usual fields, with `changes` to these."""
        segment = orders.Segment(
            0,
            drive,
            self._memory(),
            self.model.parameters,
            gain=self.configured.gain_V_per_m,
            limit=self.configured.limits.command_V,
            offset_m=self.offset_m,
            valve_enable=True,
        )
        return replace(segment, **changes)

    def switch_to(self, drive: Drive, **changes: Any) -> None:
        """Send the loop a segment (see `segment`), wait until it is ready, and order the switch.

        The switch itself, at the loop's next tick, is not awaited.

        Raises:
            TripError: the loop's process or thread has ended, or did not answer within `ANSWER_S`.
        """
        words = self.board.words
        number = int(words[Word.SWITCH]) + 1
        self.parts.loop.ask(self.segment(drive, number=number, **changes), ANSWER_S)
        words[Word.SWITCH] = number

    def tracking(self, start_position: float, settle_s: float, **changes: Any) -> WireLoop:
        """Return the object that steps through a motion which tracks a setpoint; move nothing yet.

        Args:
            start_position: position in m to which the ram is brought before the setpoint begins.
            settle_s: time in s in which the ram is brought there.
            **changes: the setpoint, and other fields of `orders.Segment` with unusual values.
        """
        return WireLoop(
            self.board,
            self.parts.loop,
            self.segment(Drive.TRACK, **changes),
            start_position=start_position,
            settle_ticks=round(settle_s / TICK),
            silence_s=self.configured.loop.loop_silence,
        )

    def write(self, outputs: Mapping[str, float]) -> None:
        """Order slow outputs, SI, to be set, without waiting; ignore those that no driver has."""
        mine = {name: value for name, value in outputs.items() if name in self._outputs}
        self.parts.field.send(WriteOutputs(mine))

    def off(self, wanted: Mapping[str, float]) -> list[str]:
        """Return the names of those slow outputs whose newest feedback is not at the wanted value.

        NaN counts as a difference. Needles may be off by `NEEDLE_TOLERANCE`. Outputs without a
        driver or a feedback channel are left out.

        Args:
            wanted: slow output -> wanted value, SI.
        """
        off = []
        for name, value in wanted.items():
            feedback = _FEEDBACK.get(name, name)
            if name in self._outputs and feedback in SLOW_INPUTS:
                tolerance = NEEDLE_TOLERANCE if name.endswith("_needle") else 0.0
                if not abs(self.slow(feedback) - value) <= tolerance:
                    off.append(name)
        return off

    def tripped(self, wait_s: float = 2.0 * FIELD_WAIT_S) -> TripError:
        """Wait up to `wait_s` until a rig that tripped is safe; return the error to raise.

        The state becomes TRIPPED. The first call writes the trip report.
        """
        if not self.safety.wait_until_safe(wait_s):
            self.note("supervisor", "not everything was made safe in time")
        if self.state is not State.TRIPPED:
            self.handle(Event.TRIP)
        return self.event_log.tripped(self.board, self._channels, self.safety.made_safe)

    @contextmanager
    def reporting_stops(self) -> Iterator[None]:
        """Turn a `LoopStoppedError` of the block, a motion that the loop ended, into a `TripError`.

        If the rig has tripped, it is the error of `tripped`; any other stop is noted.
        """
        try:
            yield
        except LoopStoppedError as error:
            if error.action is Action.TRIP or self.safety.tripped:
                raise self.tripped() from None
            self.note("loop", str(error))
            raise TripError(str(error)) from None

    def alive(self) -> None:
        """Show the safety thread that the supervisor works; never raise for a trip or a stop.

        If the loop indicates another cause than at the last call, the operator is shown it.
        """
        self.safety.alive()
        words = self.board.words
        indicated = int(words[Word.ACTION_CAUSE]), int(words[Word.ACTION_CHANNEL])
        if words[Word.ACTION] != Action.INDICATE or indicated == self._indicated:
            return
        self._indicated = indicated
        sentence, remedy = explain(Cause(indicated[0]), loop_channel(self.board))
        self.note("loop", sentence)
        self.say(f"loop: {sentence}; {remedy}")

    def ramp_down(self) -> None:
        """Bring the motion to rest, wait until the valve is disabled, and become DISARMED.

        If that takes over `STOP_S`, trip. In states with a disabled valve, or RAMPING_DOWN, nothing
        is done, except that ARMING becomes DISARMED.
        """
        if self.state is State.ARMING:
            self.handle(Event.DISARM)
        if self.state not in VALVE_ENABLED or self.state is State.RAMPING_DOWN:
            return
        self.handle(Event.RAMP_DOWN)
        self.board.words[Word.STOP] = Action.RAMP_DOWN
        until = time.monotonic() + STOP_S
        while time.monotonic() < until and not self.safety.tripped and not self._is_at_rest():
            self.safety.alive()
            time.sleep(POLL_S)
        if not self.safety.tripped:
            if self._is_at_rest():
                self.handle(Event.AT_REST)
            else:
                self.safety.trip(Cause.NULL_NOT_CONFIRMED)

    def _is_at_rest(self) -> bool:
        """Return whether no reading contradicts that the valve is at null and disabled."""
        enabled, command = self.latest("valve_enabled"), self.latest("device_command_V")
        return not (enabled == 1.0 or abs(command) > NULL_V)

    def leave(self) -> None:
        """Bring everything to its safe state, and end the processes.

        Raises:
            TripError: a trip was not reported yet, or nothing tripped but a device is not safe.
        """
        ended: TripError | None = None
        unsafe: dict[str, str] = {}
        try:
            if not self.safety.tripped:
                self.ramp_down()
            if not self.safety.tripped:
                unsafe |= self.make_field_safe()
            if self.safety.tripped and self.event_log.report is None:
                ended = self.tripped()
        finally:
            with self.safety.standing_down(self._end_parts):
                unsafe |= self._close_loop()
                # On a busy machine a part may have tripped since, or an error may have come before.
                if self.safety.tripped and self.event_log.report is None:
                    ended = self.tripped()
            self.event_log.complete_report()
        self.handle(Event.DISCONNECT)
        line = "; ".join(f"{part}: not safe: {failure}" for part, failure in unsafe.items())
        if line and self.safety.tripped:
            # The error of the trip, which came first, is not replaced by this one.
            self.say(line)
        elif line:
            ended = TripError(f"{line}; look at the rig before going near it")
        if ended is not None:
            raise ended

    def make_field_safe(self) -> Mapping[str, str]:
        """Bring the slow drivers to their safe state; return driver -> failure for unsafe ones.

        The loop goes on for some rows. If the field process does not answer, trip and return {}.
        """
        try:
            failures: Mapping[str, str] = self.ask(self.parts.field, MakeSafe(), SAFE_S)
        except ChildError as error:
            self.note("field", str(error))
            self.safety.trip(Cause.FIELD_LOST)
            return {}
        # Some more rows show viewers the safe state before the loop ends.
        enough = int(self.board.words[Word.ROWS]) + SHOWN_ROWS
        until = time.monotonic() + SHOWN_S
        while self.board.words[Word.ROWS] < enough and time.monotonic() < until:
            self.safety.alive()
            time.sleep(POLL_S)
        return failures

    def _close_loop(self) -> Mapping[str, str]:
        """Make the loop close its device; return "loop" -> failure if it is not safe, else {}.

        If the loop's process does not answer, that is noted and {} is returned.
        """
        try:
            closed = self.parts.loop.last_answer(orders.Close(), orders.Closed, ANSWER_S)
        except ChildError as error:
            self.note("loop", str(error))
            return {}
        return {"loop": closed.failure} if closed.failure else {}

    def _end_parts(self) -> None:
        self._reserve.release()
        for part in (self.parts.loop, self.parts.field, self.parts.recorder):
            part.end()
        os.close(self.board.fd)
        self._devices.close()
        log = self._directory / LOG
        if log.exists() and not log.stat().st_size:
            log.unlink()
