"""The session's state machine is one table of the allowed transitions and their conditions."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple


class State(Enum):
    """A state of the session."""

    OFF = "off"
    """The session is not connected to the rig."""
    CONNECTING = "connecting"
    """Devices are opened, verified and set up; nothing moves."""
    DISARMED = "disarmed"
    """The rig is connected; its valve is at null and disabled, and needs a reset to be enabled."""
    ARMING = "arming"
    """The reset lamp is lit, and the session waits for the operator to press reset."""
    NOT_HOMED = "not homed"
    """The valve is enabled but the position unknown: only homing may move the ram."""
    HOMING = "homing"
    """The ram looks for its stroke end, slowly and gently."""
    ARMED = "armed"
    """The rig is homed, and the position loop holds the ram at rest."""
    POSITIONING = "positioning"
    """The ram is brought to the start of a test."""
    RUNNING = "running"
    """A test runs."""
    HOLDING = "holding"
    """A limit or the operator stopped the motion; the ram is held within its limits."""
    RAMPING_DOWN = "ramping down"
    """The motion is brought to rest, after which the valve is disabled."""
    TRIPPED = "tripped"
    """The valve goes to null and is disabled, bypasses are shut, the pump is unloaded; latched."""


class Event(Enum):
    """A request of operator or campaign, or a report of the rig, that may change the state."""

    CONNECT = "connect"
    CONNECTED = "connected"
    CONNECTION_FAILED = "connection failed"
    ARM = "arm"
    RESET_PRESSED = "reset pressed"
    """The operator pressed the reset button while its lamp was lit, and the valve is enabled."""
    HOME = "home"
    HOMED = "homed"
    HOMING_FAILED = "homing failed"
    COUNT_LOST = "count lost"
    """The encoder's zero is no longer known."""
    POSITION = "position"
    POSITIONED = "positioned"
    RUN = "run"
    DONE = "done"
    HOLD = "hold"
    RELEASE = "release"
    RAMP_DOWN = "ramp down"
    AT_REST = "at rest"
    DISARM = "disarm"
    TRIP = "trip"
    ACKNOWLEDGE = "acknowledge"
    DISCONNECT = "disconnect"


VALVE_ENABLED: Final = frozenset(
    {
        State.NOT_HOMED,
        State.HOMING,
        State.ARMED,
        State.POSITIONING,
        State.RUNNING,
        State.HOLDING,
        State.RAMPING_DOWN,
    }
)
"""States in which the valve may be enabled; the only way in is from ARMING, by the reset button."""


@dataclass(frozen=True)
class Conditions:
    """What the guards of transitions check, as the rig last reported it.

    By default the emergency stop is open, the valve disabled, the rig not homed, and there is no
    reason against motion and no unconfirmed step.

    Attributes:
        estop_closed: whether the emergency stop's chain is closed.
        valve_enabled: whether the device reports the valve as enabled.
        homed: whether the encoder's zero is known.
        standing: the reason in words why motion is forbidden now; empty if it is not.
        unconfirmed: the steps of a trip, in words, that were not confirmed; empty if all were.
    """

    estop_closed: bool = False
    valve_enabled: bool = False
    homed: bool = False
    standing: str = ""
    unconfirmed: str = ""


class Guard(NamedTuple):
    """A condition of a transition.

    Attributes:
        name: the condition in words.
        holds: returns whether the condition is met.
        reason: the message, with a remedy, if the event is refused because the condition is not
            met; a field of `Conditions` in braces stands for that field's value.
    """

    name: str
    holds: Callable[[Conditions], bool]
    reason: str


_ESTOP: Final = Guard(
    "emergency stop closed",
    lambda now: now.estop_closed,
    "the emergency stop is open: make the rig safe and release its button",
)
_ENABLED: Final = Guard(
    "valve enabled",
    lambda now: now.valve_enabled,
    "the device does not report the valve enabled: press reset while its lamp is lit",
)
_HOMED: Final = Guard("homed", lambda now: now.homed, "the position is not known: home the rig")
_NOT_HOMED: Final = Guard("not homed", lambda now: not now.homed, "the position is known already")
_CLEAR: Final = Guard(
    "nothing stands against motion",
    lambda now: not now.standing,
    "{standing}: remove the cause",
)
_CONFIRMED: Final = Guard(
    "trip confirmed",
    lambda now: not now.unconfirmed,
    "not confirmed: {unconfirmed}; look at the rig before going on",
)


