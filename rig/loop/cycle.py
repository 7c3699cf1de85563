"""The loop's cycle, compiled: control and limit the command, estimate, record, once a millisecond.

Row k of a recording has sample k, the filter's estimates after an update by that sample with the
command held since t_{k-1}, and the command that is held from t_k on. This is the same on every
backend. On the simulated one the command of row k follows from sample k; on the wire
(`rig.loop.wire.cycle`) it follows from sample k-1, since command and sample travel in one
transaction.
"""

from math import isnan, nan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control import (
    ChangeMemory,
    ControlLaw,
    ControlMemory,
    Moment,
    Steered,
    is_changing,
    offset_of_change,
    proportional_command,
    tracking_command,
)
from estimator.filters import OUTPUTS, filter_start, filter_step
from rig.channels import READINGS
from rig.io import FAST_INPUTS, Corrections, correct
from rig.jit import njit
from rig.loop.interlocks import NO_CHANNEL, Action, Cause, Interlock, Tick, judged_sample
from rig.plant import (
    READING_COUNT,
    SUBSTEPS,
    TICK,
    Parameters,
    SensorParameters,
    drive,
    follow,
    inlined,
    open_leaks,
    read_sensors,
    spring_force,
)

from .decided import DECIDED
from .reaction import ACTED, Reaction, react, tolerating

TRUTH: Final = (
    "true_position_m",
    "true_velocity_m_per_s",
    "true_pressure_1_Pa",
    "true_pressure_2_Pa",
    "true_supply_pressure_Pa",
    "true_return_pressure_Pa",
    "true_leak_1_m3_per_s",
    "true_leak_2_m3_per_s",
    "true_leak_internal_m3_per_s",
)
READINGS_AT: Final = 3
_OUTPUTS_AT: Final = READINGS_AT + READING_COUNT
STATES_AT: Final = _OUTPUTS_AT + len(OUTPUTS)
DECISION_COLUMNS: Final = len(DECIDED) + len(ACTED)
"""Number of columns behind the filter's states: the decision, and the loop's reaction to it."""
_DECIDED: Final = len(DECIDED)
_ACTED: Final = len(ACTED)

Array = NDArray[np.float64]


class Guard(NamedTuple):
    """The interlock that judges a simulated rig's samples in its loop, and what it has found."""

    watched: bool
    """Whether the samples are judged at all."""
    interlock: Interlock
    """The interlock that judges them."""
    ends_from: int
    """The least `Action` that ends the run of ticks."""
    stopped: NDArray[np.int64]
    """(3,): action, cause and channel of the worst action so far."""
    inputs: NDArray[np.float64]
    """(len(FAST_INPUTS),): the sample that was judged last."""
    lead: int
    """Number of setpoints that the test has skipped so far."""


def guard(interlock: Interlock, watched: bool) -> Guard:
    """Return the guard of a test that begins; a hold and any worse action will end its ticks.

    Unless `watched`, no sample is judged.
    """
    stopped, inputs = np.array([0, 0, NO_CHANNEL]), np.full(len(FAST_INPUTS), nan)
    return Guard(watched, interlock, int(Action.HOLD), stopped, inputs, 0)


def sample_channels(states: tuple[str, ...], open_loop: bool) -> tuple[str, ...]:
    """Return the names of the columns that `sample_row` fills, for a filter with these states.

    `open_loop` says whether the setpoint is a command (`setpoint_V`) or a position (`setpoint_m`).
    """
    setpoint = "setpoint_V" if open_loop else "setpoint_m"
    estimates = tuple(f"est_{state}" for state in states)
    return ("time_s", setpoint, "command_V", *READINGS, *OUTPUTS, *estimates, *DECIDED, *ACTED)


def row_channels(states: tuple[str, ...], open_loop: bool) -> tuple[str, ...]:
    """Return the names of a simulated rig's columns: those of `sample_channels`, then `TRUTH`."""
    return (*sample_channels(states, open_loop), *TRUTH)


@inlined
def limited_command(open_loop, setpoint, position, gain, limit):
    """Return the command in V within +-`limit`, of the position loop or of an open loop.

    In open loop the setpoint (V) is the command; else it is in m, as the measured `position` is,
    and `gain` in V/m. A setpoint of NaN, or outside open loop a position of NaN, gives 0 V, the
    valve's null.
    """
    if not open_loop:
        return proportional_command(setpoint, position, gain, limit)
    if isnan(setpoint):
        return 0.0
    return min(max(setpoint, -limit), limit)


