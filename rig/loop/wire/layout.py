"""The arguments and the memory of the compiled loop on the wire, and the columns of its rows."""

from enum import IntEnum
from math import nan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control import ChangeMemory, ControlLaw, ControlMemory, Guide, change_memory, control_memory
from rig.channels import READINGS, Kind, names_of
from rig.io import FAST_INPUTS, FAST_OUTPUTS, Corrections, LoopSettings, corrections_of
from rig.loop.cycle import sample_channels
from rig.loop.decided import no_decision
from rig.loop.reaction import ReactionMemory, reaction_memory

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

STATUS: Final = FAST_INPUTS[len(READINGS) :]
"""Fast inputs that no filter uses: switches, counters, the valve output, carried transducers."""

TIMINGS: Final = (
    "wakeup_s",
    "sent_s",
    "exchange_s",
    "compute_s",
    "age_s",
    "exchange_status",
    "segment",
    "tick",
    "action",
)
"""Columns about each tick. `wakeup_s` and `sent_s` say how late the loop woke, and how late the
kernel had the whole frame with the command. `exchange_s` and `compute_s` say how long the exchange
and the rest took. `age_s` is the age of the newest sample after the exchange. `exchange_status` is
an `ExchangeStatus`, -1 without exchange. `segment` is -1 outside the segment's setpoints, and
`tick` is -1 before its start. `action` is an `Action`."""
MEASURED: Final = TIMINGS.index("segment")
"""Number of timings that are measured, the first ones; the other columns describe the tick."""

SLOW: Final = names_of(Kind.SLOW)
"""Slow inputs that have columns of their own; the meters are among the readings."""


def wire_channels(states: tuple[str, ...], open_loop: bool) -> tuple[str, ...]:
    """Return the names of the columns of a row on the wire, for a filter with these states."""
    return (*sample_channels(states, open_loop), *TIMINGS, *STATUS, *SLOW)


class Drive(IntEnum):
    """What the loop does with the valve."""

    NULL = 0
    """The command is 0 V."""
    HOLD = 1
    """The position loop holds the ram where it is."""
    TRACK = 2
    """The ram or the command follows the segment's setpoints; after them the ram is held."""
    RAMP_DOWN = 3
    """The command goes to 0 V along a ramp, then the valve is disabled; only actions do this."""


class Overrun(IntEnum):
    """What the loop does about a missed tick; it never catches up in a burst."""

    SKIP = 0
    """The tick is skipped and counted, and has a row without readings."""
    REALIGN = 1
    """The time grid is moved to now: no tick is skipped, but the recording's clock runs late."""
    TRIP = 2
    """The tick is treated as by `SKIP`, and too many missed ticks in a row trip."""


class Left(IntEnum):
    """Why the compiled loop returned."""

    SWITCHED = 0
    """The supervisor asked for another segment."""
    ASKED = 1
    """The loop was asked to leave; it has sent a null frame."""
    UNCONFIRMED = 2
    """It tripped, and the device did not confirm by this connection that the valve is at null."""
    CHANGED = 3
    """The supervisor asked for another control; the segment goes on with the next tick."""


class Pace(NamedTuple):
    """How the loop is paced, and its limits of time in ns; a silence limit of 0 is not checked."""

    period_ns: int
    """Time from one tick to the next."""
    period_s: float
    """The same in s."""
    every: int
    """Number of ticks from one exchange to the next."""
    timeout_ns: int
    """Longest wait for the device's reply."""
    overrun: int
    """`Overrun`: what follows a missed tick."""
    trip_after: int
    """Number of missed ticks in a row that trip, with `Overrun.TRIP`."""
    ramp_ticks: int
    """Number of ticks in which RAMP_DOWN brings the command to 0 V."""
    stale_ns: int
    """Age of the device's newest sample beyond which the loop trips."""
    slow_stale_ns: int
    """Age beyond which a slow value is recorded as NaN."""
    supervisor_ns: int
    """Silence of the supervisor beyond which the loop trips."""
    field_ns: int
    """Silence of the field process beyond which the loop trips."""
    recorder_ns: int
    """Silence of the recorder beyond which the loop trips."""


