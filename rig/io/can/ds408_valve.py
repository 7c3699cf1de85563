"""The host's connection to a digital servovalve: its state, its spool position, its commands."""

import struct
from typing import Final

from rig.io.driver import DriverError

from .canopen import CONSUMER_HEARTBEAT, DEVICE_TYPE, NmtCommand, NmtState
from .canopen_node import HOST_NODE, CanopenNode, identifiers
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
    D,
    DriveState,
    to_increments,
    to_share,
)
from .ds408_pdo import COMMAND_LAYOUT, STATUS_LAYOUT, set_up
from .link import LOOK, CanLink, Clock
from .valve_options import CanValveOptions

_STATUS_BITS: Final = 0b1111
_MODES: Final = {"bus": MODE_BUS, "analog": MODE_ANALOG}


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
        self._driver = driver
        self._options = options
        self._clock = clock
        self._status_at = clock()
        self._link = CanLink(driver, options, identifiers(options.node))
        self._node = CanopenNode(driver, self._link, options.node, clock, self._take_status)

    def _error(self, state: str, action: str) -> DriverError:
        return DriverError(self._driver, f"node {self._options.node} {state}", action)

    def set_up(self) -> None:
        """Wait for the node, verify that it is a servovalve, and set it up; nothing moves.

        Raises:
            DriverError: its heartbeat or status does not come within `open_timeout`, it is no valve
                of CiA 408, refuses, or is ACTIVE already.
        """
        options, node = self._options, self._node
        if not node.wait_for(lambda: node.state is not None, options.open_timeout):
            state = f"is not heard on {self._link.place} for {options.open_timeout:g} s"
            raise self._error(state, "check power, bitrate, termination and node id")
        self._verify()
        node.command(NmtCommand.PRE_OPERATIONAL)
        for entry, value in set_up(options.node, options.rate, options.silence):
            node.write(entry, value)
        node.write(DEVICE_MODE, _MODES[options.setpoint])
        node.write(CONTROL_MODE, SPOOL_CLOSED_LOOP)
        node.write(HOLD_SETPOINT, 0)
        node.command(NmtCommand.START)
        self.fresh = False
        if not node.wait_for(
            lambda: self.fresh and node.state is NmtState.OPERATIONAL, options.open_timeout
        ):
            state = f"does not send its status for {options.open_timeout:g} s"
            raise self._error(state, "check that its TPDO1 can be mapped (docs/can.md)")

    def _verify(self) -> None:
        profile = self._node.read(DEVICE_TYPE) & 0xFFFF
        if profile != DEVICE_PROFILE:
            state = f"is a device of profile {profile}, not {DEVICE_PROFILE}"
            raise self._error(state, "give the valve's node id")
        self._read_state()
        if self.state is DriveState.ACTIVE:
            action = "end whatever else commands it, or wait for its watchdog"
            raise self._error("is ACTIVE already", action)

    def listen(self) -> list[int]:
        """Handle the frames that have come in; return the error codes of the valve's emergencies.

        Raises:
            DriverError: heartbeat or status message stay away for `silence`, or the valve has
                restarted.
        """
        self._node.listen()
        self._require_heard(self._clock())
        codes = self._node.emergencies[:]
        self._node.emergencies.clear()
        return codes

    def _require_heard(self, now: float) -> None:
        action = "check its power and cable, then open it again"
        for what, at in (("heartbeat", self._node.heard_at), ("status", self._status_at)):
            if now - at > self._options.silence:
                raise self._error(f"is lost: no {what} for {now - at:.2f} s", action)
        state = self._node.state
        if state not in (None, NmtState.OPERATIONAL):
            raise self._error(f"has restarted: it is in {state.name}, not OPERATIONAL", action)

    def command(self, word: int | None, setpoint: float) -> None:
        """Send this host's heartbeat and, unless `word` is None, control word and setpoint.

        Raises:
            DriverError: the bus does not accept a frame.
            ValueError: the setpoint is not between -1 and 1.
        """
        self._node.beat()
        if word is not None:
            self._node.send_pdo(struct.pack(COMMAND_LAYOUT, word, to_increments(setpoint)))

    def watch_host(self, silence: float) -> None:
        """Make the valve go to a fault when this host's heartbeat stays away `silence` s; 0: never.

        Raises:
            DriverError: the valve refuses, or does not answer.
        """
        watched = HOST_NODE << 16 | round(1e3 * silence) if silence else 0
        self._node.write(CONSUMER_HEARTBEAT, watched)
        self.watched = silence > 0.0

    def disable(self) -> None:
        """Command DISABLED by PDO and by SDO, and read the state that the valve has afterwards.

        Because of the two ways, neither a lost message nor a node that has stopped its PDOs can
        prevent the command.

        Raises:
            DriverError: the valve refuses or does not answer, or its state is unknown.
        """
        self.command(D, 0.0)
        if self._options.setpoint == "bus":
            self._node.write(SETPOINT, 0)
        self._node.write(CONTROL_WORD, D)
        self._node.listen(LOOK)
        self._read_state()

    def _read_state(self) -> None:
        word = self._node.read(STATUS_WORD)
        if not self._show(word):
            state = f"has status word 0x{word:04X}, which is no state of CiA 408"
            raise self._error(state, "check the valve's firmware")

    def _take_status(self, data: bytes) -> None:
        """Handle a TPDO1; drop one of another length, or with an unknown state."""
        if len(data) != struct.calcsize(STATUS_LAYOUT):
            return
        word, actual = struct.unpack(STATUS_LAYOUT, data)
        if self._show(word):
            self.spool, self._status_at, self.fresh = to_share(actual), self._clock(), True

    def _show(self, status_word: int) -> bool:
        """Set `state` from a status word; return False if no known state has its bits."""
        try:
            self.state = DriveState(status_word & _STATUS_BITS)
        except ValueError:
            return False
        return True

    def close(self) -> None:
        """Close the connection to the bus."""
        self._link.close()
