"""The emulated digital servovalve: CANopen, device profile CiA 408, and its faults.

It is driven by two calls, `receive` for every frame and `cycle` for the time, so that a test can
step it; `rig.emulator.can.nodes.serve` makes these calls on a bus.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

from rig.io import DriveState, canopen, ds408, python_can as can

from .nodes import Note, Send
from .object_dictionary import ObjectDictionary

HOST_HEARTBEAT_LOST: Final = 0x8130
"""Emergency code of a node whose host's heartbeat stays away (CiA 301, section 7.2.7)."""

_OBEYING: Final[dict[int, canopen.NmtState]] = {
    canopen.NmtCommand.START: canopen.NmtState.OPERATIONAL,
    canopen.NmtCommand.STOP: canopen.NmtState.STOPPED,
    canopen.NmtCommand.PRE_OPERATIONAL: canopen.NmtState.PRE_OPERATIONAL,
}
"""State of communication to which a master's command brings the node."""

_GARBAGE: Final = (b"", b"\xff\xff", b"\x05\x00\x00\x00", bytes(range(8)))
"""Data that no TPDO1 has: some have a wrong length, one has a state that does not exist."""


@dataclass
class ValveFaults:
    """The faults of the emulated valve of which its own electronics do not know.

    Attributes:
        silent: the valve sends nothing at all.
        heartbeat_lost: the valve sends no heartbeat.
        stuck: the valve's state follows no control word.
        frozen_actual: the actual value that the valve reports does not change.
        garbage: before each status message the valve sends nonsense under the same identifier.
    """

    silent: bool = False
    heartbeat_lost: bool = False
    stuck: bool = False
    frozen_actual: bool = False
    garbage: bool = False


