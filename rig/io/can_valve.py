"""Driver of a digital servovalve on CANopen, device profile CiA 408 (`rig.io.ds408`)."""

import struct
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, ClassVar, Final, Literal

from rig.plant.parameters import NOMINAL
from rig.plant.parameters import Quantity as _Quantity

from .can_link import LOOK, CanLink, CanOptions, Clock
from .canopen import CONSUMER_HEARTBEAT, DEVICE_TYPE, NmtCommand, NmtState, emergency_words
from .canopen_node import HOST_NODE, CanopenNode, identifiers
from .drive_walk import DriveWalk
from .driver import DriverError
from .ds408 import (
    CONTROL_MODE,
    CONTROL_WORD,
    DEVICE_MODE,
    DEVICE_PROFILE,
    HOLD_SETPOINT,
    MODE_ANALOG,
    MODE_BUS,
    SETPOINT,
    SPOOL_CLOSED_LOOP,
    STATUS_WORD,
    WALK,
    D,
    DriveState,
    to_increments,
    to_share,
)
from .ds408_pdo import COMMAND_LAYOUT, STATUS_LAYOUT, set_up

_STATUS_BITS: Final = 0b1111
_MODES: Final = {"bus": MODE_BUS, "analog": MODE_ANALOG}


@dataclass(frozen=True, kw_only=True)
class CanValveOptions(CanOptions):
    """Keys of the driver in a rig file, besides those of its bus.

    Attributes:
        node: the valve's CANopen node id.
        setpoint: where its setpoint comes from: the valve's analog input or the bus.
        full_stroke: travel of the spool at 100 %.
        open_timeout: how long `open` waits for the valve to be heard.
        step_timeout: how long one transition of its state may take, and `safe_state` as a whole.
        watchdog: silence of this host at which the valve goes to a fault; 0 for never.
    """

    node: Annotated[int, _Quantity("", 1, 126, "", "CiA 301; 127 is this host")] = 5
    setpoint: Literal["analog", "bus"] = "analog"
    full_stroke: Annotated[float, _Quantity("m", 1e-5, 1e-2, "", "10 V of table 2.1")] = (
        10.0 * NOMINAL.valve_gain
    )
    open_timeout: Annotated[float, _Quantity("s", 0.1, 60.0, "", "")] = 3.0
    step_timeout: Annotated[float, _Quantity("s", 0.05, 60.0, "", "")] = 1.0
    watchdog: Annotated[float, _Quantity("s", 0.0, 60.0, "", "")] = 1.0


