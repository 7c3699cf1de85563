"""The session's state machine: one table of what may follow what, and under which conditions."""

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from typing import Final, NamedTuple


class State(Enum):
    """What the session is doing."""

    OFF = "off"
    """Not connected."""
    CONNECTING = "connecting"
    """Devices are opened, verified and set up; nothing moves."""
    DISARMED = "disarmed"
    """Connected, valve at null and disabled; the emergency stop counts as latched."""
    ARMING = "arming"
    """The reset lamp is lit, and the operator is waited for."""
    NOT_HOMED = "not homed"
    """Valve enabled, position unknown: the ram is at rest, and only homing may move it."""
    HOMING = "homing"
    """The ram looks for its stroke end, slowly and gently."""
    ARMED = "armed"
    """Homed and held at rest by the position loop."""
    POSITIONING = "positioning"
    """The ram is brought to the start of a test."""
    RUNNING = "running"
    """A test runs."""
    HOLDING = "holding"
    """A limit or the operator stopped the motion; the ram is held within its limits."""
    RAMPING_DOWN = "ramping down"
    """The motion is brought to rest; the valve is disabled then."""
    TRIPPED = "tripped"
    """Valve to null and disabled, bypass shut, pump unloaded; latched."""


class Event(Enum):
    """What happens to the session: asked by the operator or the campaign, or reported."""

    CONNECT = "connect"
    CONNECTED = "connected"
    CONNECTION_FAILED = "connection failed"
    ARM = "arm"
    RESET_PRESSED = "reset pressed"
    """A rising edge of the reset button while its lamp was lit, and the valve was enabled."""
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
"""States in which the valve may be enabled; entered only from ARMING, by the reset button."""


@dataclass(frozen=True)
class Conditions:
    """What the guards look at, as last reported by the rig.

    Attributes:
        estop_closed: the emergency stop's chain is closed.
        valve_enabled: the device reports the valve enabled.
        homed: the encoder's zero is known.
        standing: what stands against motion at present, in words; empty if nothing does.
        unconfirmed: steps of a trip that were not confirmed, in words; empty if all were.
    """

    estop_closed: bool = False
    valve_enabled: bool = False
    homed: bool = False
    standing: str = ""
    unconfirmed: str = ""


class Guard(NamedTuple):
    """A condition of a transition.

    Attributes:
        name: what must hold.
        holds: whether it does.
        reason: why the event is refused if not, with what to do.
    """

    name: str
    holds: Callable[[Conditions], bool]
    reason: Callable[[Conditions], str]


_ESTOP: Final = Guard(
    "emergency stop closed",
    lambda now: now.estop_closed,
    lambda now: "the emergency stop is open: make the rig safe and release its button",
)
_ENABLED: Final = Guard(
    "valve enabled",
    lambda now: now.valve_enabled,
    lambda now: "the device does not report the valve enabled: press reset while its lamp is lit",
)
_HOMED: Final = Guard(
    "homed", lambda now: now.homed, lambda now: "the position is not known: home the rig"
)
_NOT_HOMED: Final = Guard(
    "not homed", lambda now: not now.homed, lambda now: "the position is known already"
)
_CLEAR: Final = Guard(
    "nothing stands against motion",
    lambda now: not now.standing,
    lambda now: f"{now.standing}: remove the cause",
)
_CONFIRMED: Final = Guard(
    "trip confirmed",
    lambda now: not now.unconfirmed,
    lambda now: f"not confirmed: {now.unconfirmed}; look at the rig before going on",
)


class Transition(NamedTuple):
    """One row of the table: what an event leads to in a state, if the guards allow it."""

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
"""Everything that may happen; what is not here is refused."""


class IllegalTransition(Exception):  # noqa: N818 (a refusal, not a failure)
    """An event that the session refuses, with the reason.

    Attributes:
        state: in which it was refused.
        event: what was refused.
        reason: why, with what to do.
        allowed: events that the table knows in that state.
    """

    def __init__(self, state: State, event: Event, reason: str) -> None:
        self.state, self.event, self.reason = state, event, reason
        self.allowed = allowed_events(state)
        names = ", ".join(each.value for each in self.allowed)
        super().__init__(f"{event.value!r} while {state.value}: {reason}; allowed: {names}")


def allowed_events(state: State) -> tuple[Event, ...]:
    """Return the events that the table knows in a state, guards aside."""
    return tuple(dict.fromkeys(row.event for row in TRANSITIONS if row.state is state))


def next_state(state: State, event: Event, conditions: Conditions) -> State:
    """Return the state that follows.

    Raises:
        IllegalTransition: the table has no such row, or its guards do not hold.
    """
    reasons: list[str] = []
    for row in TRANSITIONS:
        if row.state is state and row.event is event:
            refused = [
                guard.reason(conditions) for guard in row.guards if not guard.holds(conditions)
            ]
            if not refused:
                return row.to
            reasons = reasons or refused
    raise IllegalTransition(state, event, "; ".join(reasons) or "not possible in this state")


class SessionState:
    """The state that a session is in.

    Attributes:
        state: the present one; begins OFF.
    """

    def __init__(self) -> None:
        self.state = State.OFF

    def handle(self, event: Event, conditions: Conditions) -> State:
        """Go to the state that follows, and return it.

        Raises:
            IllegalTransition: refused; the state stays as it is.
        """
        self.state = next_state(self.state, event, conditions)
        return self.state