class ValveNode:
    """An emulated digital servovalve.

    Args:
        send: puts a frame on the bus.
        spool: returns the spool's position, m.
        full_stroke: travel of the spool at 100 %, m.
        node: node id of the valve.
        note: takes note of what the valve receives and does; a repeated command is noted once.

    Attributes:
        faults: faults of which the electronics do not know.
        state: state of the electronics.
    """

    def __init__(
        self, send: Send, spool: Callable[[], float], full_stroke: float, node: int, note: Note
    ) -> None:
        self.faults = ValveFaults()
        self.state = DriveState.INIT
        self._send_frame = send
        self._spool = spool
        self._full_stroke = full_stroke
        self._node = node
        self._note = note
        self._now = 0.0
        self._frozen_at = 0
        self._switch_on()

    def _switch_on(self) -> None:
        self._nmt = canopen.NmtState.BOOT_UP
        self._objects = ObjectDictionary(
            (
                (ds408.CONTROL_WORD, 0),
                (ds408.DEVICE_MODE, ds408.MODE_BUS),
                (ds408.CONTROL_MODE, ds408.SPOOL_CLOSED_LOOP),
                (ds408.SETPOINT, 0),
                (ds408.HOLD_SETPOINT, 0),
                (canopen.CONSUMER_HEARTBEAT, 0),
                *ds408.set_up(self._node, rate_hz=20.0, silence=0.4),
            ),
            (
                (canopen.DEVICE_TYPE, lambda: ds408.DEVICE_PROFILE),
                (ds408.STATUS_WORD, lambda: int(self.state)),
                (ds408.ACTUAL, self._actual),
            ),
            self._object_set,
        )
        self._word = 0
        self._host_at: float | None = None
        self._beat_at = self._status_at = self._now
        self._become(DriveState.INIT)

    def acting_command(self, analog: float) -> float:
        """Return the command that moves the spool, given that of the analog input.

        Both are shares of full stroke. In ACTIVE the setpoint of the bus or the analog input acts,
        as the device mode says; in HOLD and FAULT_HOLD the hold setpoint acts. A spool that nothing
        controls goes to null, which is the fail-safe position of this valve.
        """
        if self.state.disabled:
            return 0.0
        if self.state is not DriveState.ACTIVE:
            return ds408.to_share(self._objects[ds408.HOLD_SETPOINT])
        if self._objects[ds408.DEVICE_MODE] == ds408.MODE_ANALOG:
            return analog
        return ds408.to_share(self._objects[ds408.SETPOINT])

    def fail(self, code: int) -> None:
        """Meet a fault: send an emergency with its code, and go to a fault state unless in one."""
        self._note("drive_fault", code=f"0x{code:04X}")
        self._send(canopen.EMERGENCY, struct.pack("<HB5x", code, 1))
        self._become(ds408.after_fault(self.state))

    def receive(self, frame: can.Message) -> None:
        """Handle a frame from the bus; one that is not for this node does nothing."""
        data = bytes(frame.data)
        if frame.is_extended_id:
            return
        identifier = frame.arbitration_id
        operational = self._nmt is canopen.NmtState.OPERATIONAL
        if identifier == canopen.NMT and len(data) == 2 and data[1] in (0, self._node):
            self._obey(data[0])
        elif identifier == canopen.SDO_REQUEST + self._node:
            reply = self._objects.answer(data)
            if reply is not None:
                self._send(canopen.SDO_REPLY, reply)
        elif identifier == canopen.RPDO1 + self._node and operational:
            self._take_command(data)
        elif identifier - canopen.HEARTBEAT == self._objects[canopen.CONSUMER_HEARTBEAT] >> 16:
            self._host_at = self._now

    def _obey(self, command: int) -> None:
        self._note("drive_nmt", command=command)
        if command in (canopen.NmtCommand.RESET_NODE, canopen.NmtCommand.RESET_COMMUNICATION):
            self._switch_on()
        else:
            self._nmt = _OBEYING.get(command, self._nmt)

    def _take_command(self, data: bytes) -> None:
        if len(data) != struct.calcsize(ds408.COMMAND_LAYOUT):
            return
        word, setpoint = struct.unpack(ds408.COMMAND_LAYOUT, data)
        if (word, setpoint) != (self._word, self._objects[ds408.SETPOINT]):
            self._note("drive_command", word=word, setpoint=ds408.to_share(setpoint))
        self._objects[ds408.SETPOINT] = setpoint
        self._take_word(word)

    def _object_set(self, entry: canopen.Entry, value: int) -> None:
        self._note("drive_object_set", object=str(entry), value=value)
        if entry == ds408.CONTROL_WORD:
            self._take_word(value)
        elif entry == canopen.CONSUMER_HEARTBEAT:
            # The heartbeat is watched from the first one that comes (CiA 301, section 7.2.8).
            self._host_at = None

    def _take_word(self, word: int) -> None:
        previous, self._word = self._word, word
        self._objects[ds408.CONTROL_WORD] = word
        self._follow(previous)

    def _follow(self, previous_word: int) -> None:
        """Make the transition that the control word asks for, if any; a stuck valve makes none.

        At most one is made, and the next follows in the next cycle. `previous_word` is the control
        word before this one, which tells whether a bit has risen.
        """
        if not self.faults.stuck:
            self._become(ds408.after_word(self.state, self._word, previous_word))

    def _become(self, state: DriveState) -> None:
        if state is self.state:
            return
        reset = state.ready and not self.state.ready
        self.state = state
        self._note("drive_state", state=state.name)
        if reset:
            self._send(canopen.EMERGENCY, bytes(8))

    def cycle(self, now: float) -> None:
        """Make a transition if asked, watch the host, and send what is due at `now` in s."""
        self._now = now
        self._follow(self._word)
        self._watch_host()
        if now >= self._beat_at:
            self._beat_at = now + 1e-3 * self._objects[canopen.PRODUCER_HEARTBEAT]
            if not self.faults.heartbeat_lost:
                self._send(canopen.HEARTBEAT, bytes((self._nmt,)))
            if self._nmt is canopen.NmtState.BOOT_UP:
                self._nmt = canopen.NmtState.PRE_OPERATIONAL
        if self._nmt is canopen.NmtState.OPERATIONAL and now >= self._status_at:
            self._status_at = now + 1e-3 * self._objects[ds408.TPDO1_PERIOD]
            for data in _GARBAGE if self.faults.garbage else ():
                self._send(canopen.TPDO1, data)
            self._send(canopen.TPDO1, struct.pack(ds408.STATUS_LAYOUT, self.state, self._actual()))

    def _watch_host(self) -> None:
        allowed = 1e-3 * (self._objects[canopen.CONSUMER_HEARTBEAT] & 0xFFFF)
        if self._host_at is not None and allowed and self._now - self._host_at > allowed:
            self._host_at = None
            self.fail(HOST_HEARTBEAT_LOST)

    def _actual(self) -> int:
        if not self.faults.frozen_actual:
            share = self._spool() / self._full_stroke
            self._frozen_at = round(ds408.FULL_SCALE * min(max(share, -2.0), 1.999))
        return self._frozen_at

    def _send(self, base: int, data: bytes) -> None:
        if not self.faults.silent:
            identifier = base + self._node
            self._send_frame(
                can.Message(arbitration_id=identifier, data=data, is_extended_id=False)
            )
