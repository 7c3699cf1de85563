"""The interlock's check of every sample, compiled: whether the motion may go on; if not, why.

Of several actions the worst is taken; of equal ones, that of the first cause. A trip is latched
with its first cause. While the valve is not driven, the rig is already in the state to which a trip
leads, so that causes are only indicated then.
"""

from math import isnan, nan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.io import FAST_INPUTS
from rig.jit import njit
from rig.plant import inlined

from .check_tolerances import Tolerances
from .ladder import ERROR_AT, NO_CHANNEL, Action, Cause, LimitTable
from .passing_log import PassingLog
from .passings import note_passing, passing_log
from .plausibility import POSITION, PRESSURE_1, PRESSURE_2, implausible, no_evidence

_ESTOP: Final = FAST_INPUTS.index("estop_closed")
_ENABLED: Final = FAST_INPUTS.index("valve_enabled")
_WATCHDOG: Final = FAST_INPUTS.index("watchdog_tripped")
_ENCODER_FAULT: Final = FAST_INPUTS.index("encoder_fault")
_COUNTER: Final = FAST_INPUTS.index("device_counter")
_ECHO: Final = FAST_INPUTS.index("device_echo")
_OUTPUT: Final = FAST_INPUTS.index("device_command_V")

_NONE, _INDICATE, _HOLD, _RAMP_DOWN, _TRIP = (int(action) for action in Action)
_BAD_SAMPLES: Final = 3
"""Number of samples in a row, without a value or at a rail, after which a channel has failed."""
_COMMANDS: Final = 4
"""Number of latest commands of which the device's output may be one, as some are on their way."""
_ECHO_LAG: Final = 4
"""Number of exchanges by which the `host_counter` that the device returns may be behind."""
_FADING: Final = 0.25
_GENTLE: Final = 0.75
"""Part of the limit of load pressure up to which a ram that is not homed is pushed."""
_RELIEF: Final = 0.4
"""Part of the command that relieves a ram that pushes too hard; with more the ram would swing,
since the small chamber is so stiff."""
_INWARD_M: Final = 5e-3
"""Distance in m within its limits at which a ram is held; the position loop's error by a null that
is off is smaller."""
_COUNTERS: Final = 65536
"""Number of values of `host_counter`."""

_NOT_SAMPLED, _NOT_TAKEN, _NOT_PUT_OUT, _DISABLED, _FORCED = range(5)
"""Indices in `InterlockMemory.unconfirmed`."""


class InterlockMemory(NamedTuple):
    """The interlock's memory from tick to tick."""

    latched: NDArray[np.int64]
    """(3,): action, cause and channel of the first trip; zeros before it."""
    values: NDArray[np.float64]
    """(len(FAST_INPUTS),): latest value of each channel, NaN if none came."""
    trusted: NDArray[np.float64]
    """As `values`, but NaN for a transducer that fails a check of its own channel."""
    outside: NDArray[np.int64]
    """(limits,): number of ticks in a row outside each limit."""
    active: NDArray[np.int64]
    """(limits,): 1 while the limit's action is taken, else 0."""
    missing: NDArray[np.int64]
    """(len(FAST_INPUTS),): number of samples in a row without a value."""
    repeated: NDArray[np.int64]
    """(len(FAST_INPUTS),): number of samples in a row that equal the one before."""
    railed: NDArray[np.int64]
    """(len(FAST_INPUTS),): number of samples in a row at an end of the transducer's range."""
    unconfirmed: NDArray[np.int64]
    """(5,): number of ticks in a row in which the device took no new sample, took no write, did not
    put out the command, did not enable the valve, or the ram pushed too hard."""
    commands: NDArray[np.float64]
    """(4,): the last commands in V, the newest first."""
    evidence: NDArray[np.float64]
    """Memory of the plausibility checks (`rig.loop.interlocks.plausibility.Evidence`)."""

    def clear(self) -> None:
        """Reset the whole memory in place, a latched trip included, as before the first tick."""
        for array, start in zip(self, interlock_memory(self.outside.size), strict=True):
            array[:] = start


def interlock_memory(limits: int) -> InterlockMemory:
    """Return the memory that an interlock with this number of limits has before its first tick."""
    channels = len(FAST_INPUTS)
    return InterlockMemory(
        np.zeros(3, np.int64),
        np.full(channels, np.nan),
        np.full(channels, np.nan),
        np.zeros(limits, np.int64),
        np.zeros(limits, np.int64),
        np.zeros(channels, np.int64),
        np.zeros(channels, np.int64),
        np.zeros(channels, np.int64),
        np.zeros(5, np.int64),
        np.zeros(_COMMANDS),
        no_evidence(),
    )