class Transition(NamedTuple):
    """One row of the table: an event leads from a state to the state `to`, if all guards hold."""

    state: State
    event: Event
    to: State
    guards: tuple[Guard, ...] = ()


_S, _E, _T = State, Event, Transition

TRANSITIONS: Final = (
    _T(_S.OFF, _E.CONNECT, _S.CONNECTING),
    _T(_S.CONNECTING, _E.CONNECTED, _S.DISARMED),
    _T(_S.CONNECTING, _E.CONNECTION_FAILED, _S.OFF),
    _T(_S.DISARMED, _E.ARM, _S.ARMING, (_ESTOP, _CLEAR)),
    _T(_S.DISARMED, _E.DISCONNECT, _S.OFF),
    _T(_S.ARMING, _E.RESET_PRESSED, _S.ARMED, (_ESTOP, _ENABLED, _HOMED)),
    _T(_S.ARMING, _E.RESET_PRESSED, _S.NOT_HOMED, (_ESTOP, _ENABLED, _NOT_HOMED)),
    _T(_S.ARMING, _E.DISARM, _S.DISARMED),
    _T(_S.NOT_HOMED, _E.HOME, _S.HOMING, (_CLEAR,)),
    _T(_S.NOT_HOMED, _E.DISARM, _S.DISARMED),
    _T(_S.HOMING, _E.HOMED, _S.ARMED, (_HOMED,)),
    _T(_S.HOMING, _E.HOMING_FAILED, _S.NOT_HOMED),
    _T(_S.HOMING, _E.HOLD, _S.NOT_HOMED),
    _T(_S.ARMED, _E.HOME, _S.HOMING, (_CLEAR,)),
    _T(_S.ARMED, _E.COUNT_LOST, _S.NOT_HOMED),
    _T(_S.ARMED, _E.POSITION, _S.POSITIONING, (_HOMED, _CLEAR)),
    _T(_S.ARMED, _E.RUN, _S.RUNNING, (_HOMED, _CLEAR)),
    _T(_S.ARMED, _E.HOLD, _S.HOLDING),
    _T(_S.ARMED, _E.DISARM, _S.DISARMED),
    _T(_S.POSITIONING, _E.POSITIONED, _S.ARMED),
    _T(_S.POSITIONING, _E.HOLD, _S.HOLDING),
    _T(_S.RUNNING, _E.DONE, _S.ARMED),
    _T(_S.RUNNING, _E.HOLD, _S.HOLDING),
    _T(_S.HOLDING, _E.RELEASE, _S.ARMED, (_HOMED, _CLEAR)),
    _T(_S.HOLDING, _E.COUNT_LOST, _S.NOT_HOMED),
    _T(_S.HOLDING, _E.DISARM, _S.DISARMED),
    *(
        _T(state, _E.RAMP_DOWN, _S.RAMPING_DOWN)
        for state in State
        if state in VALVE_ENABLED - {_S.RAMPING_DOWN}
    ),
    _T(_S.RAMPING_DOWN, _E.AT_REST, _S.DISARMED),
    *(_T(state, _E.TRIP, _S.TRIPPED) for state in State if state is not _S.OFF),
    _T(_S.TRIPPED, _E.ACKNOWLEDGE, _S.DISARMED, (_ESTOP, _CONFIRMED)),
    _T(_S.TRIPPED, _E.DISCONNECT, _S.OFF),
)
"""All allowed transitions; an event that is not listed for a state is refused in it."""


class IllegalTransition(Exception):  # noqa: N818 (a refusal, not a failure)
    """Raised for an event that the table does not allow; the message says why and in which state.

    It also gives the remedy, if there is one.
    """


def next_state(state: State, event: Event, conditions: Conditions) -> State:
    """Return the state to which an event leads from a state, under the present conditions.

    It is that of the first row of `TRANSITIONS` for state and event whose guards all hold.

    Raises:
        IllegalTransition: the table has no row for state and event, or each such row has a guard
            that does not hold; the message then gives the reasons of the first row.
    """
    reasons: list[str] = []
    for row in TRANSITIONS:
        if row.state is state and row.event is event:
            failing = [guard.reason for guard in row.guards if not guard.holds(conditions)]
            if not failing:
                return row.to
            reasons = reasons or failing
    why = "; ".join(reasons).format_map(vars(conditions)) or "not possible in this state"
    raise IllegalTransition(f"{why} ({event.value!r} was refused while {state.value})")
