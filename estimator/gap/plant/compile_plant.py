"""This module makes a `Plant` of a description: it checks it and compiles its functions.

The compiled step integrates the rates of the description.
"""

from collections import namedtuple
from collections.abc import Callable, Mapping
from dataclasses import replace
from math import ceil
from typing import Any, Final

import numpy as np
from numba.core import types
from numba.core.errors import NumbaError
from numba.extending import is_jitted, overload

from rig.jit import njit

from .additions import EMPTY_SLOTS, SLOT_PARAMETERS
from .description import EquationOf, MayLack, PlantDescription, PlantError, Start
from .description_checks import check_description, check_functions
from .interface import (
    DRIVE,
    MEASURE,
    READ,
    STEP,
    Array,
    Effect,
    Equation,
    Knob,
    Nuisance,
    Output,
    Parameter,
    Plant,
    Region,
    State,
    Varying,
    begin_held,
    hold,
)

PERIOD: Final = 1e-3
"""Time, s, for which a description states its errors and substeps; also the sampling period of
recordings at 1 kHz."""
_HORIZON_S: Final = 0.02
"""How far ahead predictions are judged, s, at least."""
_SAMPLES: Final = 20
"""Least number of samples in the horizon, and in the time within which steering acts."""
_STEERED_S: Final = 0.5
"""Time within which steering brings a simulation back to its course, s, at least."""
_SLOPE_S: Final = 0.02
_SLOPE_SAMPLES: Final = 5
"""The rate of a channel at the start is fitted to 20 ms of samples, but to 5 samples at least."""
_SMALL: Final = 0.01
"""Change of a state by which derivatives are taken by differences, as a part of the state's
spread."""


class Views:
    """Named tuples of the states, inputs and parameters of a description.

    The functions of the description read them by these names, as attributes.
    """

    def __init__(self, description: PlantDescription) -> None:
        self.state = namedtuple("State", [s.name for s in description.states])  # type: ignore[misc]
        self.inputs = namedtuple("Inputs", [i.channel for i in description.inputs])  # type: ignore[misc]
        self.parameters: Any = namedtuple(  # type: ignore[misc]
            "Parameters", [p.name for p in description.parameters]
        )

    def given(self, values: Mapping[str, float]) -> Any:
        """Return the named tuple of all parameters, with these values by name."""
        return self.parameters(**{name: float(values[name]) for name in self.parameters._fields})


def build(
    description: PlantDescription,
    values: Mapping[str, float],
    period: float = PERIOD,
    row_s: float = 0.0,
) -> Plant:
    """Return the plant of a description, with given values of all its parameters (by name, SI).

    It is compiled for samples of one period (s). Predictions are judged over 20 ms, or over 20
    samples or rows if these last longer: `row_s` is the period of the recordings' rows (s), if only
    some samples have one. This takes two to three seconds, most of them for
    compiling.

    Raises:
        PlantError: the tables of the description do not fit together, its functions fail, or numba
            cannot compile one. This is checked in that order; the error lists all problems of the
            first kind that there is, but only one function that does not compile.
        KeyError: `values` lacks a parameter.
    """
    check_description(description)
    views = Views(description)
    par = views.given(values)
    check_functions(description, views, par)
    drive, step, read = _compiled(description, views, period)
    nominal = dict(zip(par._fields, par, strict=True))
    plant = Plant(
        name=description.name,
        states=_states(description, views, par, period),
        inputs=tuple(each.channel for each in description.inputs),
        input_units=tuple(each.unit for each in description.inputs),
        outputs=tuple(
            Output(
                o.channel, o.unit, o.noise, o.resolution, o.lower, o.upper, o.shown,
                _undriven(description, views),
            )
            for o in description.outputs
        ),
        parameters=description.parameters,
        nominal=nominal,
        step=step,
        read=read,
        start=_start(description, period),
        effects={each.name: effect(description, each, nominal) for each in description.effects},
        nuisances=nuisances(description.parameters, description.tolerances, nominal),
        equations=tuple(
            _equation(each, description, views, period) for each in description.equations
        ),
        regions={
            each.name: Region(
                each.name, each.unit, _region(each.value, views), each.shown or (each.unit, 1.0),
                each.symbol, each.periodic,
            )
            for each in description.regions
        },
        steering=_stated_steering(description),
        drive=drive,
        begin=_begin(description, period),
        period=period,
        horizon=max(_HORIZON_S, _SAMPLES * max(period, row_s)),
        not_told_apart=description.not_told_apart,
    )  # fmt: skip
    plant = _with_slots(plant, description, views)
    return plant if description.steering is not None else _steered(plant, description)