RAMP_S: Final = 0.5
"""Time in s in which RAMP_DOWN brings the command to 0 V."""
NULL_V: Final = 0.05
"""Greatest output in V, of either sign, that counts as null: half a percent of the range, by which
converters may be off."""


def pace(settings: LoopSettings, device_rate_hz: float) -> Pace:
    """Return the loop's pace with a device that can exchange `device_rate_hz` times a second.

    A device slower than the loop exchanges at every n-th tick only (`Pace.every`).
    """
    period_s = 1.0 / settings.rate

    def ns(time_s: float) -> int:
        return round(1e9 * time_s)

    return Pace(
        period_ns=ns(period_s),
        period_s=period_s,
        # With the tolerance, a device of just the loop's rate exchanges at every tick.
        every=max(1, int(np.ceil(settings.rate / device_rate_hz - 1e-6))),
        timeout_ns=ns(settings.exchange_timeout),
        overrun=Overrun[settings.overrun.upper()],
        trip_after=settings.trip_after,
        ramp_ticks=max(1, round(RAMP_S * settings.rate)),
        stale_ns=ns(settings.stale_limit),
        slow_stale_ns=ns(settings.slow_stale_limit),
        supervisor_ns=ns(settings.supervisor_silence),
        field_ns=ns(settings.field_silence),
        recorder_ns=ns(settings.recorder_silence),
    )


class Course(NamedTuple):
    """What the loop does in one segment."""

    number: int
    """Number of the segment."""
    setpoint: Array
    """(ticks,) m, or V in open loop; `Drive.TRACK` follows it."""
    drive: int
    """`Drive`: what the loop does with the valve."""
    open_loop: bool
    """Whether the setpoint is the valve command."""
    gain: float
    """Gain of the position loop, V/m."""
    limit: float
    """Greatest command of either sign, V."""
    law: ControlLaw
    """What the position loop adds to gain times error while it tracks."""
    feedforward: Array
    """(ticks,) feedforward of the position loop in V; (0,) for none."""
    expected: Array
    """(ticks,) position in m that the integral part goes by; (0,) for the setpoint."""
    tones: Array
    """(n, TONE_NUMBERS) frequencies of the setpoint that are corrected."""
    on_fault: int
    """`Reaction` to a confirmed fault."""
    offset: float
    """Offset in m that is added to the encoder's position."""
    valve_enable: float
    """1 if the valve's relay may close, else 0."""
    reset_lamp: float
    """1 if the operator is asked to press the reset button, else 0."""
    rearm: float
    """1 if a watchdog that tripped is acknowledged, else 0."""
    change: int
    """Number of the newest change of control that the segment has taken, or that came before it."""
    goes_on: bool
    """Whether the segment goes on after a change of its control, rather than begins."""


class Earlier(NamedTuple):
    """The control of a segment before the last change of it; as in `Course` without a change."""

    gain: float
    """Gain of the position loop, V/m."""
    guide: Guide
    """What the position loop added to gain times error."""


class Count(IntEnum):
    """Index of each number in `WireMemory.counts`."""

    DUE_NS = 0
    """Time of the next tick; 0 before the first."""
    SEQUENCE = 1
    """Number of exchanges and looks so far."""
    SAMPLED_NS = 2
    """Time at which the newest sample came."""
    DRIVEN = 3
    """1 while the valve is commanded to be enabled, and the device has confirmed it; else 0."""
    LEAVE = 4
    """Other threads set this to 1 to make the loop send a null frame and return."""
    DECISION = 5
    """Number of the newest decision that was read from the board."""
    WRITTEN = 6
    """Number of exchanges so far, from which `host_counter` follows."""
    NULL_NS = 7
    """Time at which the device last showed the valve at null; 0 once the valve is enabled."""
    SETTLED = 8
    """Number of looks in a row that found the spool at null; it stops when it is large enough."""
    AWAY = 9
    """Number of looks in a row that found the spool away from null, after it had settled there."""


