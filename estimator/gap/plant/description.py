"""How someone outside this package tells the workflow of a plant: plain functions and tables.

docs/another_plant.md writes one word by word. `building.build` makes the `Plant` of it.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .interface import Parameter


class PlantError(ValueError):
    """A plant that cannot be used; one line for each thing that is wrong with it."""

    def __init__(self, problems: list[str]) -> None:
        self.problems = problems
        super().__init__("\n".join(problems))


@dataclass(frozen=True, slots=True)
class Start:
    """Where a state starts: at the first readings of a channel, or at how fast they change."""

    channel: str
    rate: bool = False


def reading(channel: str) -> Start:
    """Start a state at the first reading of a channel in the state's own unit."""
    return Start(channel)


def slope(channel: str) -> Start:
    """Start a state at the rate of change of a channel over its first 20 samples."""
    return Start(channel, rate=True)


@dataclass(frozen=True, slots=True)
class StateOf:
    """One state of a described plant.

    Attributes:
        name: an attribute of `state` in the plant's functions.
        unit: SI.
        start: its value at the first sample, or the channel it follows from.
        spread: standard deviation of that start, SI; also the scale of small changes of it.
        error: standard deviation of the model's own error over one sample, SI, beside that of the
            equations (`EquationOf.error`).
    """

    name: str
    unit: str
    start: float | Start
    spread: float
    error: float = 0.0


@dataclass(frozen=True, slots=True)
class Input:
    """What drives a plant: a channel, held from one sample to the next.

    Attributes:
        channel: column of a recording, an attribute of `inputs` in the plant's functions.
        unit: SI.
        size: a large but usual value, SI.
    """

    channel: str
    unit: str
    size: float


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel of a recording that a described plant predicts.

    Attributes:
        channel: column of a recording.
        unit: SI.
        noise: standard deviation of a reading, SI, greater than 0.
        resolution: step of a counting sensor, SI, 0 if it has none.
        lower: least reading, SI; at or below it a reading is saturated.
        upper: greatest reading.
        shown: unit in reports, and how many of it are one SI unit.
    """

    channel: str
    unit: str
    noise: float
    resolution: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf
    shown: tuple[str, float] | None = None


@dataclass(frozen=True, slots=True)
class MayLack:
    """An effect that a model may lack.

    Attributes:
        name: in reports and model files.
        equation: what it adds, in symbols.
        where: name of the equation, or channel, that it enters.
        parameters: key in a model file -> parameter of the plant; "value" for the only one.
        starts: where a fit starts, by key, if the neutral value is no start: there the effect
            vanishes with its slope, or another parameter of it has no meaning yet.
        unseen: what of it cannot be told on principle, for the report.
    """

    name: str
    equation: str
    where: str
    parameters: Mapping[str, str]
    starts: tuple[Mapping[str, float], ...] = ()
    unseen: str = ""


@dataclass(frozen=True, slots=True)
class EquationOf:
    """An equation that a disturbance may enter.

    Attributes:
        name: in reports: "force balance".
        unit: of the disturbance, SI.
        state: name of the state whose rate it changes.
        per: (state, parameters) -> change of that rate by one unit of disturbance; `state` holds
            arrays (n,).
        error: standard deviation of the disturbance that the model admits to at all times, white
            from sample to sample, in the unit (docs/another_plant.md tells how to choose it).
        of: names of the regions that it is drawn against.
        shown: unit in reports, and how many of it are one SI unit.
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
    """A quantity that says where a plant is working.

    Attributes:
        name: in reports: "velocity".
        unit: SI.
        value: (state, inputs) -> its value; both hold arrays (n,).
        shown: unit in reports, and how many of it are one SI unit.
    """

    name: str
    unit: str
    value: Callable[[Any, Any], Any]
    shown: tuple[str, float] | None = None


@dataclass(frozen=True)
class PlantDescription:
    """A plant as its author tells it. SI throughout.

    Attributes:
        name: of the plant.
        states: in the order in which `rates` returns them.
        inputs: what drives it.
        outputs: what is measured, in the order in which `readings` returns them.
        parameters: all, those of its effects included.
        rates: (state, inputs, parameters) -> the rate of change of each state, a tuple. All three
            have named attributes. Compiled by numba: arithmetic and `math`, and functions of one's
            own that are decorated with `numba.njit`. No jumps: what jumps is smoothed, or given a
            state of its own.
        readings: likewise -> what each output reads without noise, a tuple; `inputs` are those of
            the sample before.
        effects: what a model of it may lack.
        tolerances: parameter -> how far it may be off, as a fraction of the model's value, before
            that is a missing effect: refitted first.
        equations: where disturbances enter.
        regions: what these are drawn against.
        input_delay: parameter by which the inputs act later, s, if there is one.
        substeps: steps of the integrator (Runge-Kutta, 4th order) in one sample.
        steering: (input, output) -> gain, in the input's unit per output's, that keeps a
            simulation on the course of a recording: None to choose one, empty for none.
        not_told_apart: reasons, by pair of effects, why these are the same on principle.
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
