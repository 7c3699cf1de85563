"""The servo-actuator in lanes (`rig.lanes`): eight runs, or one run and its slopes, side by side.

The physics is that of `actuator` but for rounding, by the same laws (`rig.plant.memory_laws`). Each
lane has its own state, parameters and memory, and takes the integration steps that its own motion
needs. The memory holds less than that of `command_path` and `transducers`: only what consecutive
samples need, and no times. Past samples are looked up here by their number. Those functions look
them up by their time, because the emulated rig may be read at any moment.

`parameters_of` and the states behind the lag of the transducers are those of a rig alone as well.
"""

from collections.abc import Mapping, Sequence
from math import exp, floor
from typing import Any, Final

import numba.extending
import numpy as np
from numba import types
from numba.core import cgutils
from numpy.typing import NDArray

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

SEEN_1: Final = 9
SEEN_2: Final = 10
"""SEEN_1 and SEEN_2 are the indices of the pressures behind the lag of their transducers. These
states come after the rig's own."""
_SUPPLY: Final = 7
_RETURN: Final = 8
"""Indices of the pressures of supply and return, which come after the states of valve and ram."""
_FAULT: Final = tuple(NO_FAULT)
_FRICTION_LAW: Final = Parameters._fields.index("friction_law")
_TERM_KINDS: Final = tuple(name for name in Parameters._fields if name.endswith("_kind"))
_LAPS: Final = ("valve_deadband", "valve_underlap_leakage", "valve_flow_asymmetry")

# The rows of the memory are, in this order: the number of samples so far, the commands of the last
# 20 ms including the present one, the spool's reference behind the play before and after the step,
# the encoder behind its own play at the last samples including the present one, how far the
# encoder's reading is behind the ram, the ram's position before the step, its position when it was
# last remembered, and the sum of the filter's corrections of that position.
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


_PARAMETERS_TYPE: Final = types.NamedUniTuple(types.float64, len(Parameters._fields), Parameters)
# With its declared type, callers would have to pass the context that numba adds by itself.
intrinsic: Final[Any] = numba.extending.intrinsic


@intrinsic
def parameters_of(typing_context, values):
    """Return the `Parameters` of an array float64 (count,), in compiled code.

    The array holds a value for each field, in the order of the fields.
    """

    def emit(context, builder, signature, arguments):
        data = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        fields = [
            builder.load(cgutils.gep_inbounds(builder, data, index))
            for index in range(len(Parameters._fields))
        ]
        return context.make_tuple(builder, signature.return_type, fields)

    return _PARAMETERS_TYPE(values), emit


def _begin(states: Array, inputs: Array, values: Sequence[Mapping[str, float]]) -> Array:
    """Return the memory (rows, LANES) of rigs that were long in their states (states, LANES)."""
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
    store(memory, _COUNT, load(memory, _COUNT) + 1.0)
    memory[_COMMANDS + int(memory[_COUNT, 0]) % _KEPT] = inputs[0]


@inlined
def _kept(memory, first, back):
    """Return, by lane, the value of `back` samples ago in the ring that begins at row `first`."""
    at = load(memory, _COUNT) - back
    return gather(memory, first + (at - _KEPT * floor(at * (1.0 / _KEPT) + 1e-9)))


@inlined
def _ticks(delay):
    """Return, by lane, the whole ticks of a delay in s, and the rest of it as a part of a tick."""
    whole = whole_ticks(delay * (1.0 / TICK))
    part = delay * (1.0 / TICK) - whole
    return whole, select(part < NO_FRACTION, 0.0, part)


@inlined
def _advance(states, command, par, duration):
    """Advance the plant's nine states (rows, LANES) in place by each lane's own duration in s."""
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
    """Return the pressures in Pa that lagging transducers show at the end of a tick, in lanes."""
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
    # This is a loop and not two copies, because its body is long and takes long to compile.
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
    # The correction by a late reading also moves the remembered positions (see `actuator`).
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
    # Until the end of the first sample's interval, the encoder showed the position of the start.
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
    """Return the features that runs in the same lanes must have in common; None to run alone.

    All lanes would have to take the steps that such a feature needs, even if only one had it. A
    supply with a ripple needs eight times as many steps, and runs alone.
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


def _acting(values: Mapping[str, float]) -> NDArray[np.int64]:
    """Return the indices of the states that the filter takes derivatives by.

    Transducers without a lag remember nothing. The pressures of pump and tank follow those of the
    parameters alone, unless flows make the one droop or the other rise.
    """
    lines = values["supply_droop"] != 0.0 or values["return_back_pressure"] != 0.0
    found = [*range(_SUPPLY), *([_SUPPLY, _RETURN] if lines else [])]
    if values["pressure_lag"] != 0.0:
        found += [SEEN_1, SEEN_2]
    return np.array(found, dtype=np.int64)


IN_LANES: Final = InLanes(_begin, _drive, _step, _remember, _read, _kind, _acting)
