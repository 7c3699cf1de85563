"""CiA 408, the CANopen profile of digital servovalves: states, words, objects, scaling, messages.

The driver and the emulated valve share this module, which talks to no device. CiA sells the
profile; this module was checked against the manual of a valve that follows it: Moog ACV with
CANopen interface, B99224-DV018-D-211, 2018. Its sections are cited, such as 5.2.2 on state
transitions.
"""

from collections.abc import Iterator
from enum import IntEnum
from typing import Final, NamedTuple

from . import canopen
from .canopen import Entry

DEVICE_PROFILE: Final = 408
"""Number of this profile, the low 16 bits of object 0x1000, device type (section 4.1.1)."""

CONTROL_WORD: Final = Entry(0x6040, 0, "<H")
STATUS_WORD: Final = Entry(0x6041, 0, "<H")
DEVICE_MODE: Final = Entry(0x6042, 0, "<b")
CONTROL_MODE: Final = Entry(0x6043, 0, "<b")
SETPOINT: Final = Entry(0x6300, 1, "<h")
ACTUAL: Final = Entry(0x6301, 1, "<h")
HOLD_SETPOINT: Final = Entry(0x6314, 1, "<h")

MODE_BUS: Final = 1
"""Device mode: the setpoint comes by the bus, object 0x6300 (section 6.2.1)."""
MODE_ANALOG: Final = 2
"""Device mode: the setpoint comes by the valve's own analog input."""

SPOOL_CLOSED_LOOP: Final = 2
"""Control mode: closed-loop control of the spool position (section 7.1.1)."""

D: Final = 0b0001
"""Bit "disabled" of the control word and of the status word."""
H: Final = 0b0010
"""Bit "hold" of both words."""
M: Final = 0b0100
"""Bit "active" of both words."""
R: Final = 0b1000
"""Bit whose rising edge in the control word resets a fault; in the status word it means "ready"."""

FULL_SCALE: Final = 16384
"""Increments of setpoint and actual value at 100 % (object 0x6311, section 7.2.2)."""


class DriveState(IntEnum):
    """The state of the valve's electronics; its value is the bits RMHD of the status word.

    The states are those of figure 19 and section 5.2.1. FAULT_INIT, a fault that was met in INIT,
    has the same bits as NOT_READY.
    """

    NOT_READY = 0b0000
    """The electronics start, or met a fault in INIT; the spool is in its fail-safe position."""
    FAULT_DISABLED = D
    """There is a fault; the spool is as in DISABLED."""
    FAULT_HOLD = D | H
    """There is a fault; the spool is as in HOLD."""
    FAULT_REACTION = D | H | M
    """A fault was met just now; which fault state follows depends on the fault."""
    INIT = R
    """The valve can be set up; the spool is in its hydraulic fail-safe position."""
    DISABLED = R | D
    """Actual values are available; the spool is in its fail-safe position."""
    HOLD = R | D | H
    """The spool is controlled to the hold setpoint, object 0x6314; other setpoints do nothing."""
    ACTIVE = R | D | H | M
    """The spool follows the setpoint of the bus or of the analog input."""

    @property
    def ready(self) -> bool:
        """Whether the bit "ready" is set: there is no fault, and the start is over."""
        return bool(self & R)

    @property
    def disabled(self) -> bool:
        """Whether nothing controls the spool, so that it is in its fail-safe position."""
        return not self & H


WALK: Final = (DriveState.INIT, DriveState.DISABLED, DriveState.HOLD, DriveState.ACTIVE)
"""The states that can be asked for, in the order in which they are passed."""


