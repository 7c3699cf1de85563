"""The host's connection to a CANopen node: its heartbeat and state, and access to its objects."""

from collections.abc import Callable
from typing import Final

from rig.io.driver import DriverError

from . import canopen
from .canopen import Entry, NmtCommand, NmtState
from .libraries import python_can as can
from .link import LOOK, CanLink, CanOptions, Clock

HOST_NODE: Final = 127
"""Node id of the host; the highest id gives its heartbeat the lowest priority on the bus."""

_SDO_TIMEOUT: Final = 0.5
"""Longest wait in s for an SDO reply, as usual for clients; a node answers in milliseconds."""


class CanopenNode:
    """One CANopen node on a bus, as its host uses it.

    Args:
        driver: name of the node's driver; errors begin with it.
        options: the bus, which is opened.
        node: the node's id.
        clock: returns the time in s.

    Attributes:
        nmt_state: communication state in the node's last heartbeat; None before the first.
        heard_at: time of the last heartbeat, s; before the first, the time at which this was made.
        emergencies: error codes that have come in and that the driver has not removed yet.

    Raises:
        DriverError: the bus cannot be opened.
    """

    def __init__(self, driver: str, options: CanOptions, node: int, clock: Clock) -> None:
        sent = canopen.EMERGENCY, canopen.TPDO1, canopen.SDO_REPLY, canopen.HEARTBEAT
        self._link = CanLink(driver, options, [base + node for base in sent])
        self.nmt_state: NmtState | None = None
        self.heard_at = clock()
        self.emergencies: list[int] = []
        self._driver, self._number, self._clock = driver, node, clock
        self._awaited: Entry | None = None
        self._reply: bytes | None = None

    def take_pdo(self, data: bytes) -> None:
        """Handle the data of a TPDO1, as the node's device profile says."""
        raise NotImplementedError

    def take_frames(self, wait: float = 0.0) -> None:
        """Handle the frames that have come in; if there is none, wait for up to `wait` seconds.

        A frame whose length does not fit its kind is dropped.
        """
        for frame in self._link.receive(wait):
            self._take(frame)

    def _take(self, frame: can.Message) -> None:
        data = bytes(frame.data)
        match frame.arbitration_id - self._number, len(data):
            case (canopen.HEARTBEAT, 1) if data[0] in [*NmtState]:
                self.nmt_state, self.heard_at = NmtState(data[0]), self._clock()
            case (canopen.EMERGENCY, 8):
                self.emergencies.append(int.from_bytes(data[:2], "little"))
            case (canopen.TPDO1, _):
                self.take_pdo(data)
            case (canopen.SDO_REPLY, _) if self._awaited:
                if canopen.answers(data, self._awaited):
                    self._reply = data

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Handle frames until a condition holds, and return True; False after `timeout` seconds."""
        until = self._clock() + timeout
        while not condition():
            if self._clock() >= until:
                return False
            self.take_frames(LOOK)
        return True

    def order(self, command: NmtCommand) -> None:
        """Send the node a command that changes its communication state; it does not answer.

        Raises:
            DriverError: the bus does not accept the frame.
        """
        self._link.send(canopen.NMT, bytes((command, self._number)))

    def beat(self) -> None:
        """Send the host's own heartbeat, which the node watches if it was set up to do so.

        Raises:
            DriverError: the bus does not accept the frame.
        """
        self._link.send(canopen.HEARTBEAT + HOST_NODE, bytes((NmtState.OPERATIONAL,)))

    def send_pdo(self, data: bytes) -> None:
        """Send the node an RPDO1 with these data, at most 8 bytes.

        Raises:
            DriverError: the bus does not accept the frame.
        """
        self._link.send(canopen.RPDO1 + self._number, data)

    def read(self, entry: Entry) -> int:
        """Return the value of an entry of the node's object dictionary, waiting for the answer.

        Raises:
            DriverError: the bus does not accept the request, or the node refuses, answers with
                another length, or does not answer in 0.5 s.
        """
        return self._transfer(entry, canopen.read_request(entry), "read")

    def write(self, entry: Entry, value: int) -> None:
        """Set an entry of the node's object dictionary, and wait until the node confirms it.

        Raises:
            DriverError: the bus does not accept the request, or the node refuses, or does not
                answer in 0.5 s.
        """
        self._transfer(entry, canopen.write_request(entry, value), f"set to {value}")

    def _transfer(self, entry: Entry, request: bytes, what: str) -> int:
        self._awaited, self._reply = entry, None
        self._link.send(canopen.SDO_REQUEST + self._number, request)
        self.wait_for(lambda: self._reply is not None, _SDO_TIMEOUT)
        reply, self._awaited = self._reply, None
        try:
            if reply is None:
                raise ValueError(f"no answer for {_SDO_TIMEOUT:g} s")
            return canopen.value_of(reply, entry)
        except (canopen.SdoError, ValueError) as error:
            state = f"node {self._number}, {entry} cannot be {what}: {error}"
            action = "check the device's manual and its node id"
            raise DriverError(self._driver, state, action) from error

    def close(self) -> None:
        """Close the connection to the bus."""
        self._link.close()
