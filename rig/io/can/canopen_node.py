"""The host's connection to a CANopen node: its heartbeat and state, and access to its objects."""

from collections.abc import Callable
from typing import Final

from rig.io.driver import DriverError

from .canopen import (
    EMERGENCY,
    HEARTBEAT,
    NMT,
    RPDO1,
    SDO_REPLY,
    SDO_REQUEST,
    TPDO1,
    Entry,
    NmtCommand,
    NmtState,
    SdoError,
    answers,
    read_request,
    value_of,
    write_request,
)
from .libraries import python_can as can
from .link import LOOK, CanLink, Clock

HOST_NODE: Final = 127
"""Node id of the host; the highest id gives its heartbeat the lowest priority on the bus."""

_SDO_TIMEOUT: Final = 0.5
"""Longest wait in s for an SDO reply, as usual for clients; a node answers in milliseconds."""


def identifiers(node: int) -> tuple[int, ...]:
    """Return the CAN identifiers of the frames that the host receives from a node."""
    return tuple(base + node for base in (EMERGENCY, TPDO1, SDO_REPLY, HEARTBEAT))


class CanopenNode:
    """One CANopen node on a bus, as its host uses it.

    Args:
        driver: name of the node's driver; errors begin with it.
        link: connection to the bus, which must receive the node's `identifiers`.
        node: the node's id.
        clock: returns the time in s.
        take_pdo: called with the data of every TPDO1.

    Attributes:
        state: communication state in the node's last heartbeat; None before the first.
        heard_at: time of the last heartbeat, s; before the first, the time at which this was made.
        emergencies: error codes that have come in and that the driver has not removed yet.
    """

    def __init__(
        self,
        driver: str,
        link: CanLink,
        node: int,
        clock: Clock,
        take_pdo: Callable[[bytes], None],
    ) -> None:
        self.state: NmtState | None = None
        self.heard_at = clock()
        self.emergencies: list[int] = []
        self._driver = driver
        self._link = link
        self._node = node
        self._clock = clock
        self._take_pdo = take_pdo
        self._awaited: Entry | None = None
        self._reply: bytes | None = None

    def listen(self, wait: float = 0.0) -> None:
        """Handle the frames that have come in; if there is none, wait for up to `wait` seconds.

        A frame whose length does not fit its kind is dropped.
        """
        for frame in self._link.receive(wait):
            self._take(frame)

    def _take(self, frame: can.Message) -> None:
        """Handle one frame by its identifier; drop one whose length does not fit its kind."""
        data = bytes(frame.data)
        match frame.arbitration_id - self._node, len(data):
            case (base, 1) if base == HEARTBEAT:
                self._take_heartbeat(data[0])
            case (base, 8) if base == EMERGENCY:
                self.emergencies.append(int.from_bytes(data[:2], "little"))
            case (base, _) if base == TPDO1:
                self._take_pdo(data)
            case (base, _) if base == SDO_REPLY and self._awaited:
                if answers(data, self._awaited):
                    self._reply = data

    def _take_heartbeat(self, state: int) -> None:
        try:
            self.state = NmtState(state)
        except ValueError:
            return
        self.heard_at = self._clock()

    def wait_for(self, condition: Callable[[], bool], timeout: float) -> bool:
        """Handle frames until a condition holds, and return True; False after `timeout` seconds."""
        until = self._clock() + timeout
        while not condition():
            if self._clock() >= until:
                return False
            self.listen(LOOK)
        return True

    def command(self, command: NmtCommand) -> None:
        """Send the node a command that changes its communication state; it does not answer.

        Raises:
            DriverError: the bus does not accept the frame.
        """
        self._link.send(NMT, bytes((command, self._node)))

    def beat(self) -> None:
        """Send the host's own heartbeat, which the node watches if it was set up to do so.

        Raises:
            DriverError: the bus does not accept the frame.
        """
        self._link.send(HEARTBEAT + HOST_NODE, bytes((NmtState.OPERATIONAL,)))

    def send_pdo(self, data: bytes) -> None:
        """Send the node an RPDO1 with these data, at most 8 bytes.

        Raises:
            DriverError: the bus does not accept the frame.
        """
        self._link.send(RPDO1 + self._node, data)

    def read(self, entry: Entry) -> int:
        """Return the value of an entry of the node's object dictionary, waiting for the answer.

        Raises:
            DriverError: the bus does not accept the request, or the node refuses, answers with
                another length, or does not answer in 0.5 s.
        """
        return self._transfer(entry, read_request(entry), "read")

    def write(self, entry: Entry, value: int) -> None:
        """Set an entry of the node's object dictionary, and wait until the node confirms it.

        Raises:
            DriverError: the bus does not accept the request, or the node refuses, or does not
                answer in 0.5 s.
        """
        self._transfer(entry, write_request(entry, value), f"set to {value}")

    def _transfer(self, entry: Entry, request: bytes, what: str) -> int:
        self._awaited, self._reply = entry, None
        self._link.send(SDO_REQUEST + self._node, request)
        self.wait_for(lambda: self._reply is not None, _SDO_TIMEOUT)
        reply, self._awaited = self._reply, None
        try:
            if reply is None:
                raise ValueError(f"no answer for {_SDO_TIMEOUT:g} s")
            return value_of(reply, entry)
        except (SdoError, ValueError) as error:
            state = f"node {self._node}, {entry} cannot be {what}: {error}"
            action = "check the device's manual and its node id"
            raise DriverError(self._driver, state, action) from error