class Transition(NamedTuple):
    """One transition of the drive's state machine, an arrow of its figure 19.

    Attributes:
        number: its name in figure 19, such as "TR2".
        source, target: the states before and after it.
        word: bits RMHD of the control word that make it: 0, 1, x for any, ^ for a rising edge; or
            `FAULT`, if a fault makes it.
    """

    number: str
    source: DriveState
    target: DriveState
    word: str

    def made_by(self, word: int, previous_word: int) -> bool:
        """Return whether the valve makes this transition when it receives a control word.

        The bits of `word` decide by their level. `previous_word`, the control word that came
        before, matters only where this transition needs a rising edge, which is the reset of a
        fault. A transition that a fault causes is made by no word. Whether the valve is in the
        source state is for the caller to check.
        """
        if self.word == FAULT:
            return False
        for symbol, bit in zip(self.word, (R, M, H, D), strict=True):
            if symbol == "^" and not (word & bit and not previous_word & bit):
                return False
            if symbol in "01" and bool(word & bit) != (symbol == "1"):
                return False
        return True


FAULT: Final = "fault"

TRANSITIONS: Final = (
    Transition("TR2", DriveState.INIT, DriveState.DISABLED, "xxx1"),
    Transition("TR3", DriveState.DISABLED, DriveState.HOLD, "xx11"),
    Transition("TR4", DriveState.HOLD, DriveState.ACTIVE, "x111"),
    Transition("TR5", DriveState.ACTIVE, DriveState.HOLD, "x0xx"),
    Transition("TR6", DriveState.HOLD, DriveState.DISABLED, "x00x"),
    Transition("TR7", DriveState.DISABLED, DriveState.INIT, "x000"),
    Transition("TR8", DriveState.INIT, DriveState.NOT_READY, FAULT),
    Transition("TR8", DriveState.DISABLED, DriveState.FAULT_DISABLED, FAULT),
    Transition("TR8", DriveState.HOLD, DriveState.FAULT_HOLD, FAULT),
    Transition("TR8", DriveState.ACTIVE, DriveState.FAULT_HOLD, FAULT),
    Transition("TR10", DriveState.FAULT_DISABLED, DriveState.DISABLED, "^001"),
    Transition("TR11", DriveState.FAULT_HOLD, DriveState.HOLD, "^011"),
    Transition("TR14", DriveState.NOT_READY, DriveState.INIT, "^000"),
    Transition("TR15", DriveState.FAULT_HOLD, DriveState.FAULT_DISABLED, "x00x"),
    Transition("TR16", DriveState.FAULT_DISABLED, DriveState.NOT_READY, "x000"),
)
"""The state machine (figure 19 and section 5.2.2).

TR0 and TR1, the power-up, are left out because no word commands them, and so is the enable input,
which differs from valve to valve. Each TR8 includes the TR9, TR12 or TR13 after it, since
FAULT_REACTION lasts no longer than the reaction. A valve can be set up so that a fault brings it to
a lower state than given here, but never to a higher one (section 5.2.1). TR15 and TR16 are made by
the words of TR6 and TR7.
"""


def after_word(state: DriveState, word: int, previous_word: int) -> DriveState:
    """Return the state after the one transition that a control word makes, or `state` if none.

    Args:
        state: the valve's present state.
        word: the control word.
        previous_word: the control word before it, for the rising edge of a reset.
    """
    leaving = [transition for transition in TRANSITIONS if transition.source is state]
    return next((t.target for t in leaving if t.made_by(word, previous_word)), state)


def after_fault(state: DriveState) -> DriveState:
    """Return the state to which a fault brings a valve in `state`; `state` if that is not ready."""
    fallen = (t.target for t in TRANSITIONS if t.source is state and t.word == FAULT)
    return next(fallen, state)


def keeping_word(state: DriveState) -> int:
    """Return the control word that keeps a valve in a state, which is the state's bits M, H, D."""
    return state & (M | H | D)


def next_state(state: DriveState, target: DriveState) -> DriveState:
    """Return the state one transition nearer to a target of `WALK`; the target itself if there.

    From a fault state, the next one is that after the reset. FAULT_REACTION is returned as it is,
    since it has to end by itself.
    """
    if state is DriveState.FAULT_REACTION:
        return state
    if not state.ready:
        return DriveState(state | R)
    here, there = WALK.index(state), WALK.index(target)
    return WALK[here + (there > here) - (there < here)]


