"""This module makes a `Plant` of a description, which it checks and whose functions it compiles.

The compiled step integrates the rates of the description.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from typing import Any, Final

import numpy as np

from .additions import EMPTY_SLOTS, SLOT_PARAMETERS, Layout
from .compiled_functions import PERIOD, Views, compiled, longest_delay, measures_of, sample_points
from .description import EquationOf, MayLack, PlantDescription, PlantError, Start
from .description_checks import check_description, check_functions
from .interface import (
    Array,
    Beginning,
    Effect,
    Equation,
    Knob,
    Nuisance,
    Output,
    Parameter,
    Plant,
    Region,
    Starting,
    State,
    Varying,
    begin_held,
)

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


def build(
    description: PlantDescription,
    values: Mapping[str, float],
    period: float = PERIOD,
    row_s: float = 0.0,
) -> Plant:
    """Return the plant of a description, with given values of all its parameters (by name, SI).

    The plant is compiled for samples of one period (s). Predictions are judged over 20 ms, or over
    20 samples or rows if these last longer. `row_s` is the period of the recordings' rows (s) if
    these are rarer than samples, else it may be 0. A call takes two to three seconds, most of them
    for compiling.

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
    drive, step, read = compiled(description, views, period)
    nominal = dict(zip(par._fields, par, strict=True))
    driven = [each.channel for each in description.inputs]
    seen = [each.channel for each in description.outputs]
    plant = Plant(
        name=description.name,
        states=_states(description, views, par, period),
        inputs=tuple(driven),
        input_units=tuple(each.unit for each in description.inputs),
        outputs=tuple(
            Output(**asdict(each), of=_undriven(description, views)) for each in description.outputs
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
        steering=tuple(
            (driven.index(one), seen.index(other), gain)
            for (one, other), gain in (description.steering or {}).items()
        ),
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


def _start(description: PlantDescription, period: float) -> Starting:
    channels = [output.channel for output in description.outputs]
    spread = np.array([each.spread for each in description.states])

    def start(readings: Array, inputs: Array, values: Mapping[str, float]) -> tuple[Array, Array]:
        state = np.array(description.at_rest, dtype=np.float64)
        for index, each in enumerate(description.states):
            if isinstance(each.start, Start):
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
    states, inputs = sample_points(description)
    found = []
    for each in description.regions:
        of = _region(each.value, views)
        if np.array_equal(of(states, inputs), of(states, -2.0 * inputs), equal_nan=True):
            found.append(each.name)
    return tuple(found)


def _equation(
    each: EquationOf, description: PlantDescription, views: Views, period: float
) -> Equation:
    def rate(states: Array, values: Mapping[str, float]) -> Array:
        per = each.per(views.state(*states.T), views.given(values))
        return np.array(np.broadcast_to(np.asarray(per) * period, len(states)), dtype=np.float64)

    index = [state.name for state in description.states].index(each.state)
    shown = each.shown or (each.unit, 1.0)
    return Equation(each.name, each.unit, index, rate, shown, each.of)


# Memory and additions


def _begin(description: PlantDescription, period: float) -> Beginning:
    """Return the function that makes the memory at the first sample (`Plant.begin`).

    The memory holds the inputs as they act and, with a delay, those that will act later. All are
    equal to the inputs at the first sample.
    """
    if description.input_delay is None:
        return begin_held
    length = longest_delay(description, period) + 2

    def begin(state: Array, inputs: Array, values: Mapping[str, float], time_s: float) -> Array:
        return np.concatenate([inputs[0], np.repeat(inputs[0], length)])

    return begin


def _with_slots(plant: Plant, description: PlantDescription, views: Views) -> Plant:
    """Return a plant whose models hold additions, or the same with the reason why they do not."""
    try:
        measures = measures_of(plant, description, views)
    except PlantError as error:
        (reason,) = error.problems
        why = f"models of this plant hold nothing that is discovered: {reason}"
        return replace(plant, why_no_layout=why)
    known = {each.name: each for each in description.parameters}
    varying = tuple(
        Varying(
            each.name, each.parameters, known[each.parameters[0]].unit,
            min(probe_of(known[name], plant.nominal[name]) for name in each.parameters),
            each.of, each.shown or (known[each.parameters[0]].unit, 1.0),
        )
        for each in description.may_vary
    )  # fmt: skip
    channels = [output.channel for output in plant.outputs]
    return replace(
        plant,
        parameters=plant.parameters + SLOT_PARAMETERS,
        nominal={**plant.nominal, **EMPTY_SLOTS},
        measures=measures,
        varying=varying,
        layout=Layout(plant.equations, plant.regions, channels, varying, list(known)),
    )


# Steering


def _steered(plant: Plant, description: PlantDescription) -> Plant:
    """Return the plant, with its first input steered by the first output that follows that input.

    The gain is the input, per unit of the output, that moves the output by that unit within half a
    second, or within 20 samples if these last longer. An output follows if an input of its usual
    `size` moves it by more than ten times its noise in that time. If none does, or if a reading is
    not finite, the plant is returned as it is.
    """
    par = plant.vector(plant.nominal)
    ends = []
    for sign in (1.0, -1.0):
        state = np.array(description.at_rest)
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
