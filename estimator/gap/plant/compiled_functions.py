"""This module compiles the functions of a description for the samples of one period.

Their sources are generated: they unpack arrays into named tuples, as the author's functions take.
"""

from collections import namedtuple
from collections.abc import Mapping, Sequence
from math import ceil
from typing import Any, Final

import numpy as np
from numba.core import types
from numba.core.errors import NumbaError
from numba.extending import is_jitted, overload

from rig.jit import njit

from .description import PlantDescription, PlantError
from .interface import DRIVE, MEASURE, READ, STEP, Array, Plant, hold

PERIOD: Final = 1e-3
"""Time, s, for which a description states its errors and substeps; also the sampling period of
recordings at 1 kHz."""


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


def sample_points(description: PlantDescription) -> tuple[Array, Array]:
    """Return states (4, states) and inputs (4, inputs) at which functions are compared.

    The first state is the start, with 0 where a channel gives it; the others are near it.
    """
    spreads = [each.spread for each in description.states]
    sizes = [each.size for each in description.inputs]
    states = np.array(description.at_rest) + np.outer([0.0, 1.0, -0.7, 0.3], spreads)
    return states, np.outer([0.5, -0.25, 0.1, 0.8], sizes)


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


def compiled(description: PlantDescription, views: Views, period: float) -> tuple[Any, Any, Any]:
    """Return the compiled functions drive, step and read of a description.

    Their sources are generated: they unpack arrays into the named tuples of the views. Each substep
    of step is one of Runge and Kutta (4th order), with the inputs held. The substeps of a sample
    are no longer than those that the description states for 1 ms.

    Raises:
        PlantError: numba cannot compile a function of the description.
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
    names = _names(views) | {
        "rates": _jitted(description.rates), "readings": _jitted(description.readings),
    }  # fmt: skip
    return (
        _drive(description, period),
        _made("step", step, STEP, names, "rates"),
        _made("read", read, READ, names, "readings"),
    )


def _names(views: Views) -> dict[str, Any]:
    """Return the classes of the views by the names that they have in generated sources."""
    return {"State": views.state, "Inputs": views.inputs, "Parameters": views.parameters}


def _unpacked(description: PlantDescription, inputs: str) -> dict[str, str]:
    """Return source text that lists the elements of arrays, to make the named tuples of the views.

    The keys are "par", "inputs" and "loaded", the last one for the state. `inputs` is the name of
    the array in the source that has the inputs.
    """
    return {
        "par": _listed("parameters[{}]", range(len(description.parameters))),
        "inputs": _listed(inputs + "[{}]", range(len(description.inputs))),
        "loaded": _listed("state[{}]", range(len(description.states))),
    }


def longest_delay(description: PlantDescription, period: float) -> int:
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
    most = longest_delay(description, period)
    source = _DRIVE_SOURCE.format(
        delay=[each.name for each in description.parameters].index(description.input_delay),
        period=period, most=float(most), count=len(description.inputs), length=most + 2,
    )  # fmt: skip
    return _made("drive", source, DRIVE, {}, "input_delay")


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


# Quantities and rates


def _number(value: Any) -> Any:
    """Return a number, or the only one in an array, as a float.

    Only compiled functions may call it: numba takes `_number_of` in its place.
    """


@overload(_number)
def _number_of(value):
    if isinstance(value, types.Array):
        return lambda value: float(value.item())
    return lambda value: float(value)


def measures_of(plant: Plant, description: PlantDescription, views: Views) -> Any:
    """Return the compiled function that writes the regions' quantities and the equations' rates.

    Raises:
        PlantError: numba cannot compile a function of a region or an equation for single numbers,
            or it then has another value than with arrays. The error has this one problem.
    """
    # The rates are two for each equation. A disturbance of a described one changes one state alone.
    first = len(description.regions)
    rows = [
        (f"the value of region {each.name!r}", each.value, "x, u", 1.0, k)
        for k, each in enumerate(description.regions)
    ]
    rows += [
        (f"per of equation {each.name!r}", each.per, "x, par", plant.period, first + 2 * k)
        for k, each in enumerate(description.equations)
    ]
    zeros = [f"measured[{place + 1}] = 0.0" for *_, place in rows[first:]]

    def made(chosen: Sequence[tuple[str, Any, str, float, int]], of: str) -> Any:
        space = {**_names(views), "number": _number}
        space |= {f"f{place}": _jitted(function) for _, function, *_, place in chosen}
        lines = [
            f"measured[{place}] = {factor!r} * number(f{place}({arguments}))"
            for *_, arguments, factor, place in chosen
        ]
        source = _MEASURE_SOURCE.format(
            **_unpacked(description, "inputs"), stored="; ".join([*lines, *zeros]) or "pass"
        )
        return _made("measures", source, MEASURE, space, of)

    try:
        measures = made(rows, "regions and equations")
    except PlantError:
        for row in rows:
            made([row], row[0])
        raise
    _check_alike(plant, description, measures, [(name, place) for name, *_, place in rows])
    return measures


def _check_alike(
    plant: Plant, description: PlantDescription, measures: Any, rows: list[tuple[str, int]]
) -> None:
    """Raise PlantError if a quantity or rate has another value compiled than computed with arrays.

    They are compared at `sample_points`.

    Args:
        plant: plant whose regions and equations compute with arrays.
        description: description of the plant.
        measures: compiled function that writes all quantities and rates of one sample.
        rows: for each region and then each equation, its name in the error's words, and the index
            of its value in what `measures` writes.
    """
    states, inputs = sample_points(description)
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