class Interlock(NamedTuple):
    """The limits, tolerances and memory with which `judged_sample` judges."""

    limits: LimitTable
    tolerances: Tolerances
    memory: InterlockMemory
    log: PassingLog
    """Where it writes which limit was passed, when, and with which value."""


def interlock(limits: LimitTable, tolerances: Tolerances) -> Interlock:
    """Return an interlock with these limits and tolerances, as it is before its first tick."""
    return Interlock(limits, tolerances, interlock_memory(limits.channel.size), passing_log())


def with_limits(known: Interlock, more: LimitTable) -> Interlock:
    """Return an interlock that judges by more limits, and shares all else of its memory and log.

    How long the known limits have been passed is as it is now; `passed_on` hands it back.
    """
    count = known.limits.channel.size
    limits = LimitTable(*(np.concatenate(both) for both in zip(known.limits, more, strict=True)))
    outside, active = (np.zeros(limits.channel.size, np.int64) for _ in range(2))
    outside[:count], active[:count] = known.memory.outside, known.memory.active
    memory = known.memory._replace(outside=outside, active=active)
    return known._replace(limits=limits, memory=memory)


def passed_on(widened: Interlock, known: Interlock) -> None:
    """Hand back to `known` how long its limits have been passed, as `with_limits` counted on."""
    count = known.limits.channel.size
    known.memory.outside[:] = widened.memory.outside[:count]
    known.memory.active[:] = widened.memory.active[:count]


@njit(cache=True, error_model="numpy", nogil=True)
def allowed_command(command, homed, tol, memory):
    """Return the command in V that the valve may get: `command` itself if the rig is homed.

    A ram that is not homed goes slowly and pushes gently. A command that would raise the load
    pressure fades to 0 while the load pressure that it makes rises from a quarter to three quarters
    of its limit, and changes its sign beyond that. So a ram at its stroke end stays there with that
    force, even if the valve's null is off. Commands count from the null that the control knows,
    but for 0 V, which is what a valve gets that is to be at rest.
    """
    if homed or command == 0.0:
        return command
    null, limit = tol.null_V, tol.unhomed_command_V
    above = min(max(command - null, -limit), limit)
    load_pressure = memory.values[PRESSURE_1] - memory.values[PRESSURE_2]
    if not load_pressure * above > 0.0:
        return null + above
    pushed = abs(load_pressure) / tol.unhomed_load_pressure_Pa
    if pushed <= _GENTLE:
        return null + above * min((_GENTLE - pushed) / (_GENTLE - _FADING), 1.0)
    return null - _RELIEF * above * min((pushed - _GENTLE) / (1.0 - _GENTLE), 1.0)


@njit(cache=True, error_model="numpy", nogil=True)
def held_position(position, homed, limits):
    """Return the position in m at which to hold a ram: the present one, if it is within limits.

    If it is beyond a limit of the position whose action is a hold or worse, the result is within
    that limit by its hysteresis and 5 mm. A ram that is not homed is held where it is.
    """
    if not homed:
        return position
    for i in range(limits.channel.size):
        if limits.channel[i] == POSITION and limits.action[i] >= _HOLD:
            back = limits.hysteresis[i] + _INWARD_M
            if position < limits.low[i]:
                position = limits.low[i] + back
            elif position > limits.high[i]:
                position = limits.high[i] - back
    return position


class Tick(NamedTuple):
    """The facts about one tick that the interlock judges."""

    inputs: NDArray[np.float64]
    """(len(FAST_INPUTS),): sample of this tick, SI; ignored unless `fresh`."""
    fresh: bool
    """Whether a sample came in this tick."""
    elapsed_ticks: int
    """Number of ticks since the last call: 1, or more if ticks were missed."""
    exchange_ticks: float
    """Duration of this tick's exchange, in ticks."""
    age_ticks: int
    """Number of ticks since the newest sample that the device took."""
    command: float
    """Command in V that this tick's exchange wrote, which the valve gets from now on."""
    counter: float
    """`host_counter` that was written with the command."""
    driving: bool
    """Whether the valve is commanded to be enabled, and the device has confirmed that once."""
    homed: bool
    """Whether the position is known. If not, the limits of the position do not apply, and command
    and load pressure are limited (`unhomed_command_V` and `unhomed_load_pressure_Pa`)."""
    error: float = nan
    """Distance between setpoint and position, m; NaN where the ram follows no setpoint in m."""
    segment: int = 0
    """Number of the segment, for the log of passed limits; 0 on a simulated rig."""
    number: int = 0
    """Number of the tick in the segment, for the same."""
    place: int = 0
    """Index in the segment's setpoints, by which limits hold or not; it is ahead of `number` after
    a stretch of the setpoints was skipped."""