class CanValve:
    """A digital servovalve.

    Outputs are `drive_target`, a `DriveState` of `rig.io.ds408.WALK`, and, if the setpoint comes by
    the bus, `drive_setpoint`, -1 to 1, which is sent as 0 until the valve is ACTIVE. Inputs are
    `drive_state`, `drive_spool_m` and the `drive_setpoint` last sent.

    The valve walks towards a target by one transition at a time, each confirmed by its status word
    while `read` is called. A fault ends the walk, and is reset by the next `write` of a target.

    Args:
        name: name in the rig file.
        options: its section there.
        clock: tells the time in s.
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
        self._link: CanLink | None = None
        self._node: CanopenNode | None = None
        self._forget()

    def _forget(self) -> None:
        """Know nothing of the valve, and ask nothing of it."""
        self._walk = DriveWalk(self._options.step_timeout, self._fault)
        self._state = DriveState.NOT_READY
        self._actual = 0
        self._setpoint = 0.0
        self._status_at = self._clock()
        self._fresh = False
        self._was_ready = False
        self._watched = False
        self._emergencies: list[int] = []

    def _error(self, state: str, action: str) -> DriverError:
        return DriverError(self.name, state, action)

    def _fault(self, state: str, action: str) -> DriverError:
        """Return the error of a valve that is there, but not where it should be."""
        return DriverError(self.name, state, action, "drive_state")

    def _connected(self) -> CanopenNode:
        if self._node is None:
            raise self._error("is not open", "open it first")
        return self._node

    def open(self) -> None:
        """Wait for the valve's heartbeat, verify that it is one, and set it up; nothing moves.

        Raises:
            DriverError: it is not heard, is no valve of CiA 408, or is ACTIVE already.
        """
        if self._node is not None:
            return
        self._forget()
        try:
            self._set_up(self._connect())
        except DriverError:
            self._drop()
            raise

    def _connect(self) -> CanopenNode:
        options = self._options
        self._link = CanLink(self.name, options, identifiers(options.node))
        self._node = CanopenNode(
            self.name, self._link, options.node, self._clock, self._take_status
        )
        return self._node

    def _set_up(self, node: CanopenNode) -> None:
        options = self._options
        if not node.wait_for(lambda: node.state is not None, options.open_timeout):
            place = self._link.place if self._link else ""
            raise self._error(
                f"node {options.node} is not heard on {place} for {options.open_timeout:g} s",
                "check power, bitrate, termination and node id",
            )
        self._require_valve(node)
        node.command(NmtCommand.PRE_OPERATIONAL)
        for entry, value in set_up(options.node, options.rate, options.silence):
            node.write(entry, value)
        node.write(DEVICE_MODE, _MODES[options.setpoint])
        node.write(CONTROL_MODE, SPOOL_CLOSED_LOOP)
        node.write(HOLD_SETPOINT, 0)
        node.command(NmtCommand.START)
        self._fresh = False
        if not node.wait_for(
            lambda: self._fresh and node.state is NmtState.OPERATIONAL, options.open_timeout
        ):
            state = f"node {options.node} does not send its status for {options.open_timeout:g} s"
            raise self._error(state, "check that its TPDO1 can be mapped (docs/can.md)")

    def _require_valve(self, node: CanopenNode) -> None:
        profile = node.read(DEVICE_TYPE) & 0xFFFF
        if profile != DEVICE_PROFILE:
            state = f"node {self._options.node} is a device of profile {profile}, not 408"
            raise self._error(state, "give the valve's node id")
        self._read_state(node)
        if self._state is DriveState.ACTIVE:
            state = f"node {self._options.node} is ACTIVE already"
            raise self._error(state, "end whatever else commands it, or switch it off and on")

    def read(self) -> Mapping[str, float]:
        """Return what has come in, send the command, and take the next step of a walk.

        Raises:
            DriverError: the valve is lost, has met a fault, left its state, or does not take a
                step in time. An emergency and a fault are raised once each; a valve that is lost,
                as long as it is.
        """
        node = self._connected()
        node.listen()
        now = self._clock()
        try:
            self._require_heard(node, now)
            self._require_healthy(node)
            self._walk.advance(self._state, now)
        finally:
            self._send(node)
        if not self._fresh:
            return {}
        self._fresh = False
        values = {
            "drive_state": float(self._state),
            "drive_spool_m": to_share(self._actual) * self._options.full_stroke,
            "drive_setpoint": self._sent_setpoint,
        }
        return {name: values[name] for name in self.inputs}

    def _require_heard(self, node: CanopenNode, now: float) -> None:
        silence, place = self._options.silence, f"node {self._options.node}"
        if now - node.heard_at > silence:
            raise self._lost(f"heartbeat of {place} lost for {now - node.heard_at:.2f} s")
        if node.state is not NmtState.OPERATIONAL:
            name = node.state.name if node.state is not None else "unknown"
            raise self._lost(f"{place} is no longer operational but in {name}: it has restarted")
        if now - self._status_at > silence:
            raise self._lost(f"status of {place} lost for {now - self._status_at:.2f} s")

    def _lost(self, state: str) -> DriverError:
        self._walk.give_up(self._state)
        return self._error(state, "check its power and cable, then open it again")

    def _require_healthy(self, node: CanopenNode) -> None:
        fell, self._was_ready = self._was_ready and not self._state.ready, self._state.ready
        codes = node.emergencies[:]
        node.emergencies.clear()
        for code in codes:
            if code:
                self._emergencies.append(code)
            else:
                self._emergencies.clear()
        if not fell and not any(codes):
            return
        self._walk.give_up(self._state)
        words = (f"emergency 0x{code:04X}, {emergency_words(code)}" for code in self._emergencies)
        state = f"is in {self._state.name}: {'; '.join(words) or 'no emergency message came'}"
        raise self._fault(state, "remove the cause; the next target asked for resets the fault")

    def write(self, outputs: Mapping[str, float]) -> None:
        """Ask for a target, a setpoint, or both; refuses without sending anything.

        Raises:
            DriverError: there is no such output or value, or the valve or its bus is lost.
        """
        node = self._connected()
        for name, value in outputs.items():
            self._check(name, value)
        self._setpoint = outputs.get("drive_setpoint", self._setpoint)
        if "drive_target" in outputs:
            target = DriveState(int(outputs["drive_target"]))
            if not self._watched:
                self._watch_host(node, self._options.watchdog)
            self._walk.ask(self._state, target, self._clock())
        self._send(node)

    def _watch_host(self, node: CanopenNode, silence: float) -> None:
        """Let the valve go to a fault when this host is silent for so many seconds; 0: never."""
        node.write(CONSUMER_HEARTBEAT, HOST_NODE << 16 | round(1e3 * silence) if silence else 0)
        self._watched = silence > 0.0

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

    def _send(self, node: CanopenNode) -> None:
        node.beat()
        if self._walk.word is not None:
            increments = to_increments(self._sent_setpoint)
            node.send_pdo(struct.pack(COMMAND_LAYOUT, self._walk.word, increments))

    def _take_status(self, data: bytes) -> None:
        """Take in a TPDO1; one of another length, or a state that there is not, is garbage."""
        if len(data) != struct.calcsize(STATUS_LAYOUT):
            return
        word, actual = struct.unpack(STATUS_LAYOUT, data)
        if self._show(word):
            self._actual, self._status_at, self._fresh = actual, self._clock(), True

    def _show(self, status_word: int) -> bool:
        """Take the state from a status word; tell whether there is such a state."""
        try:
            self._state = DriveState(status_word & _STATUS_BITS)
        except ValueError:
            return False
        return True

    def _read_state(self, node: CanopenNode) -> None:
        word = node.read(STATUS_WORD)
        if not self._show(word):
            state = f"{STATUS_WORD} is 0x{word:04X}, which is no state of CiA 408"
            raise self._error(state, "check the valve's firmware")

    def safe_state(self) -> None:
        """Let go of the spool: DISABLED with setpoint 0, or a fault state no higher than that.

        Asked for by RPDO and by SDO, so that neither a lost message nor a node that has stopped
        its PDOs can prevent it.

        Raises:
            DriverError: the valve has not confirmed it in time; names where it stands.
        """
        self._walk.disable()
        self._setpoint = 0.0
        was_open = self._node is not None
        until = self._clock() + self._options.step_timeout
        try:
            while reached := self._above_disabled():
                if self._clock() >= until:
                    state = f"DISABLED not confirmed in {self._options.step_timeout:g} s: {reached}"
                    raise self._fault(state, "take the pump's pressure and the valve's power away")
        finally:
            if not was_open:
                self._drop()

    def _above_disabled(self) -> str:
        """Ask for DISABLED; return where the valve stands instead, empty if it does not."""
        node = self._node or self._connect()
        try:
            self._send(node)
            if self._options.setpoint == "bus":
                node.write(SETPOINT, 0)
            node.write(CONTROL_WORD, D)
            self._read_state(node)
            if self._state.disabled:
                self._watch_host(node, 0.0)
                return ""
        except DriverError as error:
            self._drop()
            self._connect()
            return error.state
        node.listen(LOOK)
        return self._state.name

    def close(self) -> None:
        """Let go of the bus; a valve that was not brought to its safe state goes to a fault."""
        self._drop()

    def _drop(self) -> None:
        if self._link is not None:
            self._link.close()
        self._link = self._node = None
