"""The driver of a digital servovalve on CANopen, device profile CiA 408 (`rig.io.can.ds408`)."""

import time
from collections.abc import Callable, Iterable, Mapping
from typing import ClassVar, Final, Literal

from rig.io.driver import DriverError

from .canopen import emergency_words
from .ds408 import WALK, D, DriveState, keeping_word, next_state, words_towards
from .ds408_valve import CanValveOptions, Ds408Valve
from .link import LOOK, Clock

Refuse = Callable[[str, str], Exception]
"""Makes an error from two texts: what is wrong, and what to do about it."""

_LOOK_AT: Final = "look at the valve's enable input, its supply and its error memory"


class DriveWalk:
    """The way of one valve through its states to a target state.

    A walk begins with `ask`, and ends with `give_up` or `disable`. A valve that met a fault, or
    left its target by itself, is not brought back to the target until `ask` is called again.

    Args:
        timeout: longest time in s that one transition may take.
        refuse: makes the errors that are raised.

    Attributes:
        word: the control word that the driver must send; None before the first `ask` or `disable`.
    """

    def __init__(self, timeout: float, refuse: Refuse) -> None:
        self.word: int | None = None
        self._timeout = timeout
        self._refuse = refuse
        self._target: DriveState | None = None
        self._expected: DriveState | None = None
        self._words: list[int] = []
        self._until = 0.0

    @property
    def active(self) -> bool:
        """Whether the valve has confirmed the target ACTIVE, so that setpoints may be sent."""
        return self._target is DriveState.ACTIVE and self._expected is None

    def ask(self, state: DriveState, target: DriveState, now: float) -> None:
        """Begin to walk from `state` to `target` at time `now` in s; a fault is reset on the way.

        Raises:
            Exception: made by `refuse`, if the valve reacts to a fault that it met just now.
        """
        if state is DriveState.FAULT_REACTION:
            raise self._refuse(f"is in {state.name}", "wait until it has ended")
        self._target = target
        self._go_on(state, now)

    def advance(self, state: DriveState, now: float) -> None:
        """Take the next step if `state`, which the valve reports, confirms the last one.

        Without a target, nothing is done. The caller must call `give_up` when this raises.

        Raises:
            Exception: made by `refuse`, if a step took too long, or the valve left its target by
                itself.
        """
        target, expected = self._target, self._expected
        if target is None:
            return
        if expected is None:
            if state is not target:
                raise self._refuse(f"left {target.name} for {state.name} by itself", _LOOK_AT)
        elif state is expected:
            self._go_on(state, now)
        elif now >= self._until:
            text = f"stands in {state.name}, {expected.name} wanted on the way to {target.name}"
            raise self._refuse(f"{text}, for {self._timeout:g} s", _LOOK_AT)
        elif self._words:
            self.word = self._words.pop(0)

    def give_up(self, state: DriveState) -> None:
        """End the walk, and keep the valve in `state` until another target is asked for.

        Before the first `ask` or `disable`, nothing is commanded.
        """
        self._target = self._expected = None
        if self.word is not None:
            self.word = keeping_word(state)

    def disable(self) -> None:
        """End the walk, and command DISABLED from now on."""
        self._target = self._expected = None
        self.word = D

    def _go_on(self, state: DriveState, now: float) -> None:
        """Begin the next transition, or keep the valve in `state` if that is the target."""
        assert self._target is not None
        if state is self._target:
            self._expected, self.word = None, keeping_word(state)
            return
        self._expected = next_state(state, self._target)
        self.word, *self._words = words_towards(state, self._target)
        self._until = now + self._timeout


