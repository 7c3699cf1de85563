"""The rig's own plant side by side in lanes (`rig.lanes`): eight runs, or one and its slopes.

The same physics as `actuator`, to the last digits, by the same laws (`rig.plant.memory_laws`): each
lane has its own state, parameters and memory, and takes the integration steps that its own motion
asks for. Of what `command_path` and `transducers` keep, the memory here holds what samples that
follow one another need: no times. So the last samples are looked up by their number here, and by
their time there, where the emulated rig is looked at whenever anybody asks.
"""

from collections.abc import Mapping, Sequence
from math import exp, floor
from typing import Final

import numpy as np

from estimator.gap.plant import (
    DRIVE_IN_LANES,
    READ_IN_LANES,
    REMEMBER_IN_LANES,
    STEP_IN_LANES,
    Array,
    InLanes,
)
from rig.jit import njit
from rig.lanes import align_stack, anywhere, gather, load, load_fields, select, store
from rig.plant import (
    LONGEST_DELAY_TICKS,
    NO_FAULT,
    NO_FRACTION,
    SHORTEST,
    SUBSTEPS,
    TICK,
    Parameters,
    inlined,
    lagged,
    next_step,
    play,
    reading_means,
    resolving_step,
    whole_ticks,
)

from .memory import SEEN_1, SEEN_2, parameters_of

_FAULT: Final = tuple(NO_FAULT)
_FRICTION_LAW: Final = Parameters._fields.index("friction_law")
_TERM_KINDS: Final = tuple(name for name in Parameters._fields if name.endswith("_kind"))
_LAPS: Final = ("valve_deadband", "valve_underlap_leakage", "valve_flow_asymmetry")

# Rows of the memory: how many samples there were, the commands of the last 20 ms and of now, the
# spool's reference behind the play before and after the step, the encoder behind its own play now
# and at the samples before, how far what it shows is behind the ram, the ram's position before the
# step and when last remembered, and what has been corrected of that.
_KEPT: Final = LONGEST_DELAY_TICKS + 2
_COUNT: Final = 0
_COMMANDS: Final = 1
_REFERENCE: Final = _COMMANDS + _KEPT
_NEXT_REFERENCE: Final = _REFERENCE + 1
_ENCODERS: Final = _NEXT_REFERENCE + 1
_BEHIND: Final = _ENCODERS + _KEPT
_STEPPED: Final = _BEHIND + 1
_REMEMBERED: Final = _STEPPED + 1
_CORRECTED: Final = _REMEMBERED + 1
_MEMORY: Final = _CORRECTED + 1


def _begin(states: Array, inputs: Array, values: Sequence[Mapping[str, float]]) -> Array:
    """Return the memory (rows, LANES) of rigs long in their states (states, LANES)."""
    command = inputs[0, 0]
    memory = np.zeros((_MEMORY, len(values)))
    memory[_COMMANDS : _COMMANDS + _KEPT] = command
    half = np.array([each["valve_hysteresis"] for each in values])
    asked = np.array([each["valve_gain"] for each in values]) * command
    memory[_REFERENCE] = [play.py_func(*each) for each in zip(states[0], asked, half, strict=True)]
    memory[_ENCODERS : _ENCODERS + _KEPT] = states[4]
    memory[_REMEMBERED] = states[4]
    return memory


@njit(DRIVE_IN_LANES, cache=True, error_model="numpy")
def _drive(inputs, memory):
    memory[_COUNT] += 1.0
    memory[_COMMANDS + int(memory[_COUNT, 0]) % _KEPT] = inputs[0]


@inlined
def _kept(memory, first, back):
    """Return what was kept in the ring from row `first` on, so many samples ago (lanes)."""
    at = load(memory, _COUNT) - back
    return gather(memory, first + (at - _KEPT * floor(at * (1.0 / _KEPT) + 1e-9)))


@inlined
def _ticks(delay):
    """Return the whole ticks of a delay in s, and what is left of it, in ticks."""
    whole = whole_ticks(delay * (1.0 / TICK))
    part = delay * (1.0 / TICK) - whole
    return whole, select(part < NO_FRACTION, 0.0, part)


