"""What the compiled loop on the wire is given, what it keeps, and the columns of its rows."""

from enum import IntEnum
from math import nan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control import COMMAND_LIMIT, POSITION_GAIN
from rig.channels import READINGS, Kind, names_of
from rig.io import FAST_INPUTS, FAST_OUTPUTS, LoopSettings
from rig.loop.board import Board
from rig.loop.cycle import sample_channels
from rig.loop.decided import no_decision
from rig.loop.reaction import Reaction, ReactionMemory, reaction_memory

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

STATUS: Final = FAST_INPUTS[len(READINGS) :]
"""Fast inputs that no filter takes: switches, counters, the valve output, carried transducers."""

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
"""Of each tick: how late it woke, and how late the kernel had the whole frame with its command; how
long the exchange and the rest took; age of the newest sample when it ended; `ExchangeStatus`, -1
without exchange; segment and tick, -1 outside its table; `Action`."""
MEASURED: Final = TIMINGS.index("segment")
"""Timings that are measured, the first ones; the others say what the tick was for."""

SLOW: Final = names_of(Kind.SLOW)
"""Slow inputs with columns of their own; the meters stand among the readings."""


def wire_channels(states: tuple[str, ...], open_loop: bool) -> tuple[str, ...]:
    """Return the names of a row's columns on the wire for a filter's states."""
    return (*sample_channels(states, open_loop), *TIMINGS, *STATUS, *SLOW)


class Drive(IntEnum):
    """What the loop does with the valve."""

    NULL = 0
    """0 V."""
    HOLD = 1
    """Holds the ram where it is by the position loop."""
    TRACK = 2
    """Follows the segment's setpoints, then holds."""
    RAMP_DOWN = 3
    """Brings the command to 0 V along a ramp, then disables the valve; an action's only."""


class Overrun(IntEnum):
    """What follows a missed tick; never a burst to catch up."""

    SKIP = 0
    """It is skipped and counted, and has a row without readings."""
    REALIGN = 1
    """The time grid is moved to now: no tick is skipped, the recording's clock runs late."""
    TRIP = 2
    """It is treated as by `SKIP`, and too many in a row trip."""


class Left(IntEnum):
    """Why the compiled loop returned."""

    SWITCHED = 0
    """Another segment is asked for."""
    ASKED = 1
    """It was asked to leave; a null frame was sent."""
    UNCONFIRMED = 2
    """It tripped, and the device did not confirm by this connection that the valve is at null."""


class Pace(NamedTuple):
    """How the loop is paced and watched; times in ns, a limit of 0 is not watched."""

    period_ns: int
    period_s: float
    every: int
    """Ticks from one exchange to the next."""
    timeout_ns: int
    overrun: int
    trip_after: int
    ramp_ticks: int
    stale_ns: int
    slow_stale_ns: int
    supervisor_ns: int
    field_ns: int
    recorder_ns: int


RAMP_S: Final = 0.5
"""Time in which RAMP_DOWN brings the command to 0 V."""
NULL_V: Final = 0.05
"""An output this near to 0 V is at null: half a percent of its range, what converters are off."""