class Found(IntEnum):
    """Index of each number in `WireMemory.found`: what another master did to a valve at null."""

    TIMES = 0
    """Number of looks that found the valve driven; it is written after the other numbers."""
    FIRST_NS = 1
    """Time of the first of these looks; 0 before it."""
    LAST_NS = 2
    """Time of the last of them so far."""
    ENABLED = 3
    """Number of looks that found the valve enabled."""
    OUTPUT_UV = 4
    """Valve output that was farthest from null, uV."""
    SPOOL_NM = 5
    """Spool position that was farthest from null, nm; 0 while it was not away for long."""


class Handling(IntEnum):
    """Index of each number in `WireMemory.handling`; all are NaN when a segment begins."""

    HELD_AT = 0
    """Position at which the ram is held, m."""
    RAMP_FROM = 1
    """Command from which the ramp down began, V."""
    RAMP_TICK = 2
    """Place at which the ramp down began."""
    SKIP_FROM = 3
    """Setpoint before the last skip less the one at which it went on, m or V."""
    SKIP_PLACE = 4
    """Index of the setpoint at which the loop went on."""
    SKIP_TICKS = 5
    """Number of ticks in which the setpoint goes over."""


class Going(IntEnum):
    """Index of each number in `WireMemory.going`: where a segment that was left goes on."""

    TICK = 0
    """Number of the next tick."""
    STARTED = 1
    """1 once the first whole sample has come, else 0."""
    ACTION = 2
    """`Action` of the segment so far."""
    HELD = 3
    """Command that is held up to the next sample, V."""


class WireMemory(NamedTuple):
    """The memory of the loop on the wire, which lasts from segment to segment."""

    counts: Integers
    """Counts and times, indexed by `Count`."""
    found: Integers
    """What looks at a valve at null have found, indexed by `Found`."""
    inputs: Array
    """(len(FAST_INPUTS),): inputs of the last exchange."""
    seen: Array
    """(len(FAST_INPUTS),): inputs of the last look."""
    outputs: Array
    """(len(FAST_OUTPUTS),): outputs of the last exchange; the device keeps the command."""
    reading: Array
    """(9,): reading of the present tick."""
    encoder: Array
    """(1,): newest position that the device counted, m, without offset; NaN before the first."""
    device_counter: Array
    """(1,): `device_counter` of the newest sample."""
    handling: Array
    """How the ram is held or brought to rest, indexed by `Handling`; NaN while it is not."""
    posted: Array
    """(1 + len(DECIDED),): scratch for a decision as it is on the board."""
    decided: Array
    """(len(DECIDED),): the newest decision on this segment; NaN before the first."""
    reaction: ReactionMemory
    """Memory of the reaction to a confirmed fault."""
    control: ControlMemory
    """Memory of the position loop."""
    change: ChangeMemory
    """Memory of the changes of the segment's control."""
    going: Array
    """Where the segment is that was left for a change, indexed by `Going`."""
    corrections: Corrections
    """Calibrations of the transducers, by which inputs are corrected."""


def wire_memory() -> WireMemory:
    """Return the memory of a session before its first tick, without calibrations."""
    return WireMemory(
        np.zeros(len(Count), np.int64),
        np.zeros(len(Found), np.int64),
        np.full(len(FAST_INPUTS), nan),
        np.full(len(FAST_INPUTS), nan),
        np.zeros(len(FAST_OUTPUTS)),
        np.full(len(READINGS), nan),
        np.full(1, nan),
        np.full(1, nan),
        np.full(len(Handling), nan),
        np.full(1 + no_decision().size, nan),
        no_decision(),
        reaction_memory(),
        control_memory(),
        change_memory(),
        np.zeros(len(Going)),
        corrections_of(),
    )