@inlined
def _advance(states, command, par, duration):
    """Advance the plant's nine states (rows, LANES) in place over a time in s of each lane."""
    y = (
        load(states, 0), load(states, 1), load(states, 2), load(states, 3), load(states, 4),
        load(states, 5), load(states, 6), load(states, 7), load(states, 8),
    )  # fmt: skip
    longest = resolving_step(y, duration * (1.0 / SUBSTEPS), duration, par, _FAULT)
    shortest = (SHORTEST / SUBSTEPS) * duration
    remaining = duration
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
    """Return pressures in Pa behind their lags, one tick later."""
    later = lagged(seen, before, max(pressure, 0.0), lag * (1.0 / TICK), exp(-TICK / lag))
    return select(lag == 0.0, pressure, later)


@njit(STEP_IN_LANES, cache=True, error_model="numpy")
def _step(states, memory, parameters, first):
    align_stack()
    par = load_fields(parameters, parameters_of(first), _FRICTION_LAW)
    store(memory, _STEPPED, load(states, 4))
    before_1, before_2 = max(load(states, 2), 0.0), max(load(states, 3), 0.0)
    whole, late = _ticks(par.command_delay)
    command = _kept(memory, _COMMANDS, whole)
    earlier = select(late > 0.0, _kept(memory, _COMMANDS, whole + 1.0), command)
    half, gain = par.valve_hysteresis, par.valve_gain
    reference = load(memory, _REFERENCE)
    # A loop, not two copies: it is long, and takes long to compile.
    for part in range(2):
        acting, duration = earlier, TICK * late
        if part == 1:
            acting, duration = command, TICK - TICK * late
        reference = play(reference, gain * acting, half)
        if anywhere(duration > 0.0):
            _advance(states, select(half != 0.0, reference / gain, acting), par, duration)
    store(memory, _NEXT_REFERENCE, reference)
    lag = par.pressure_lag
    store(states, SEEN_1, _lagging(load(states, SEEN_1), before_1, load(states, 2), lag))
    store(states, SEEN_2, _lagging(load(states, SEEN_2), before_2, load(states, 3), lag))


@njit(REMEMBER_IN_LANES, cache=True, error_model="numpy")
def _remember(states, memory, parameters, first):
    par = load_fields(parameters, parameters_of(first), _FRICTION_LAW)
    store(memory, _REFERENCE, load(memory, _NEXT_REFERENCE))
    count, position = int(memory[_COUNT, 0]), load(states, 4)
    # See `actuator`: what a late reading corrects, it corrects of the past as well.
    moved = load(memory, _CORRECTED) + (load(memory, _STEPPED) - load(memory, _REMEMBERED))
    corrected = select(par.position_delay != 0.0, moved, 0.0)
    store(memory, _CORRECTED, corrected)
    store(memory, _REMEMBERED, position)
    position = position - corrected
    before = load(memory, _ENCODERS + (count - 1) % _KEPT)
    encoder = play(before, position, 0.5 * par.position_backlash)
    store(memory, _ENCODERS + count % _KEPT, encoder)
    whole, part = _ticks(par.position_delay)
    later, earlier = _kept(memory, _ENCODERS, whole), _kept(memory, _ENCODERS, whole + 1.0)
    # Before the first sample it was where it began, to the end of that sample's interval.
    part = select(whole + 1.0 >= load(memory, _COUNT), select(part > 0.0, 1.0, 0.0), part)
    store(memory, _BEHIND, position - (later + (earlier - later) * part))


@njit(READ_IN_LANES, cache=True, error_model="numpy")
def _read(states, memory, parameters, first, readings):
    par = load_fields(parameters, parameters_of(first), _FRICTION_LAW)
    means = reading_means(
        load(states, 4) - load(memory, _BEHIND), load(states, SEEN_1), load(states, SEEN_2),
        load(states, 0), load(states, 7), par,
    )  # fmt: skip
    store(readings, 0, means.position)
    store(readings, 1, means.pressure_1)
    store(readings, 2, means.pressure_2)
    store(readings, 3, means.spool)


def _kind(values: Mapping[str, float]) -> tuple[float, ...] | None:
    """Return what rigs must have in common: what makes the steps of all others its own too.

    A supply that ripples takes eight times the steps, and runs alone.
    """
    if values["supply_ripple"] != 0.0:
        return None
    ticks = values["command_delay"] / TICK + NO_FRACTION
    return (
        values["friction_law"],
        float(ticks % 1.0 >= 2.0 * NO_FRACTION),
        float(any(values[name] != 0.0 for name in _LAPS)),
        float(values["entrained_air"] != 0.0),
        *(values[name] for name in _TERM_KINDS),
    )


IN_LANES: Final = InLanes(_begin, _drive, _step, _remember, _read, _kind)