def pace(settings: LoopSettings, device_rate_hz: float) -> Pace:
    """Return how the loop is paced with a device that can be asked so often."""
    period_s = 1.0 / settings.rate

    def ns(time_s: float) -> int:
        return round(1e9 * time_s)

    return Pace(
        period_ns=ns(period_s),
        period_s=period_s,
        # The tolerance: a device of just the loop's rate is asked at every tick.
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
    setpoint: Array
    """(ticks,) m, or V in open loop; followed by `Drive.TRACK`."""
    drive: int
    open_loop: bool
    gain: float
    """Gain of the position loop, V/m."""
    limit: float
    """Greatest command of either sign, V."""
    on_fault: int
    """`Reaction` to a confirmed fault."""
    offset: float
    """Added to the encoder's position, m."""
    valve_enable: float
    reset_lamp: float
    rearm: float


def course(
    number: int,
    setpoint: Array,
    drive: Drive,
    *,
    open_loop: bool = False,
    gain: float = POSITION_GAIN,
    limit: float = COMMAND_LIMIT,
    on_fault: Reaction = Reaction.IGNORE,
    offset: float = 0.0,
    valve_enable: bool = False,
    reset_lamp: bool = False,
    rearm: bool = False,
) -> Course:
    """Return a segment's course, of the types that the loop is compiled for."""
    return Course(
        int(number), np.ascontiguousarray(setpoint, np.float64), int(drive), bool(open_loop),
        float(gain), float(limit), int(on_fault), float(offset),
        float(valve_enable), float(reset_lamp), float(rearm),
    )  # fmt: skip


class Count(IntEnum):
    """Index of each number in `WireMemory.counts`."""

    DUE_NS = 0
    """Time of the next tick; 0 before the first."""
    SEQUENCE = 1
    """Exchanges and looks so far."""
    SAMPLED_NS = 2
    """When the newest sample came."""
    DRIVEN = 3
    """1 while the valve is asked to be enabled, and was confirmed to be."""
    LEAVE = 4
    """Set from outside: 1 makes the loop send a null frame and return."""
    DECISION = 5
    """Number of the newest decision seen on the board."""
    WRITTEN = 6
    """Exchanges so far; `host_counter` follows from it."""
    NULL_NS = 7
    """When the device last showed the valve at null; 0 since it may be enabled."""
    SETTLED = 8
    """Looks in a row that found the spool at null; the count stops where it is enough."""
    AWAY = 9
    """Looks in a row that found a spool away from null that had settled there."""


class Found(IntEnum):
    """Index of each number in `WireMemory.found`: what another master did to a valve at null."""

    TIMES = 0
    """How many looks found the valve driven; written last."""
    FIRST_NS = 1
    LAST_NS = 2
    ENABLED = 3
    """How many found it enabled."""
    OUTPUT_UV = 4
    """The output farthest from null, uV."""
    SPOOL_NM = 5
    """The spool farthest from null, nm; 0 while it was not away for long."""


class Handling(IntEnum):
    """Index of each number in `WireMemory.handling`, which each segment begins with NaN."""

    HELD_AT = 0
    """Where the ram is held, m."""
    RAMP_FROM = 1
    """Command from which it is brought to rest, V."""
    RAMP_TICK = 2
    """Tick at which that began."""


class WireMemory(NamedTuple):
    """What the loop on the wire keeps from segment to segment."""

    counts: Integers
    """Numbers that are kept, by `Count`."""
    found: Integers
    """What was found at null, by `Found`."""
    inputs: Array
    """(FAST_INPUTS,) of the last exchange."""
    seen: Array
    """(FAST_INPUTS,) of the last look."""
    outputs: Array
    """(FAST_OUTPUTS,) of the last frame; the command is held on the device."""
    reading: Array
    """(9,) of the present tick."""
    encoder: Array
    """(1,) newest position that the device counted, m, without offset; NaN before the first."""
    device_counter: Array
    """(1,) of the newest sample."""
    handling: Array
    """How the ram is held or brought to rest, by `Handling`; NaN before."""
    posted: Array
    """(1 + len(DECIDED),) scratch: a decision as it stands on the board."""
    decided: Array
    """(len(DECIDED),) the newest decision on this segment; NaN before the first."""
    reaction: ReactionMemory


def wire_memory() -> WireMemory:
    """Return the memory of a session that begins."""
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
    )


class SharedMemory(NamedTuple):
    """The board's arrays that the loop reads and writes; see `Board`."""

    words: Integers
    slow: Array
    slow_at: Integers
    decisions: Array
    ring: Array


def shared_memory(board: Board) -> SharedMemory:
    """Return a board's arrays for the compiled loop."""
    return SharedMemory(board.words, board.slow, board.slow_at, board.decisions, board.ring)
