"""An author outside this package describes a plant with the functions and tables of this module.

docs/another_plant.md writes one description step by step. `compile_plant.build` makes the `Plant`
of it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numba.extending import register_jitable

from .interface import Channel as Channel, Parameter


class PlantError(ValueError):
    """The plant cannot be used. The message has one line for each problem in `problems`."""

    def __init__(self, problems: list[str]) -> None:
        self.problems = problems
        super().__init__("\n".join(problems))


@dataclass(frozen=True, slots=True)
class Start:
    """How a state starts: at a channel's first reading or, with `rate`, at its slope (`slope`)."""

    channel: str
    rate: bool = False


def reading(channel: str) -> Start:
    """Return a `Start` at the first reading of a channel, which must have the state's own unit."""
    return Start(channel)


def slope(channel: str) -> Start:
    """Return a `Start` at the slope of a channel, per s, fitted to its first 20 ms.

    It is fitted to at least 5 samples and at most 20. Readings that cannot be used are left out;
    with fewer than two others the slope is 0.
    """
    return Start(channel, rate=True)


@dataclass(frozen=True, slots=True)
class StateOf:
    """One state of a described plant.

    Attributes:
        name: name of the state, an attribute of `state` in the plant's functions.
        unit: SI unit.
        start: value at the first sample, SI, or how it follows from a channel.
        spread: standard deviation of that start value, SI, greater than 0. Derivatives by the state
            are taken by changes of a 100th of it.
        error: standard deviation, SI, of the error that the model makes in this state over 1 ms, in
            addition to the error of the equations (`EquationOf.error`); over n ms it is n^0.5 times
            as large.
    """

    name: str
    unit: str
    start: float | Start
    spread: float
    error: float = 0.0


@dataclass(frozen=True, slots=True)
class Input:
    """A channel that drives a plant. Its value is held from one sample to the next.

    Attributes:
        channel: name of the recording's column, an attribute of `inputs` in the plant's functions.
        unit: SI unit.
        size: a large but usual value, SI, greater than 0.
    """

    channel: str
    unit: str
    size: float


@dataclass(frozen=True, slots=True)
class MayLack:
    """An effect that a model may lack.

    Attributes:
        name: name used in reports and model files.
        equation: what the effect adds to the model, in symbols.
        where: name of the equation, output or input that the effect enters.
        parameters: key in a model file -> name of the plant's parameter, at least one. The key of
            an only parameter is "value". No other effect may have the same first parameter.
        starts: values by key from which fits start, if the present values are no start: there the
            effect has no slope, or another of its parameters has no meaning yet.
        unseen: what recordings cannot show of the effect on principle, in words for the report.
        own: pairs of a place that a disturbance may enter and a quantity that it may depend on, in
            which the effect's formula is a curve. A disturbance found there, beside the effect,
            corrects its formula.
    """

    name: str
    equation: str
    where: str
    parameters: Mapping[str, str]
    starts: tuple[Mapping[str, float], ...] = ()
    unseen: str = ""
    own: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True)
class EquationOf:
    """An equation that a disturbance may enter.

    Attributes:
        name: name used in reports, such as "force balance".
        unit: SI unit of the disturbance.
        state: name of the state whose rate the disturbance changes.
        per: (state, parameters) -> change of that rate by one unit of disturbance; `state` holds
            arrays (n,).
        error: standard deviation, in `unit`, of the disturbance that the model allows for at all
            times, white from one ms to the next (docs/another_plant.md explains how to choose it).
        of: names of the regions that the disturbance may depend on, besides time. With "direction"
            among them, it may also turn with the direction of motion.
        shown: unit used in reports, and the number of such units in one SI unit; None for the SI
            unit.
    """

    name: str
    unit: str
    state: str
    per: Callable[[Any, Any], Any]
    error: float
    of: tuple[str, ...]
    shown: tuple[str, float] | None = None


@dataclass(frozen=True, slots=True)
class RegionOf:
    """A quantity that says where in its range a plant works, such as its velocity.

    Attributes:
        name: name used in reports, such as "velocity". The region with the name "direction", if
            there is one, is the direction of motion (the function `direction`).
        unit: SI unit.
        value: (state, inputs) -> the quantity; both arguments hold arrays (n,). If numba can also
            compile it for single numbers, models of the plant can hold what is discovered.
        shown: unit used in reports, and the number of such units in one SI unit; None for the SI
            unit.
        periodic: whether a disturbance may repeat along the quantity, as along the teeth of a rack.
        symbol: symbol used in formulas; the name is used if it is empty.
    """

    name: str
    unit: str
    value: Callable[[Any, Any], Any]
    shown: tuple[str, float] | None = None
    periodic: bool = False
    symbol: str = ""