def words_towards(state: DriveState, target: DriveState) -> tuple[int, ...]:
    """Return the control words that lead to `next_state`, to be sent one after the other.

    From a fault state there are two, so that the bit that resets the fault rises; otherwise one.
    """
    if state.ready or state is DriveState.FAULT_REACTION:
        return (keeping_word(next_state(state, target)),)
    return keeping_word(state), keeping_word(state) | R


def to_increments(share: float) -> int:
    """Return the increments of the device for a setpoint from -1 to 1 (section 7.2.2).

    Raises:
        ValueError: the setpoint is beyond full scale, or not a number.
    """
    if not -1.0 <= share <= 1.0:
        raise ValueError(f"{share:g} is not between -1 and 1")
    return round(share * FULL_SCALE)


def to_share(increments: int) -> float:
    """Return the share of full scale of an actual value in increments; it may exceed 1 a little."""
    return increments / FULL_SCALE


# RPDO1 is control word and setpoint, TPDO1 is status word and actual spool position; the file
# config/dbc/servovalve.dbc describes both to other programs.

COMMAND_LAYOUT: Final = "<Hh"
"""Format of RPDO1 for `struct`: control word, setpoint in increments."""

STATUS_LAYOUT: Final = "<Hh"
"""Format of TPDO1 for `struct`: status word, actual spool position in increments."""

_RPDO1_OBJECT: Final = 0x1400
_TPDO1_OBJECT: Final = 0x1800
_MAPPING: Final = 0x200
"""Distance in the dictionary from the communication object of a PDO to its mapping object."""

TPDO1_PERIOD: Final = Entry(_TPDO1_OBJECT, 5, "<H")
"""Entry of the event timer of TPDO1, the time in ms after which it is sent again."""

_NOT_VALID: Final = 1 << 31
_ON_CHANGE: Final = 255
"""Transmission type: an RPDO acts when it is received, a TPDO is sent when its timer ends."""

_BEATS_IN_SILENCE: Final = 4
"""Number of heartbeats that a node sends in the silence after which it counts as lost."""


def set_up(node: int, rate_hz: float, silence: float) -> Iterator[tuple[Entry, int]]:
    """Yield entries with the values that the host writes into them to set up the node, in order.

    The node must be pre-operational. The entries are those of the two PDOs and of the heartbeat.
    The mapping of both messages is written at every start (CiA 301, sections 7.5.2.33 ff.), so that
    earlier settings of a valve do not matter.

    Args:
        node: the node's id.
        rate_hz: how often the host reads, Hz; TPDO1 is sent twice as often, so that every read
            finds a new one.
        silence: time in s without a heartbeat after which the host counts the node as lost.
    """
    period_ms = max(1, round(500.0 / rate_hz))
    yield from _pdo(_RPDO1_OBJECT, canopen.RPDO1 + node, CONTROL_WORD, SETPOINT)
    yield TPDO1_PERIOD, period_ms
    yield from _pdo(_TPDO1_OBJECT, canopen.TPDO1 + node, STATUS_WORD, ACTUAL)
    yield canopen.PRODUCER_HEARTBEAT, round(1e3 * silence / _BEATS_IN_SILENCE)


def _pdo(communication: int, identifier: int, *mapped: Entry) -> Iterator[tuple[Entry, int]]:
    """Yield the entries and values that map 16-bit entries to a PDO, which is invalid meanwhile."""
    mapping = communication + _MAPPING
    yield Entry(communication, 1, "<I"), _NOT_VALID | identifier
    yield Entry(communication, 2, "<B"), _ON_CHANGE
    yield Entry(mapping, 0, "<B"), 0
    for number, entry in enumerate(mapped, 1):
        yield Entry(mapping, number, "<I"), entry.index << 16 | entry.subindex << 8 | 16
    yield Entry(mapping, 0, "<B"), len(mapped)
    yield Entry(communication, 1, "<I"), identifier