def probe_of(parameter: Parameter, value: float) -> float:
    """Return a small but visible change of a parameter with this value, SI.

    If the parameter states none, the change is a 1000th of its range, or a 100th of its value if
    that is less and the value is not 0.
    """
    if parameter.probe > 0.0:
        return parameter.probe
    probe = 1e-3 * (parameter.upper - parameter.lower)
    return min(probe, 1e-2 * abs(value)) if value != 0.0 else probe


def nuisances(
    parameters: tuple[Parameter, ...], tolerances: Mapping[str, float], nominal: Mapping[str, float]
) -> tuple[Nuisance, ...]:
    """Return the nuisances, which are refitted first: all parameters with a tolerance above zero.

    The tolerance is about the value of the model (`nominal`).
    """
    return tuple(
        Nuisance(each.name, probe_of(each, nominal[each.name]), tolerances[each.name],
                 nominal[each.name])
        for each in parameters
        if tolerances.get(each.name, 0.0) > 0.0
    )  # fmt: skip


def effect(description: PlantDescription, row: MayLack, nominal: Mapping[str, float]) -> Effect:
    """Return an effect with its knobs, made of its row in a description.

    `nominal` holds the values of all parameters by name, from which the knobs' probes follow.
    """
    known = {parameter.name: parameter for parameter in description.parameters}
    knobs = []
    for key, name in row.parameters.items():
        each = known[name]
        knobs.append(Knob(key, name, probe_of(each, nominal[name]), each.lower, each.upper))
    return Effect(
        row.name, row.equation, row.where, tuple(knobs), row.starts, row.unseen, own=row.own
    )


# States


def _states(
    description: PlantDescription, views: Views, par: Any, period: float
) -> tuple[State, ...]:
    """Return the states, with a noise that includes the errors of the equations for their rates.

    The errors are white noise over 1 ms each, so that the variance of a state grows with the time
    that passes, whatever the sampling period.
    """
    rest = views.state(*(np.zeros(1) for _ in description.states))
    made = []
    for each in description.states:
        variance = each.error**2
        for equation in description.equations:
            if equation.state == each.name:
                per = float(np.max(np.abs(equation.per(rest, par))))
                variance += (equation.error * per * PERIOD) ** 2
        variance *= period / PERIOD
        made.append(State(each.name, each.unit, _SMALL * each.spread, variance**0.5))
    return tuple(made)


def _start(
    description: PlantDescription, period: float
) -> Callable[[Array, Array, Mapping[str, float]], tuple[Array, Array]]:
    channels = [output.channel for output in description.outputs]
    spread = np.array([each.spread for each in description.states])

    def start(readings: Array, inputs: Array, values: Mapping[str, float]) -> tuple[Array, Array]:
        state = np.empty(len(spread))
        for index, each in enumerate(description.states):
            if not isinstance(each.start, Start):
                state[index] = each.start
                continue
            read = readings[:, channels.index(each.start.channel)]
            state[index] = _rate(read, period) if each.start.rate else read[0]
        return state, spread

    return start


def _rate(values: Array, period: float) -> float:
    """Return the slope per s of a straight line through the first samples, by least squares.

    `values` (m,) are samples at the sampling period; those of 20 ms count, at least the first 5.
    Samples that are not finite are left out; with fewer than two others the slope is 0.
    """
    values = values[: max(round(_SLOPE_S / period), _SLOPE_SAMPLES)]
    known = np.flatnonzero(np.isfinite(values))
    if len(known) < 2:
        return 0.0
    time = (known - known.mean()) * period
    return float(time @ values[known] / (time @ time))


# Equations and regions


def _region(value: Callable[[Any, Any], Any], views: Views) -> Callable[[Array, Array], Array]:
    def of(states: Array, inputs: Array) -> Array:
        found = value(views.state(*states.T), views.inputs(*inputs.T))
        return np.ascontiguousarray(np.broadcast_to(found, len(states)), dtype=np.float64)

    return of


