"""Compiled ticks of simulated rigs in lanes (`rig.lanes`): plants first, then transducers.

Each lane takes as many integration steps as its own motion needs, and goes on to its next tick
while other lanes are still in an earlier one. Otherwise all lanes would wait for the one whose ram
sticks and slips. One step of all lanes together is one row of a log, and each lane notes in which
row each of its ticks begins. The position loop needs only the encoder, which has no noise, so that
the other transducers can be sampled later, tick by tick.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.io import FAST_INPUTS
from rig.jit import njit
from rig.lanes import align_stack, anywhere, gather, load, load_fields, scatter, select, store
from rig.plant import (
    SHORTEST,
    TICK,
    Parameters,
    PlantState,
    encoder_position,
    inlined,
    next_step,
    noisy_readings,
    reading_means,
    resolving_step,
)

from .lane_control import tracking_lanes

LOGGED: Final = 7
"""Number of quantities that each step writes to the log for every lane: what the transducers
measure, the return pressure, and the command. A small log stays in the processor's cache."""
LOGGED_OF_CHAMBERS: Final = 5
"""The same number without spool and supply pressure, for a filter that does not use them."""
POSITION, PRESSURE_1, PRESSURE_2, COMMAND, RETURN, SPOOL, SUPPLY = range(LOGGED)
"""Indices of these quantities in a step of the log."""
MOST_STEPS: Final = 80
"""Number of steps that are enough for a tick: 64 of the shortest length, and some that end where a
ram comes to rest."""

LANE_READINGS: Final = (*FAST_INPUTS[:5], "command_V")
"""Quantities in a sample of rigs in lanes: measured values, and the command from then on."""
READING_COUNT: Final = len(LANE_READINGS)
NOISE_COUNT: Final = 4

_FRICTION_LAW: Final = Parameters._fields.index("friction_law")
_SPOOL: Final = PlantState._fields.index("spool")
_PRESSURE_1: Final = PlantState._fields.index("pressure_1")
_PRESSURE_2: Final = PlantState._fields.index("pressure_2")
_POSITION: Final = PlantState._fields.index("position")
_SUPPLY: Final = PlantState._fields.index("supply_pressure")
_RETURN: Final = PlantState._fields.index("return_pressure")


class LoopSetting(NamedTuple):
    """How simulated rigs are driven, and how finely they are simulated."""

    gain: float
    """Gain of the position loop, V/m, for rigs without a `LaneGuide`."""
    limit: float
    """Greatest command of either sign, V."""
    longest_step: float
    """Longest step of the integration in s, from `rig.plant.integrator.LONGEST_STEP` to a tick."""


class LaneRigs(NamedTuple):
    """Simulated rigs, one in each lane."""

    plant: NDArray[np.float64]
    """(9, LANES) true states, `PlantState`; they are updated."""
    parameters: NDArray[np.float64]
    """(fields, LANES), `Parameters` of each rig; all rigs have the same friction law."""
    faults: NDArray[np.float64]
    """(8, LANES) coefficients (`rig.plant.faults.FaultInput`)."""
    onset: NDArray[np.float64]
    """(1, LANES), number of the tick from which on the faults act."""
    growth: NDArray[np.float64] | None = None
    """(ticks, LANES), factor on the coefficients in each tick from tick 0 on, for faults that
    change with time; `onset` then has no effect on the plants. None for faults that act in full
    from their onset on, which is compiled apart."""


@inlined
def _log_step(log, first, y, command):
    """Write the states in `y` that transducers measure, and the command, to one step of the log."""
    store(log, first + POSITION, y[_POSITION])
    store(log, first + PRESSURE_1, y[_PRESSURE_1])
    store(log, first + PRESSURE_2, y[_PRESSURE_2])
    store(log, first + COMMAND, command)
    store(log, first + RETURN, y[_RETURN])
    if log.shape[1] == LOGGED:
        store(log, first + SPOOL, y[_SPOOL])
        store(log, first + SUPPLY, y[_SUPPLY])


@inlined
def _faults_at(faults, growth, acts, tick):
    """Return the eight fault coefficients at each lane's tick.

    Without `growth` they are 0 in lanes where `acts` is false, else in proportion to `growth`.
    """
    if growth is not None:
        grown = gather(growth, min(max(tick, 0.0), growth.shape[0] - 1.0))
        return (
            grown * load(faults, 0),
            grown * load(faults, 1),
            grown * load(faults, 2),
            grown * load(faults, 3),
            grown * load(faults, 4),
            grown * load(faults, 5),
            grown * load(faults, 6),
            grown * load(faults, 7),
        )
    return (
        select(acts, load(faults, 0), 0.0),
        select(acts, load(faults, 1), 0.0),
        select(acts, load(faults, 2), 0.0),
        select(acts, load(faults, 3), 0.0),
        select(acts, load(faults, 4), 0.0),
        select(acts, load(faults, 5), 0.0),
        select(acts, load(faults, 6), 0.0),
        select(acts, load(faults, 7), 0.0),
    )