@register_jitable
def direction(velocity: Any, rest: float) -> Any:
    """Return the direction of motion: 1 or -1, or 0 where the speed is less than `rest`.

    A `RegionOf` may call it with an array (n,), and numba with a single number.
    """
    return np.sign(velocity) * (np.abs(velocity) >= rest)


@dataclass(frozen=True, slots=True)
class VaryingOf:
    """Parameters that may change with a quantity, such as a friction that differs along a rail.

    Attributes:
        name: name used in reports and model files, such as "friction level".
        parameters: names of the one or two parameters, of one unit, that change by the same amount.
        of: names of the regions that the change may depend on, besides time.
        shown: unit used in reports, and the number of such units in one SI unit; None for the SI
            unit.
    """

    name: str
    parameters: tuple[str, ...]
    of: tuple[str, ...]
    shown: tuple[str, float] | None = None


@dataclass(frozen=True)
class PlantDescription:
    """A plant as its author describes it, in SI units throughout.

    Attributes:
        name: name of the plant.
        states: states, in the order in which `rates` returns their rates.
        inputs: channels that drive the plant.
        outputs: channels that are measured, in the order in which `readings` returns them.
        parameters: all parameters, including those of the effects.
        rates: (state, inputs, parameters) -> the rate of change of each state, a tuple. The
            arguments have named attributes. numba compiles the function: it may use arithmetic,
            `math`, and the author's own functions that are decorated with `numba.njit`. It must not
            jump: what jumps is smoothed, or given a state of its own.
        readings: (state, inputs, parameters) -> what each output reads without noise, a tuple, with
            the same rules as `rates`; `inputs` are those of the sample before.
        effects: effects that a model of the plant may lack.
        tolerances: parameter -> how far its value may differ from the model's, as a fraction of
            that, before the difference counts as a missing effect. These parameters are refitted
            first; one with a tolerance of 0 is not.
        equations: equations that a disturbance may enter.
        regions: quantities that a disturbance may depend on.
        input_delay: name of the parameter by which all inputs act later, in s from 0 to its upper
            bound; None if there is none.
        substeps: number of integration steps (Runge-Kutta, 4th order) in 1 ms; a sample of another
            period gets as many, in proportion, rounded up.
        steering: (input, output) -> gain of a feedback, in the input's unit per the output's, that
            keeps a simulation on the course of a recording. With None, one is chosen from the first
            input to the first output that follows it; with an empty mapping there is none.
        not_told_apart: for each pair of effects that are the same on principle, the reason in
            words.
        varying: parameters that may change with a quantity. With None they are those with a
            tolerance, each with all regions; underscores in their names are read as blanks.
    """

    name: str
    states: tuple[StateOf, ...]
    inputs: tuple[Input, ...]
    outputs: tuple[Channel, ...]
    parameters: tuple[Parameter, ...]
    rates: Callable[[Any, Any, Any], Any]
    readings: Callable[[Any, Any, Any], Any]
    effects: tuple[MayLack, ...]
    tolerances: Mapping[str, float]
    equations: tuple[EquationOf, ...]
    regions: tuple[RegionOf, ...]
    input_delay: str | None = None
    substeps: int = 4
    steering: Mapping[tuple[str, str], float] | None = None
    not_told_apart: Mapping[frozenset[str], str] = field(default_factory=dict)
    varying: tuple[VaryingOf, ...] | None = None

    @property
    def at_rest(self) -> list[float]:
        """Return the start value of each state, SI; 0 where a channel gives the start."""
        return [0.0 if isinstance(each.start, Start) else each.start for each in self.states]

    @property
    def may_vary(self) -> tuple[VaryingOf, ...]:
        """Return `varying`, or if that is None each parameter with a tolerance above zero.

        Such a parameter varies alone, and with each of the regions.
        """
        if self.varying is not None:
            return self.varying
        regions = tuple(region.name for region in self.regions)
        return tuple(
            VaryingOf(each.name.replace("_", " "), (each.name,), regions)
            for each in self.parameters
            if self.tolerances.get(each.name, 0.0) > 0.0
        )