def _undriven(description: PlantDescription, views: Views) -> tuple[str, ...]:
    """Return the names of the regions that do not depend on the inputs.

    An error of a reading is looked for along these alone. A control loop feeds the noise of a
    reading back to the input of the same sample, so that along an input the noise would look like
    an error of the reading.
    """
    states, inputs = _points(description)
    found = []
    for each in description.regions:
        of = _region(each.value, views)
        if np.array_equal(of(states, inputs), of(states, -2.0 * inputs), equal_nan=True):
            found.append(each.name)
    return tuple(found)


def _points(description: PlantDescription) -> tuple[Array, Array]:
    """Return some states (n, states) and inputs (n, inputs) at which functions are compared."""
    at_rest = [0.0 if isinstance(s.start, Start) else s.start for s in description.states]
    spreads = [each.spread for each in description.states]
    sizes = [each.size for each in description.inputs]
    states = np.array(at_rest) + np.outer([0.0, 1.0, -0.7, 0.3], spreads)
    return states, np.outer([0.5, -0.25, 0.1, 0.8], sizes)


def _equation(
    each: EquationOf, description: PlantDescription, views: Views, period: float
) -> Equation:
    def rate(states: Array, values: Mapping[str, float]) -> Array:
        per = each.per(views.state(*states.T), views.given(values))
        return np.array(np.broadcast_to(np.asarray(per) * period, len(states)), dtype=np.float64)

    index = [state.name for state in description.states].index(each.state)
    shown = each.shown or (each.unit, 1.0)
    return Equation(each.name, each.unit, index, rate, shown, each.of)


# Compiled functions


_STEP_SOURCE: Final = """
def step(state, memory, parameters):
    par = Parameters({par})
    inputs = Inputs({inputs})
    {x} = {loaded}
    for _ in range({substeps}):
        {a} = rates(State({x}), inputs, par)
        {b} = rates(State({xa}), inputs, par)
        {c} = rates(State({xb}), inputs, par)
        {d} = rates(State({xc}), inputs, par)
        {advance}
    {stored}
"""
_DRIVE_SOURCE: Final = """
def drive(inputs, memory, parameters):
    late = min(max(parameters[{delay}] / {period!r}, 0.0), {most})
    whole = int(late)
    part = late - whole
    for i in range({count}):
        first = {count} + i * {length}
        for k in range({length} - 1, 0, -1):
            memory[first + k] = memory[first + k - 1]
        memory[first] = inputs[i]
        memory[i] = (1.0 - part) * memory[first + whole] + part * memory[first + whole + 1]
"""
_READ_SOURCE: Final = """
def read(state, memory, parameters, outputs):
    {y} = readings(State({loaded}), Inputs({inputs}), Parameters({par}))
    {stored}
"""
_MEASURE_SOURCE: Final = """
def measures(state, inputs, parameters, measured):
    x, u, par = State({loaded}), Inputs({inputs}), Parameters({par})
    {stored}
"""


def _compiled(description: PlantDescription, views: Views, period: float) -> tuple[Any, Any, Any]:
    """Return the compiled functions drive, step and read of a description.

    Their sources are generated: they unpack arrays into the named tuples of the views. Each substep
    of step is one of Runge and Kutta (4th order), with the inputs held. The substeps of a sample
    are no longer than those that the description states for 1 ms.
    """
    states, outputs = range(len(description.states)), range(len(description.outputs))
    substeps = max(ceil(description.substeps * (period / PERIOD) - 1e-9), 1)
    h = period / substeps
    unpacked = _unpacked(description, "memory")
    step = _STEP_SOURCE.format(
        **unpacked, substeps=substeps,
        **{name: _listed(name + "{}", states) for name in "xabcd"},
        xa=_listed(f"x{{0}} + {0.5 * h!r} * a{{0}}", states),
        xb=_listed(f"x{{0}} + {0.5 * h!r} * b{{0}}", states),
        xc=_listed(f"x{{0}} + {h!r} * c{{0}}", states),
        advance="; ".join(
            f"x{i} += {h / 6.0!r} * (a{i} + 2.0 * b{i} + 2.0 * c{i} + d{i})" for i in states
        ),
        stored="; ".join(f"state[{i}] = x{i}" for i in states),
    )  # fmt: skip
    read = _READ_SOURCE.format(
        **unpacked, y=_listed("y{}", outputs),
        stored="; ".join(f"outputs[{i}] = y{i}" for i in outputs),
    )  # fmt: skip
    names = {
        "State": views.state, "Inputs": views.inputs, "Parameters": views.parameters,
        "rates": _jitted(description.rates), "readings": _jitted(description.readings),
    }  # fmt: skip
    return (
        _drive(description, period),
        _made("step", step, STEP, names, "rates"),
        _made("read", read, READ, names, "readings"),
    )


