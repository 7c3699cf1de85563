"""A CANopen node as its host sees it: is it alive, what is it doing, what do its objects hold."""

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
"""Node id of the host: the highest, so that its heartbeat yields to every device's."""

_SDO_TIMEOUT: Final = 0.5
"""s. Usual for SDO clients; a node answers within milliseconds."""


def identifiers(node: int) -> tuple[int, ...]:
    """Return the identifiers of all that a node sends."""
    return tuple(base + node for base in (EMERGENCY, TPDO1, SDO_REPLY, HEARTBEAT))


class CanopenNode:
    """One node on a bus.

    Args:
        driver: name of its driver; errors begin with it.
        link: the bus, which lets the node's `identifiers` through.
        node: its id.
        clock: returns the time in s.
        take_pdo: called with the data of every TPDO1.

    Attributes:
        state: what its last heartbeat said; None before the first.
        heard_at: when that was, in s.
        emergencies: error codes that have come in and were not taken out yet.
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
        """Take in what has come; with nothing there, wait up to so many seconds."""
        for frame in self._link.receive(wait):
            self._take(frame)

    def _take(self, frame: can.Message) -> None:
        """Sort one frame; a frame of a length that its kind does not have is dropped."""
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
        """Listen until a condition holds or so many seconds are over; return whether it held."""
        until = self._clock() + timeout
        while not condition():
            if self._clock() >= until:
                return False
            self.listen(LOOK)
        return True

    def command(self, command: NmtCommand) -> None:
        """Ask the node for a communication state."""
        self._link.send(NMT, bytes((command, self._node)))

    def beat(self) -> None:
        """Send the host's own heartbeat, which the node watches once it was asked to."""
        self._link.send(HEARTBEAT + HOST_NODE, bytes((NmtState.OPERATIONAL,)))

    def send_pdo(self, data: bytes) -> None:
        """Send the node's RPDO1."""
        self._link.send(RPDO1 + self._node, data)

    def read(self, entry: Entry) -> int:
        """Return what an entry of its object dictionary holds.

        Raises:
            DriverError: it refuses, or does not answer.
        """
        return self._transfer(entry, read_request(entry), "read")

    def write(self, entry: Entry, value: int) -> None:
        """Set an entry of the node's object dictionary.

        Raises:
            DriverError: it refuses, or does not answer.
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