@inlined
def sample_row(starts, begin, held, reading, filt, decided, acted, row):
    """Update the filter by one sample, and fill the row's `sample_channels`.

    Args:
        starts: whether this is the sample that starts the filter.
        begin: the first numbers of the row: time of the sample in s; setpoint in m, or V in open
            loop; command in V that is held from this sample on.
        held: command in V that was held up to this sample.
        reading: (9,) in the order of `READINGS`; the filter skips values that are NaN.
        filt: the filter, `CompiledFilter`; updated, or started by the sample.
        decided: (len(DECIDED),) the newest decision.
        acted: (len(ACTED),) the loop's reaction to it.
        row: filled from its start in the order of `sample_channels`; the filter's `OUTPUTS` are NaN
            for the sample that starts it.
    """
    for i in range(READING_COUNT):
        row[READINGS_AT + i] = reading[i]
    outputs = row[_OUTPUTS_AT:STATES_AT]
    seen = (reading[0], reading[1], reading[2], reading[3], reading[4])
    if starts:
        outputs[:] = np.nan
        filter_start(filt, begin[2], seen)
    else:
        filter_step(filt, held, seen, outputs)
    # An assignment to a slice would bring the text of its error along: a second of compiling.
    states = filt.x.size
    for i in range(states):
        row[STATES_AT + i] = filt.x[i]
    for i in range(_DECIDED):
        row[STATES_AT + states + i] = decided[i]
    for i in range(_ACTED):
        row[STATES_AT + states + _DECIDED + i] = acted[i]
    row[0], row[1], row[2] = begin


class Ticks(NamedTuple):
    """The setpoints, faults and noise of a simulated rig, tick by tick."""

    setpoint: Array
    """(ticks,) in m, or in V in open loop."""
    faults: Array
    """(ticks, 8) coefficients (`rig.plant.faults.FaultInput`)."""
    feedforward: Array
    """(ticks,) feedforward of the position loop in V; (0,) for none."""
    expected: Array
    """(ticks,) position in m that the integral part goes by; (0,) for the setpoint."""
    noise: Array
    """(ticks, 9) standard normal numbers, for the noise of the transducers."""


class Steering(NamedTuple):
    """How the command follows from setpoint and position."""

    open_loop: bool
    """Whether the setpoint itself is the command."""
    gain: float
    """Gain of the position loop, V/m."""
    limit: float
    """Greatest command of either sign, V."""
    on_fault: int
    """`Reaction` that the test asks for after a confirmed fault."""
    law: ControlLaw
    """What the position loop adds to gain times error."""
    tones: Array
    """(n, TONE_NUMBERS) frequencies of the setpoint that are corrected."""
    memory: ControlMemory
    """Memory of the position loop; updated."""
    before: Steered
    """The law before the last change of control, with its feedforward at the first of the ticks; as
    now without one."""
    change: ChangeMemory
    """Memory of the changes of control; updated."""


class TrueRig(NamedTuple):
    """The true state and parameters of a simulated rig.

    All arrays but `offsets`, `fitted` and those of `corrections` are updated by each tick.
    """

    plant: Array
    """(9,) true state, `rig.plant.dynamics.PlantState`."""
    path: Array
    """Memory of what lies between command and plant (`rig.plant.command_effects`)."""
    seen: Array
    """The transducers' memory (`rig.plant.transducer_effects`)."""
    meters: Array
    """(3,) lag states of the flow meters, m^3/s."""
    offsets: Array
    """(3,) fixed errors of the flow meters, m^3/s."""
    fitted: Array
    """(9,) 1 for each transducer that the rig has, NaN for the others."""
    held: Array
    """(1,) command held since the last tick, V."""
    parameters: Parameters
    """The true parameters of the rig, SI."""
    sensors: SensorParameters
    """Data sheet of its transducers."""
    corrections: Corrections
    """Calibrations of its transducers, by which the readings are corrected."""