def _unpacked(description: PlantDescription, inputs: str) -> dict[str, str]:
    """Return, as sources, the elements of all views; `inputs` is the array that has the inputs."""
    return {
        "par": _listed("parameters[{}]", range(len(description.parameters))),
        "inputs": _listed(inputs + "[{}]", range(len(description.inputs))),
        "loaded": _listed("state[{}]", range(len(description.states))),
    }


def _longest(description: PlantDescription, period: float) -> int:
    """Return the greatest delay of the inputs, in samples, rounded up; 0 without a delay."""
    upper = {each.name: each.upper for each in description.parameters}
    delay = description.input_delay
    return 0 if delay is None else ceil(upper[delay] / period - 1e-9)


def _drive(description: PlantDescription, period: float) -> Any:
    """Return the compiled drive, which copies the inputs to the memory, if need be with a delay.

    The delay need not be a whole number of samples.
    """
    if description.input_delay is None:
        return hold
    most = _longest(description, period)
    source = _DRIVE_SOURCE.format(
        delay=[each.name for each in description.parameters].index(description.input_delay),
        period=period, most=float(most), count=len(description.inputs), length=most + 2,
    )  # fmt: skip
    return _made("drive", source, DRIVE, {}, "input_delay")


def _begin(
    description: PlantDescription, period: float
) -> Callable[[Array, Array, Mapping[str, float], float], Array]:
    """Return the function that makes the memory at the first sample (`Plant.begin`).

    The memory holds the inputs as they act and, with a delay, those that will act later. All are
    equal to the inputs at the first sample.
    """
    if description.input_delay is None:
        return begin_held
    length = _longest(description, period) + 2

    def begin(state: Array, inputs: Array, values: Mapping[str, float], time_s: float) -> Array:
        return np.concatenate([inputs[0], np.repeat(inputs[0], length)])

    return begin


def _listed(pattern: str, indices: range) -> str:
    # The last comma makes a tuple even of a single item.
    return "".join(pattern.format(index) + ", " for index in indices)


def _jitted(function: Any) -> Any:
    return function if is_jitted(function) else njit(error_model="numpy")(function)


def _made(name: str, source: str, signature: Any, names: dict[str, Any], of: str) -> Any:
    space = dict(names)
    exec(compile(source, f"<{name} of a described plant>", "exec"), space)
    try:
        return njit(signature, error_model="numpy")(space[name])
    except NumbaError as error:
        reason = next((line for line in str(error).splitlines() if line.strip()), "")
        causes = [line.strip() for line in str(error).splitlines() if "Unknown attribute" in line
                or "Untyped global" in line or "NameError" in line]  # fmt: skip
        raise PlantError(
            [
                f"{of}: numba cannot compile it: {' '.join((causes or [reason])[0].split())}; use "
                "arithmetic, math.sin and the like, and decorate functions of your own that it "
                "calls with numba.njit"
            ]
        ) from error


# Additions


def _number(value):  # type: ignore[no-untyped-def]
    """Return a number, or the only one in an array, as a float; for compiled functions alone."""


@overload(_number)  # type: ignore[untyped-decorator]
def _number_of(value):  # type: ignore[no-untyped-def]
    if isinstance(value, types.Array):
        return lambda value: float(value.item())
    return lambda value: float(value)


def _with_slots(plant: Plant, description: PlantDescription, views: Views) -> Plant:
    """Return a plant whose models hold additions, or the same with the reason why they do not."""
    try:
        measures = _measures(plant, description, views)
    except PlantError as error:
        (reason,) = error.problems
        why = f"models of this plant hold nothing that is discovered: {reason}"
        return replace(plant, why_no_slots=why)
    known = {each.name: each for each in description.parameters}
    return replace(
        plant,
        parameters=plant.parameters + SLOT_PARAMETERS,
        nominal={**plant.nominal, **EMPTY_SLOTS},
        measures=measures,
        varying=tuple(
            Varying(
                each.name, each.parameters, known[each.parameters[0]].unit,
                min(probe_of(known[name], plant.nominal[name]) for name in each.parameters),
                each.of, each.shown or (known[each.parameters[0]].unit, 1.0),
            )
            for each in description.may_vary
        ),
        slots=True,
    )  # fmt: skip


