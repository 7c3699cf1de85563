"""The host's connection to a digital servovalve: its state, its spool position, its commands."""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Final, Literal

from rig.io.driver import DriverError
from rig.plant import NOMINAL, Quantity as _Quantity

from . import canopen, ds408
from .canopen import Entry, NmtCommand, NmtState
from .ds408 import DriveState
from .libraries import python_can as can
from .link import LOOK, CanLink, CanOptions, Clock

HOST_NODE: Final = 127
"""Node id of the host; the highest id gives its heartbeat the lowest priority on the bus."""

_SDO_TIMEOUT: Final = 0.5
"""Longest wait in s for an SDO reply, as usual for clients; a node answers in milliseconds."""

_STATUS_BITS: Final = 0b1111
_MODES: Final = {"bus": ds408.MODE_BUS, "analog": ds408.MODE_ANALOG}


@dataclass(frozen=True, kw_only=True)
class CanValveOptions(CanOptions):
    """Keys of the driver in a rig file, besides those of its bus.

    Attributes:
        node: the valve's CANopen node id.
        setpoint: where its setpoint comes from: the valve's analog input or the bus.
        full_stroke: travel of the spool at 100 %.
        open_timeout: how long `open` waits for the valve's heartbeat, and then for its status.
        step_timeout: how long one transition of its state may take, and `safe_state` as a whole.
        watchdog: silence of this host at which the valve goes to a fault; 0 for never. It should be
            longer than the rig file's `field_silence`, so that a trip names the silent process.
    """

    node: Annotated[int, _Quantity("", 1, 126, "", "CiA 301; 127 is this host")] = 5
    setpoint: Literal["analog", "bus"] = "analog"
    full_stroke: Annotated[float, _Quantity("m", 1e-5, 1e-2, "", "10 V of table 2.1")] = (
        10.0 * NOMINAL.valve_gain
    )
    open_timeout: Annotated[float, _Quantity("s", 0.1, 60.0, "", "")] = 3.0
    step_timeout: Annotated[float, _Quantity("s", 0.05, 60.0, "", "")] = 1.0
    watchdog: Annotated[float, _Quantity("s", 0.0, 60.0, "", "")] = 2.0