class CanValve:
    """The driver of a digital servovalve.

    Its outputs are `drive_target`, a `DriveState` of `rig.io.can.ds408.WALK`, and, if the setpoint
    comes by the bus, `drive_setpoint`, -1 to 1, which is sent as 0 until the valve is ACTIVE. Its
    inputs are `drive_state`, `drive_spool_m` and, by the bus, the `drive_setpoint` last sent.

    The valve goes to a target state by one transition at a time. Calls of `read` take the status
    word that confirms a transition, and begin the next one. A fault ends this walk; the next
    `write` of a target resets the fault.

    Args:
        name: name of the driver in the rig file.
        options: the driver's section there.
        clock: returns the time in s.
    """

    kind: ClassVar[Literal["fast", "slow"]] = "slow"
    Options: ClassVar[type] = CanValveOptions

    def __init__(self, name: str, options: CanValveOptions, clock: Clock = time.monotonic) -> None:
        self.name = name
        self.rate_hz = options.rate
        by_bus = ("drive_setpoint",) if options.setpoint == "bus" else ()
        self.inputs = ("drive_state", "drive_spool_m", *by_bus)
        self.outputs = ("drive_target", *by_bus)
        self._options = options
        self._clock = clock
        self._valve: Ds408Valve | None = None
        self._is_open = False
        self._forget()

    def _forget(self) -> None:
        """Begin anew: without a target, with setpoint 0, and without known faults."""
        self._walk = DriveWalk(self._options.step_timeout, self._fault)
        self._setpoint = 0.0
        self._was_ready = False
        self._emergencies: list[int] = []

    def _fault(self, state: str, action: str) -> DriverError:
        """Return the error of a valve that is connected, but not in the state asked for."""
        return DriverError(self.name, state, action, "drive_state")

    def _connected(self) -> Ds408Valve:
        if self._valve is None:
            raise DriverError(self.name, "is not open", "open it first")
        return self._valve

    def _connect(self) -> Ds408Valve:
        self._valve = Ds408Valve(self.name, self._options, self._clock)
        return self._valve

    def open(self) -> None:
        """Wait for the node, verify that it is a servovalve, and set it up; nothing moves.

        If the driver is open already, nothing is done.

        Raises:
            DriverError: the bus cannot be opened, the node's heartbeat or status does not come, it
                is no valve of CiA 408, refuses its set-up, or is ACTIVE already.
        """
        if self._valve is not None:
            return
        self._forget()
        try:
            self._connect().set_up()
        except DriverError:
            self.close()
            raise
        self._is_open = True

    def read(self) -> Mapping[str, float]:
        """Take the next step of a walk, send the command, and return the values by signal, SI.

        Returns:
            The inputs; empty if no status message came since the last call.

        Raises:
            DriverError: the driver is not open, or the valve is lost, has met a fault, left its
                target by itself, or does not take a step in time. An emergency and a fault are
                raised once each. The error of a lost valve is raised at every call while it is
                lost.
        """
        valve = self._connected()
        try:
            codes = valve.listen()
            self._require_healthy(valve.state, codes)
            self._walk.advance(valve.state, self._clock())
        except DriverError:
            self._walk.give_up(valve.state)
            raise
        finally:
            self._send(valve)
        if not valve.fresh:
            return {}
        valve.fresh = False
        values = {
            "drive_state": float(valve.state),
            "drive_spool_m": valve.spool * self._options.full_stroke,
            "drive_setpoint": self._sent_setpoint,
        }
        return {name: values[name] for name in self.inputs}

    def _require_healthy(self, state: DriveState, codes: Iterable[int]) -> None:
        fell, self._was_ready = self._was_ready and not state.ready, state.ready
        is_new = False
        for code in codes:
            if code:
                self._emergencies.append(code)
                is_new = True
            else:
                self._emergencies.clear()
        if fell or is_new:
            words = [f"emergency 0x{c:04X}, {emergency_words(c)}" for c in self._emergencies]
            why = "; ".join(words) or "no emergency message came"
            action = "remove the cause; the next target asked for resets the fault"
            raise self._fault(f"is in {state.name}: {why}", action)

    def write(self, outputs: Mapping[str, float]) -> None:
        """Set a target state, a setpoint, or both; nothing is sent if a name or value is refused.

        The first target also makes the valve watch this host, for the option `watchdog`. If the
        target is refused, the setpoint stays as it was.

        Raises:
            DriverError: there is no such output or value, the driver is not open, the valve reacts
                to a fault that it met just now, or the valve or its bus is lost.
        """
        valve = self._connected()
        for name, value in outputs.items():
            self._check(name, value)
        if "drive_target" in outputs:
            if not valve.watched:
                valve.watch_host(self._options.watchdog)
            target = DriveState(int(outputs["drive_target"]))
            self._walk.ask(valve.state, target, self._clock())
        self._setpoint = outputs.get("drive_setpoint", self._setpoint)
        self._send(valve)

    def _check(self, name: str, value: float) -> None:
        if name not in self.outputs:
            action = f"write one of {', '.join(self.outputs)}"
            raise DriverError(self.name, "is not an output of this valve", action, name)
        if name == "drive_target" and value not in WALK:
            action = "ask for " + ", ".join(f"{state:d} {state.name}" for state in WALK)
            raise DriverError(self.name, f"{value:g} is no state to ask for", action, name)
        if name == "drive_setpoint" and not -1.0 <= value <= 1.0:
            action = "give a share of full stroke"
            raise DriverError(self.name, f"{value:g} is not between -1 and 1", action, name)

    @property
    def _sent_setpoint(self) -> float:
        """The setpoint as sent: 0 until the valve has confirmed that it is ACTIVE as asked."""
        return self._setpoint if self._walk.active else 0.0

    def _send(self, valve: Ds408Valve) -> None:
        valve.command(self._walk.word, self._sent_setpoint)

    def safe_state(self) -> None:
        """Bring the valve to DISABLED, or a fault state as low, so that nothing drives the spool.

        The setpoint becomes 0, and the valve no longer watches this host. After an error, also if
        the bus cannot be opened, it is tried again over a new connection until `step_timeout`.

        Raises:
            DriverError: the valve has not confirmed it in `step_timeout`; the message names the
                valve's state, or the last error.
        """
        self._walk.disable()
        self._setpoint = 0.0
        until = self._clock() + self._options.step_timeout
        try:
            while reached := self._above_disabled():
                if self._clock() >= until:
                    state = f"DISABLED not confirmed in {self._options.step_timeout:g} s: {reached}"
                    raise self._fault(state, "take the pump's pressure and the valve's power away")
        finally:
            if not self._is_open:
                self.close()

    def _above_disabled(self) -> str:
        """Command DISABLED, and return the state in which the valve is instead, or an error's text.

        The text is empty if the valve is disabled; its watchdog is then switched off, since this
        host may leave. After an error the connection is closed, and the next call makes a new one.
        """
        try:
            valve = self._valve or self._connect()
            valve.disable()
            if not valve.state.disabled:
                return valve.state.name
            valve.watch_host(0.0)
        except DriverError as error:
            self._disconnect()
            # A bus that cannot be opened fails at once.
            time.sleep(LOOK)
            return error.state
        return ""

    def close(self) -> None:
        """Close the bus; the watchdog of a valve that is not in its safe state then acts."""
        self._is_open = False
        self._disconnect()

    def _disconnect(self) -> None:
        if self._valve is not None:
            self._valve.close()
        self._valve = None