def _measures(plant: Plant, description: PlantDescription, views: Views) -> Any:
    """Return the compiled function that writes the regions' quantities and the equations' rates.

    Raises:
        PlantError: numba cannot compile a function of a region or an equation for single numbers,
            or it then has another value than with arrays. The error has this one problem.
    """
    rows = [
        (f"the value of region {each.name!r}", each.value, "x, u", 1.0)
        for each in description.regions
    ]  # fmt: skip
    rows += [
        (f"per of equation {each.name!r}", each.per, "x, par", plant.period)
        for each in description.equations
    ]
    # The rates are two for each equation. A disturbance of a described one changes one state alone.
    first = len(description.regions)
    places = [*range(first), *range(first, first + 2 * len(description.equations), 2)]

    def made(chosen: range) -> Any:
        lines = [
            f"measured[{places[k]}] = {rows[k][3]!r} * number(f{k}({rows[k][2]}))" for k in chosen
        ]
        zeros = [f"measured[{place + 1}] = 0.0" for place in places[first:]]
        names = {f"f{k}": _jitted(rows[k][1]) for k in chosen}
        source = _MEASURE_SOURCE.format(
            **_unpacked(description, "inputs"), stored="; ".join([*lines, *zeros]) or "pass"
        )
        space = {
            "State": views.state, "Inputs": views.inputs, "Parameters": views.parameters,
            "number": _number, **names,
        }  # fmt: skip
        of = rows[chosen[0]][0] if len(chosen) == 1 else "regions and equations"
        return _made("measures", source, MEASURE, space, of)

    try:
        measures = made(range(len(rows)))
    except PlantError:
        for k in range(len(rows)):
            made(range(k, k + 1))
        raise
    _check_alike(plant, description, measures, [(rows[k][0], places[k]) for k in range(len(rows))])
    return measures


def _check_alike(
    plant: Plant, description: PlantDescription, measures: Any, rows: list[tuple[str, int]]
) -> None:
    """Raise PlantError if compiled functions differ from those that take arrays.

    Args:
        plant: plant with the latter.
        description: its description.
        measures: the compiled functions.
        rows: what each is and its index in what `measures` writes.
    """
    states, inputs = _points(description)
    found = np.empty((len(states), len(plant.regions) + 2 * len(plant.equations)))
    for row in range(len(states)):
        measures(states[row].copy(), inputs[row].copy(), plant.vector(plant.nominal), found[row])
    wanted = [region.value(states, inputs) for region in plant.regions.values()]
    wanted += [equation.rate(states, plant.nominal) for equation in plant.equations]
    for (name, place), values in zip(rows, wanted, strict=True):
        if not np.allclose(found[:, place], values, rtol=1e-9, equal_nan=True):
            raise PlantError(
                [f"{name}: a sample's value depends on other samples; compute it from one alone"]
            )


# Steering


def _stated_steering(description: PlantDescription) -> tuple[tuple[int, int, float], ...]:
    inputs = [each.channel for each in description.inputs]
    outputs = [each.channel for each in description.outputs]
    return tuple(
        (inputs.index(pair[0]), outputs.index(pair[1]), gain)
        for pair, gain in (description.steering or {}).items()
    )


def _steered(plant: Plant, description: PlantDescription) -> Plant:
    """Return the plant, with its first input steered by the first output that follows that input.

    The gain is the input, per unit of the output, that moves the output by that unit within half a
    second, or within 20 samples if these last longer. If no output follows the input, the plant is
    returned as it is.
    """
    par = plant.vector(plant.nominal)
    ends = []
    for sign in (1.0, -1.0):
        state = np.array(
            [0.0 if isinstance(s.start, Start) else s.start for s in description.states]
        )
        memory = np.zeros(len(plant.inputs))
        memory[0] = sign * description.inputs[0].size
        for _ in range(max(round(_STEERED_S / plant.period), _SAMPLES)):
            plant.step(state, memory, par)
        readings = np.empty(len(plant.outputs))
        plant.read(state, memory, par, readings)
        ends.append(readings)
    moved = (ends[0] - ends[1]) / (2.0 * description.inputs[0].size)
    noises = np.array([output.variance**0.5 for output in plant.outputs])
    follows = np.abs(moved) * description.inputs[0].size > 10.0 * noises
    if not np.all(np.isfinite(moved)) or not follows.any():
        return plant
    output = int(np.argmax(follows))
    return replace(plant, steering=((0, output, float(1.0 / moved[output])),))