class Ds408Valve:
    """A connection to one digital servovalve.

    Args:
        driver: name of the valve's driver; errors begin with it.
        options: the driver's section in the rig file.
        clock: returns the time in s.

    Attributes:
        state: the state that the valve last reported; NOT_READY before its first report.
        spool: actual spool position, as a share of full stroke.
        fresh: whether a status message has come since this was last set to False.
        watched: whether the valve goes to a fault when this host falls silent.

    Raises:
        DriverError: the bus cannot be opened.
    """

    def __init__(self, driver: str, options: CanValveOptions, clock: Clock) -> None:
        self.state = DriveState.NOT_READY
        self.spool = 0.0
        self.fresh = False
        self.watched = False
        self._driver, self._options, self._clock = driver, options, clock
        sent = canopen.EMERGENCY, canopen.TPDO1, canopen.SDO_REPLY, canopen.HEARTBEAT
        self._link = CanLink(driver, options, [base + options.node for base in sent])
        self._status_at = self._heard_at = clock()
        # Communication state in the last heartbeat; None before the first since `START` was sent.
        self._nmt_state: NmtState | None = None
        self._has_restarted = False
        self._emergencies: list[int] = []
        self._awaited: Entry | None = None
        self._reply: bytes | None = None

    def _error(self, state: str, action: str) -> DriverError:
        return DriverError(self._driver, f"node {self._options.node} {state}", action)

    def set_up(self) -> None:
        """Wait for the node, verify that it is a servovalve, and set it up; nothing moves.

        Raises:
            DriverError: its heartbeat or status does not come within `open_timeout`, it is no valve
                of CiA 408, refuses, or is ACTIVE already.
        """
        options = self._options
        if not self._wait_for(lambda: self._nmt_state is not None, options.open_timeout):
            state = f"is not heard on {options.bus} for {options.open_timeout:g} s"
            raise self._error(state, "check power, bitrate, termination and node id")
        profile = self._read(canopen.DEVICE_TYPE) & 0xFFFF
        if profile != ds408.DEVICE_PROFILE:
            state = f"is a device of profile {profile}, not {ds408.DEVICE_PROFILE}"
            raise self._error(state, "give the valve's node id")
        self._read_state()
        if self.state is DriveState.ACTIVE:
            action = "end whatever else commands it, or wait for its watchdog"
            raise self._error("is ACTIVE already", action)
        self._order(NmtCommand.PRE_OPERATIONAL)
        for entry, value in (
            *ds408.set_up(options.node, options.rate, options.silence),
            (ds408.DEVICE_MODE, _MODES[options.setpoint]),
            (ds408.CONTROL_MODE, ds408.SPOOL_CLOSED_LOOP),
            (ds408.HOLD_SETPOINT, 0),
        ):
            self._write(entry, value)
        self._order(NmtCommand.START)
        self.fresh = False
        # Heartbeats have the lowest priority: one from before `START` may come after a status
        # message from behind it. So it is waited for a heartbeat which says that the node obeyed.
        self._nmt_state = None
        if not self._wait_for(
            lambda: self.fresh and self._nmt_state is NmtState.OPERATIONAL, options.open_timeout
        ):
            state = f"does not send its status for {options.open_timeout:g} s"
            raise self._error(state, "check that its TPDO1 can be mapped (docs/can.md)")
        # A boot-up message so far is why the node was in need of being set up.
        self._has_restarted = False

    def listen(self) -> list[int]:
        """Handle the frames that have come in; return the error codes of new emergencies.

        An emergency is new if no earlier call returned it.

        Raises:
            DriverError: heartbeat or status message stay away for `silence`, the valve has sent
                its boot-up message since it was set up, or is not OPERATIONAL any more.
        """
        self._take_frames()
        now, action = self._clock(), "check its power and cable, then open it again"
        for what, at in (("heartbeat", self._heard_at), ("status", self._status_at)):
            if now - at > self._options.silence:
                raise self._error(f"is lost: no {what} for {now - at:.2f} s", action)
        # This host commands no reset, so that every boot-up message is of a restart.
        if self._has_restarted:
            raise self._error("has restarted: it has sent its boot-up message", action)
        if self._nmt_state not in (None, NmtState.OPERATIONAL):
            state = (
                f"is in {self._nmt_state.name}, not OPERATIONAL: another master commanded it so, "
                "or it has restarted and its boot-up message was not heard"
            )
            action = "end whatever else commands it, check its power and cable, then open it again"
            raise self._error(state, action)
        codes, self._emergencies = self._emergencies, []
        return codes

    def command(self, word: int | None, setpoint: float) -> None:
        """Send this host's heartbeat and, unless `word` is None, control word and setpoint.

        Raises:
            DriverError: the bus does not accept a frame.
            ValueError: the setpoint is not between -1 and 1.
        """
        self._link.send(canopen.HEARTBEAT + HOST_NODE, bytes((NmtState.OPERATIONAL,)))
        if word is not None:
            data = struct.pack(ds408.COMMAND_LAYOUT, word, ds408.to_increments(setpoint))
            self._link.send(canopen.RPDO1 + self._options.node, data)

    def watch_host(self, silence: float) -> None:
        """Make the valve go to a fault when this host's heartbeat stays away `silence` s; 0: never.

        Raises:
            DriverError: the valve refuses, or does not answer.
        """
        watched = HOST_NODE << 16 | round(1e3 * silence) if silence else 0
        self._write(canopen.CONSUMER_HEARTBEAT, watched)
        self.watched = silence > 0.0

    def disable(self) -> None:
        """Command DISABLED by PDO and by SDO, and read the state that the valve has afterwards.

        Because of the two ways, neither a lost message nor a node that has stopped its PDOs can
        prevent the command.

        Raises:
            DriverError: the valve refuses or does not answer, or its state is unknown.
        """
        self.command(ds408.D, 0.0)
        if self._options.setpoint == "bus":
            self._write(ds408.SETPOINT, 0)
        self._write(ds408.CONTROL_WORD, ds408.D)
        self._take_frames(LOOK)
        self._read_state()

    def _read_state(self) -> None:
        word = self._read(ds408.STATUS_WORD)
        if not self._show(word):
            state = f"has status word 0x{word:04X}, which is no state of CiA 408"
            raise self._error(state, "check the valve's firmware")

    def _take_status(self, data: bytes) -> None:
        """Handle a TPDO1; drop one of another length, or with an unknown state."""
        if len(data) != struct.calcsize(ds408.STATUS_LAYOUT):
            return
        word, actual = struct.unpack(ds408.STATUS_LAYOUT, data)
        if self._show(word):
            self.spool, self._status_at, self.fresh = ds408.to_share(actual), self._clock(), True

    def _show(self, status_word: int) -> bool:
        """Set `state` from a status word; return False if no known state has its bits."""
        bits = status_word & _STATUS_BITS
        known = bits in [*DriveState]
        if known:
            self.state = DriveState(bits)
        return known

    def _order(self, command: NmtCommand) -> None:
        """Send the node a command that changes its communication state; it does not answer."""
        self._link.send(canopen.NMT, bytes((command, self._options.node)))

    def _take_frames(self, wait: float = 0.0) -> None:
        """Handle the frames that have come in; if there is none, wait for up to `wait` seconds.

        A frame whose length does not fit its kind is dropped.
        """
        for frame in self._link.receive(wait):
            self._take(frame)

    def _take(self, frame: can.Message) -> None:
        data = bytes(frame.data)
        match frame.arbitration_id - self._options.node, len(data):
            case (canopen.HEARTBEAT, 1) if data[0] in [*NmtState]:
                self._nmt_state, self._heard_at = NmtState(data[0]), self._clock()
                self._has_restarted |= self._nmt_state is NmtState.BOOT_UP
            case (canopen.EMERGENCY, 8):
                self._emergencies.append(int.from_bytes(data[:2], "little"))
            case (canopen.TPDO1, _):
                self._take_status(data)
            case (canopen.SDO_REPLY, _) if self._awaited:
                if canopen.answers(data, self._awaited):
                    self._reply = data

    def _wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Handle frames until a condition holds, and return True; False after `timeout` seconds."""
        until = self._clock() + timeout
        while not condition():
            if self._clock() >= until:
                return False
            self._take_frames(LOOK)
        return True

    def _read(self, entry: Entry) -> int:
        """Return the value of an entry of the node's object dictionary, waiting for the answer."""
        return self._transfer(entry, canopen.read_request(entry), "read")

    def _write(self, entry: Entry, value: int) -> None:
        """Set an entry of the node's object dictionary, and wait until the node confirms it."""
        self._transfer(entry, canopen.write_request(entry, value), f"set to {value}")

    def _transfer(self, entry: Entry, request: bytes, what: str) -> int:
        self._awaited, self._reply = entry, None
        self._link.send(canopen.SDO_REQUEST + self._options.node, request)
        self._wait_for(lambda: self._reply is not None, _SDO_TIMEOUT)
        reply, self._awaited = self._reply, None
        try:
            if reply is None:
                raise ValueError(f"no answer for {_SDO_TIMEOUT:g} s")
            return canopen.value_of(reply, entry)
        except (canopen.SdoError, ValueError) as error:
            state = f"node {self._options.node}, {entry} cannot be {what}: {error}"
            action = "check the device's manual and its node id"
            raise DriverError(self._driver, state, action) from error

    def close(self) -> None:
        """Close the connection to the bus."""
        self._link.close()