@njit(cache=True, error_model="numpy", nogil=True)
def simulated_ticks(first, ticks, how, rig, filt, decided, reaction, guard, rows):
    """Run ticks on the simulated backend until `rows` is full or an action ends them.

    An action of the interlock ends them if it is `guard.ends_from` or worse; so does the trip that
    a test asks for after a confirmed fault. If the interlock trips on a sample, the valve is at
    null from that sample on.

    Args:
        first: number of the first tick; tick 0 starts the filter.
        ticks: `Ticks`, as many as there are rows.
        how: `Steering`.
        rig: `TrueRig`; updated.
        filt: the filter, `CompiledFilter`; updated.
        decided: (len(DECIDED),) the newest decision.
        reaction: `ReactionMemory`; updated.
        guard: `Guard` that judges every sample; updated.
        rows: (ticks, columns) to fill, in the order of `row_channels`.

    Returns:
        The number of rows filled. If the interlock stopped the ticks, the last row is that of the
        sample for which it did so. The tick at which a confirmed fault trips has no row.
    """
    plant, par, held, noise = rig.plant, rig.parameters, rig.held, ticks.noise
    on_fault, gain, limit, faults = how.on_fault, how.gain, how.limit, ticks.faults
    reading = np.empty(READING_COUNT)
    truth = STATES_AT + filt.x.size + DECISION_COLUMNS
    for k in range(rows.shape[0]):
        row, time_s = rows[k], (first + k) * TICK
        action = react(on_fault, decided, time_s, reaction)
        if action == Reaction.TRIP:
            _stop(Action.TRIP.value, Cause.FAULT_CONFIRMED.value, NO_CHANNEL, guard)
            held[0] = 0.0
            return k
        # A tuple is used because numba counts references to an array wherever it is passed on.
        fault = (
            faults[k, 0], faults[k, 1], faults[k, 2], faults[k, 3], faults[k, 4], faults[k, 5],
            faults[k, 6], faults[k, 7],
        )  # fmt: skip
        leaks = open_leaks(plant, par, fault)
        load = spring_force(plant[4], par)
        read_sensors(
            plant, rig.seen, leaks, load, rig.meters, rig.offsets, noise[k], par, rig.sensors,
            reading,
        )  # fmt: skip
        for i in range(READING_COUNT):
            reading[i] *= rig.fitted[i]
        correct(reading, rig.corrections)
        wanted = ticks.setpoint[k]
        if action == Reaction.HOLD:
            if isnan(reaction.held_at[0]):
                reaction.held_at[0] = reading[0]
            command = limited_command(False, reaction.held_at[0], reading[0], gain, limit)
            wanted = nan if how.open_loop else reaction.held_at[0]
        else:
            if how.open_loop:
                command = limited_command(True, wanted, reading[0], gain, limit)
            else:
                ahead = ticks.feedforward[k] if k < ticks.feedforward.size else 0.0
                if is_changing(how.change):
                    ahead += offset_of_change(
                        Moment(wanted, reading[0], time_s, limit, TICK), how.before,
                        Steered(gain, how.law, ahead, how.tones), how.memory, how.change,
                    )  # fmt: skip
                expected = ticks.expected[k] if k < ticks.expected.size else wanted
                command = tracking_command(
                    wanted, reading[0], ahead, expected, time_s, gain, limit, TICK, how.law,
                    how.tones, how.memory,
                )  # fmt: skip
                command = tolerating(
                    command, on_fault, decided, filt.x, filt.parameters, limit, TICK, reaction
                )
        error = nan if how.open_loop else abs(wanted - reading[0])
        judged = judge(reading, command, error, first + k, guard)
        if judged == Action.TRIP.value:
            command = 0.0
        sample_row(
            first + k == 0, (time_s, wanted, command), held[0], reading, filt, decided,
            reaction.acted, row,
        )  # fmt: skip
        held[0] = command
        row[truth] = plant[4]
        row[truth + 1] = plant[5]
        row[truth + 2] = max(plant[2], 0.0)
        row[truth + 3] = max(plant[3], 0.0)
        row[truth + 4] = plant[7]
        row[truth + 5] = plant[8]
        row[truth + 6] = leaks[0]
        row[truth + 7] = leaks[1]
        row[truth + 8] = leaks[2]
        drive(plant, rig.path, command, par, fault, SUBSTEPS)
        follow(rig.seen, plant, par)
        if judged >= guard.ends_from:
            return k + 1
    return rows.shape[0]


@inlined
def judge(reading, command, error, number, guard):
    """Return the interlock's `Action` on a sample, and note it in the guard if it is the worst.

    The action is NONE, and nothing is noted, if the guard is not `watched`. No device is between a
    simulated rig and its loop. So every sample is fresh, and the channels by which a device reports
    its own state are NaN.

    Args:
        reading: (9,) in the order of `READINGS`.
        command: command in V that is held from this sample on.
        error: distance between setpoint and position, m; NaN in open loop.
        number: number of the tick.
        guard: `Guard`; updated.
    """
    if not guard.watched:
        return Action.NONE.value
    for i in range(READING_COUNT):
        guard.inputs[i] = reading[i]
    tick = Tick(
        guard.inputs, True, 1, 0.0, 0, command, 0.0, True, True, error, 0, number,
        number + guard.lead,
    )  # fmt: skip
    action, cause, channel = judged_sample(tick, guard.interlock)
    if action > guard.stopped[0]:
        _stop(action, cause, channel, guard)
    return action


@inlined
def _stop(action, cause, channel, guard):
    guard.stopped[0], guard.stopped[1], guard.stopped[2] = action, cause, channel