@inlined
def judged_sample(tick, interlock):
    """Return (action, cause, channel) for one tick: numbers of `Action` and `Cause`.

    It must be called at every tick that is not missed, also when no sample came. A trip is returned
    until the memory is cleared. Other actions end with their cause, so that the caller must latch
    an action that it carries out. Unless the tick is `driving`, a cause is only indicated. The
    channel is an index in `LIMITED`, -1 if the cause concerns none.

    Args:
        tick: `Tick`.
        interlock: `Interlock`; its memory is updated.
    """
    inputs, fresh, elapsed_ticks, exchange_ticks, age_ticks = (
        tick.inputs, tick.fresh, tick.elapsed_ticks, tick.exchange_ticks, tick.age_ticks,
    )  # fmt: skip
    command, counter, driving, homed = tick.command, tick.counter, tick.driving, tick.homed
    limits, tol, memory, log = interlock
    sampled = fresh and _take(inputs, tol, memory)
    worst = _chain(driving, tol, memory)
    if worst[0] < _TRIP:
        worst = _device(fresh, sampled, age_ticks, command, counter, tol, memory)
    worst = _worse(worst, _transducers(tol, memory))
    held = command if memory.values[_ENABLED] != 0.0 else 0.0
    why, where = implausible(
        memory.trusted, sampled, elapsed_ticks, exchange_ticks, held, homed, tol, memory.evidence
    )
    worst = _worse(worst, (_TRIP if why != _NONE else _NONE, why, where))
    worst = _worse(worst, _unhomed(command, homed, tol, memory))
    when = tick.segment, tick.number, tick.place
    action, cause, channel = _worse(worst, _limits(homed, tick.error, when, limits, memory, log))
    if memory.latched[0] == _TRIP:
        return memory.latched[0], memory.latched[1], memory.latched[2]
    if not driving:
        return min(action, _INDICATE), cause, channel
    if action == _TRIP:
        memory.latched[0], memory.latched[1], memory.latched[2] = action, cause, channel
    return action, cause, channel


@njit(cache=True, error_model="numpy", nogil=True)
def check_sample(tick, interlock):
    """Return the result of `judged_sample`; this function is compiled once for all callers."""
    return judged_sample(tick, interlock)


@inlined
def _worse(found, other):
    """Return that of two (action, cause, channel) with the higher action; `found` if equal."""
    return other if other[0] > found[0] else found


@inlined
def _take(inputs, tol, memory):
    """Store a fresh sample in the memory; return whether the device took it anew.

    If its `device_counter` has not changed, it repeats the sample before, and False is returned.
    """
    new = isnan(inputs[_COUNTER]) or inputs[_COUNTER] != memory.values[_COUNTER]
    for i in range(inputs.size):
        value = inputs[i]
        memory.missing[i] = memory.missing[i] + 1 if isnan(value) else 0
        if new:
            railed = value <= tol.range_low[i] or value >= tol.range_high[i]
            memory.railed[i] = memory.railed[i] + 1 if railed else 0
            memory.repeated[i] = memory.repeated[i] + 1 if value == memory.values[i] else 0
        if not isnan(value):
            memory.values[i] = value
    return new


@inlined
def _chain(driving, tol, memory):
    """Return (action, cause, channel) by emergency stop, device watchdog and enabling of the valve.

    What the device does not report (NaN) is not judged.
    """
    values = memory.values
    off = driving and values[_ENABLED] == 0.0
    memory.unconfirmed[_DISABLED] = memory.unconfirmed[_DISABLED] + 1 if off else 0
    if values[_ESTOP] == 0.0:
        return _TRIP, Cause.ESTOP_OPEN.value, _ESTOP
    if values[_WATCHDOG] == 1.0:
        return _TRIP, Cause.WATCHDOG_TRIPPED.value, _WATCHDOG
    if memory.unconfirmed[_DISABLED] > tol.confirm_ticks:
        return _TRIP, Cause.VALVE_NOT_ENABLED.value, _ENABLED
    return _NONE, _NONE, NO_CHANNEL


