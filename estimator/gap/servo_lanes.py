"""The rig's own plant side by side in lanes (`rig.plant.lanes`): eight runs, or one and its slopes.

What reaches the plants of the command is the same in all lanes, and goes its path once. Each lane
has its own state and parameters, and takes the integration steps that its own motion asks for.
"""

from collections.abc import Mapping
from math import exp
from typing import Final

from numba import njit

from rig.plant import NO_FAULT, Parameters
from rig.plant.command_path import PATH_SIZE, delayed_command, followed_command
from rig.plant.compiled import inlined
from rig.plant.integrator import SUBSTEPS, TICK, next_step
from rig.plant.lanes import anywhere, load, load_fields, select, store
from rig.plant.step_length import SHORTEST, resolving_step
from rig.plant.transducers import reading_means

from .plant import READ_IN_LANES, STEP_IN_LANES, InLanes
from .servo_memory import COMMAND, NEXT, PATH, SEEN_1, SEEN_2, parameters_of

_FAULT: Final = tuple(NO_FAULT)
_FRICTION_LAW: Final = Parameters._fields.index("friction_law")
_TERM_KINDS: Final = tuple(name for name in Parameters._fields if name.endswith("_kind"))


@inlined
def _advance(states, command, par, duration):
    """Advance the plant's nine states (rows, LANES) in place over a time in s."""
    y = (
        load(states, 0), load(states, 1), load(states, 2), load(states, 3), load(states, 4),
        load(states, 5), load(states, 6), load(states, 7), load(states, 8),
    )  # fmt: skip
    longest = resolving_step(y, duration / SUBSTEPS, duration, par, _FAULT)
    shortest = SHORTEST * duration / SUBSTEPS
    remaining = duration + 0.0 * par.piston_area
    while anywhere(remaining > 0.0):
        y, remaining = next_step(y, remaining, longest, shortest, command, par, _FAULT)
    store(states, 0, y[0])
    store(states, 1, y[1])
    store(states, 2, y[2])
    store(states, 3, y[3])
    store(states, 4, y[4])
    store(states, 5, y[5])
    store(states, 6, y[6])
    store(states, 7, y[7])
    store(states, 8, y[8])


@inlined
def _lagging(seen, before, pressure, lag):
    """Return pressures in Pa behind their lags, one tick later (`rig.plant.transducers`)."""
    after = max(pressure, 0.0)
    behind = (after - before) * (lag / TICK)
    later = after - behind + exp(-TICK / lag) * (seen - before + behind)
    return select(lag == 0.0, pressure, later)


@njit(STEP_IN_LANES, cache=True, error_model="numpy")
def _step(states, memory, parameters, first):
    path = memory[NEXT : NEXT + PATH_SIZE]
    path[:] = memory[PATH : PATH + PATH_SIZE]
    like = parameters_of(first)
    par = load_fields(parameters, like, _FRICTION_LAW)
    before_1, before_2 = max(load(states, 2), 0.0), max(load(states, 3), 0.0)
    before, following, late = memory[COMMAND], memory[COMMAND], 0.0
    if like.command_delay != 0.0:
        before, following, late = delayed_command(path, memory[COMMAND], like.command_delay)
    # A loop, not two copies: it is long, and takes long to compile.
    for part in range(2):
        command, duration = before, late
        if part == 1:
            command, duration = following, TICK - late
        if duration > 0.0:
            _advance(states, followed_command(path, command, like), par, duration)
    lag = par.pressure_lag
    store(states, SEEN_1, _lagging(load(states, SEEN_1), before_1, load(states, 2), lag))
    store(states, SEEN_2, _lagging(load(states, SEEN_2), before_2, load(states, 3), lag))


@njit(READ_IN_LANES, cache=True, error_model="numpy")
def _read(states, memory, parameters, first, readings):
    par = load_fields(parameters, parameters_of(first), _FRICTION_LAW)
    means = reading_means(
        load(states, 4), load(states, SEEN_1), load(states, SEEN_2), load(states, 0),
        load(states, 7), par,
    )  # fmt: skip
    store(readings, 0, means.position)
    store(readings, 1, means.pressure_1)
    store(readings, 2, means.pressure_2)
    store(readings, 3, means.spool)


def _kind(values: Mapping[str, float]) -> tuple[float, ...] | None:
    """Return what rigs must have in common: their laws, and what becomes of the command.

    Where one has laps or air, all others would take its steps too, and differ from a run alone.
    """
    if values["supply_ripple"] != 0.0:
        return None
    play = values["valve_hysteresis"]
    laps = ("valve_deadband", "valve_underlap_leakage", "valve_flow_asymmetry")
    return (
        values["friction_law"],
        values["command_delay"],
        play,
        values["valve_gain"] if play else 0.0,
        float(any(values[name] != 0.0 for name in laps)),
        float(values["entrained_air"] != 0.0),
        *(values[name] for name in _TERM_KINDS),
    )


IN_LANES: Final = InLanes(_step, _read, _kind)