@njit(cache=True, error_model="numpy", nogil=True)
def plant_ticks(first, setpoint, open_loop, loop, guide, rigs, like, sensors, log, rows):
    """Advance plants and position loops by as many ticks as there are setpoints.

    Args:
        first: number of the first tick.
        setpoint: (ticks, LANES) in m, or in V in open loop.
        open_loop: (1, LANES) for all ticks or (ticks, LANES); where it is not 0, the setpoint is
            the command.
        loop: `LoopSetting`.
        guide: `LaneGuide`; what its control laws remember is updated. None if all rigs have the
            proportional loop with the gain of `loop`; that is compiled apart, so that nothing of
            the tracking law slows it.
        rigs: `LaneRigs`; their plants are updated.
        like: any `Parameters` with the friction law of all rigs.
        sensors: `SensorParameters`.
        log: (steps, `LOGGED` or `LOGGED_OF_CHAMBERS`, LANES), which is filled; `MOST_STEPS` steps
            for each tick are enough.
        rows: (ticks, LANES), filled with the row of the log in which each tick of a lane begins.

    Returns:
        Whether the log was long enough; if not, the plants stay as they were.
    """
    align_stack()
    plant = rigs.plant
    par = load_fields(rigs.parameters, like, _FRICTION_LAW)
    ticks, always = setpoint.shape[0], open_loop.shape[0] == 1
    gain, limit, longest_step = loop
    shortest = SHORTEST * longest_step
    until_onset = load(rigs.onset, 0) - first
    y = (
        load(plant, 0), load(plant, 1), load(plant, 2), load(plant, 3), load(plant, 4),
        load(plant, 5), load(plant, 6), load(plant, 7), load(plant, 8),
    )  # fmt: skip
    nothing = 0.0 * load(rigs.onset, 0)
    next_tick, remaining, longest, command = nothing, nothing, nothing, nothing
    for row in range(log.shape[0]):
        begins = (remaining <= 0.0) & (next_tick < ticks)
        tick = min(next_tick, ticks - 1.0)
        next_tick = select(begins, next_tick + 1.0, next_tick)
        acts = next_tick > until_onset
        fault = _faults_at(rigs.faults, rigs.growth, acts, first + next_tick - 1.0)
        if anywhere(begins):
            position = encoder_position(par.position_gain * y[_POSITION], sensors)
            asked = gather(setpoint, tick)
            is_open = load(open_loop, 0) if always else gather(open_loop, tick)
            if guide is None:
                closed = gain * (asked - position)
            else:
                where = begins & (is_open == 0.0)
                closed = tracking_lanes(asked, position, first + tick, where, limit, guide)
            asked = select(is_open == 0.0, closed, asked)
            command = select(begins, min(max(asked, -limit), limit), command)
            longest = select(begins, resolving_step(y, longest_step, TICK, par, fault), longest)
            remaining = select(begins, TICK, remaining)
            scatter(rows, tick, nothing + row, begins)
        if not anywhere(remaining > 0.0):
            for state in range(len(y)):
                store(plant, state, y[state])
            return True
        _log_step(log, row * log.shape[1], y, command)
        y, remaining = next_step(y, remaining, longest, shortest, command, par, fault)
    return False


@njit(cache=True, error_model="numpy", nogil=True)
def reading_ticks(log, rows, noise, parameters, like, sensors, readings):
    """Sample the transducers at every tick.

    Args:
        log: (steps, `LOGGED`, LANES), as `plant_ticks` has filled it.
        rows: (ticks, LANES), as `plant_ticks` has filled it.
        noise: (ticks, 4, LANES) standard normal numbers, for pressures 1 and 2, spool, supply.
        parameters: (fields, LANES), `Parameters` of each rig.
        like: any `Parameters` with the friction law of all rigs.
        sensors: `SensorParameters`.
        readings: (ticks, 6, LANES), filled with `LANE_READINGS`.
    """
    par = load_fields(parameters, like, _FRICTION_LAW)
    for k in range(rows.shape[0]):
        row = load(rows, k) * LOGGED
        first, drawn = k * READING_COUNT, k * NOISE_COUNT
        shown = reading_means(
            gather(log, row + POSITION), gather(log, row + PRESSURE_1),
            gather(log, row + PRESSURE_2), gather(log, row + SPOOL), gather(log, row + SUPPLY),
            par,
        )  # fmt: skip
        position, p1, p2, spool, supply = noisy_readings(
            shown, load(noise, drawn), load(noise, drawn + 1), load(noise, drawn + 2),
            load(noise, drawn + 3), sensors,
        )  # fmt: skip
        store(readings, first, position)
        store(readings, first + 1, p1)
        store(readings, first + 2, p2)
        store(readings, first + 3, spool)
        store(readings, first + 4, supply)
        store(readings, first + 5, gather(log, row + COMMAND))