@inlined
def _device(fresh, sampled, age_ticks, command, counter, tol, memory):
    """Return (action, cause, channel) by whether the device does its work.

    It must answer, take samples, take what is written, and put out the command.
    """
    values, ticks, commands = memory.values, memory.unconfirmed, memory.commands
    if fresh or command != commands[0]:
        for i in range(_COMMANDS - 1, 0, -1):
            commands[i] = commands[i - 1]
        commands[0] = command
    if fresh:
        ticks[_NOT_SAMPLED] = 0 if sampled else ticks[_NOT_SAMPLED] + 1
        behind = (counter - values[_ECHO]) % _COUNTERS
        ticks[_NOT_TAKEN] = ticks[_NOT_TAKEN] + 1 if behind > _ECHO_LAG else 0
        output = values[_OUTPUT]
        highest = lowest = commands[0]
        for i in range(1, _COMMANDS):
            highest, lowest = max(highest, commands[i]), min(lowest, commands[i])
        off = output > highest + tol.command_V or output < lowest - tol.command_V
        off = off and values[_ENABLED] != 0.0
        ticks[_NOT_PUT_OUT] = ticks[_NOT_PUT_OUT] + 1 if off else 0
    if max(age_ticks, ticks[_NOT_SAMPLED]) > tol.stale_ticks:
        # Unlike a device that does not answer, this one answered, but with an old sample.
        if ticks[_NOT_SAMPLED] > 0:
            return _TRIP, Cause.DEVICE_STOPPED.value, _COUNTER
        return _TRIP, Cause.STALE_SAMPLE.value, NO_CHANNEL
    if ticks[_NOT_TAKEN] > tol.confirm_ticks:
        return _TRIP, Cause.DEVICE_DEAF.value, _ECHO
    if ticks[_NOT_PUT_OUT] > tol.confirm_ticks:
        return _TRIP, Cause.COMMAND_ECHO.value, _OUTPUT
    return _NONE, _NONE, NO_CHANNEL


@inlined
def _transducers(tol, memory):
    """Judge each channel by itself; return the worst (action, cause, channel).

    A channel must have a value, be within its range, and not freeze. One that does not is NaN in
    `memory.trusted`; the others are copied there.
    """
    worst, cause, channel = _NONE, _NONE, NO_CHANNEL
    if memory.values[_ENCODER_FAULT] == 1.0:
        worst, cause, channel = _TRIP, Cause.ENCODER_FAULT.value, POSITION
    for i in range(memory.values.size):
        memory.trusted[i] = memory.values[i]
        found = _NONE
        if tol.required[i] and memory.missing[i] >= _BAD_SAMPLES:
            found = Cause.SENSOR_NAN.value
        elif memory.railed[i] >= _BAD_SAMPLES:
            found = Cause.SENSOR_RANGE.value
        elif 0 < tol.frozen_samples[i] <= memory.repeated[i]:
            found = Cause.SENSOR_FROZEN.value
        if found != _NONE:
            memory.trusted[i] = np.nan
            # Without these three the ram cannot be held, or its chambers cannot be protected.
            needed = i in (POSITION, PRESSURE_1, PRESSURE_2)
            action = _TRIP if needed else _RAMP_DOWN
            if action > worst:
                worst, cause, channel = action, found, i
    return worst, cause, channel


@inlined
def _unhomed(command, homed, tol, memory):
    """Return (action, cause, channel) by command and load pressure of a ram that is not homed.

    Such a ram may meet its stroke end. For a homed one nothing is wrong.
    """
    if homed:
        return _NONE, _NONE, NO_CHANNEL
    force = memory.values[PRESSURE_1] - memory.values[PRESSURE_2]
    above = command - tol.null_V
    # Only a command that raises the load pressure counts: the opposite one relieves trapped oil.
    pushes = abs(force) > tol.unhomed_load_pressure_Pa and force * above > 0.0
    memory.unconfirmed[_FORCED] = memory.unconfirmed[_FORCED] + 1 if pushes else 0
    if min(abs(command), abs(above)) > tol.unhomed_command_V + tol.command_V:
        return _TRIP, Cause.NOT_HOMED.value, NO_CHANNEL
    if memory.unconfirmed[_FORCED] > tol.confirm_ticks:
        return _TRIP, Cause.HOMING_FORCE.value, PRESSURE_1 if force > 0.0 else PRESSURE_2
    return _NONE, _NONE, NO_CHANNEL


@inlined
def _limits(homed, error, when, limits, memory, log):
    """Judge the limits of all channels; return the worst (action, cause, channel).

    Limits of the position do not count while the ram is not homed. A limit that begins to be passed
    is written to the log.
    """
    worst, cause, channel = _NONE, _NONE, NO_CHANNEL
    segment, number, place = when
    for i in range(limits.channel.size):
        where = limits.channel[i]
        value = error if where == ERROR_AT else memory.values[where]
        back = limits.hysteresis[i] if memory.active[i] else 0.0
        below = value < limits.low[i] + back
        above = value > limits.high[i] - back
        beyond = (below or above) and limits.begin[i] <= place < limits.end[i]
        if (where == POSITION and not homed) or not beyond:
            memory.outside[i] = memory.active[i] = 0
            continue
        memory.outside[i] += 1
        if memory.outside[i] >= limits.ticks[i]:
            if memory.active[i] == 0:
                note_passing(log, segment, number, i, value)
            memory.active[i] = 1
            if limits.action[i] > worst:
                worst, channel = limits.action[i], where
                cause = Cause.LIMIT_LOW.value if below else Cause.LIMIT_HIGH.value
    return worst, cause, channel
