"""This module defines what the gap workflow must know of a plant, above all the class `Plant`.

A plant is a discrete-time model, with one step per sample, in four compiled functions. The filter
estimates the plant's states. Between the states and what is commanded or read there may be a
memory, such as the play of a spool or the lag of a transducer; the filter does not estimate the
memory. The functions are called in this order in each sample:

    drive(inputs, memory, parameters)              writes what acts on the plant to the memory
    step(state, memory, parameters)                advances the state by one sample, in place
    remember(before, state, memory, parameters)    updates what the sensors remember
    read(state, memory, parameters, readings)      writes the readings, without noise

Between two samples a filter corrects the state. So `before` is the corrected state that `step`
started from, and may differ from the `state` of the last call of `remember`. docs/another_plant.md
describes a second plant step by step.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from numba import float64, void
from numpy.typing import NDArray

from rig.jit import njit

if TYPE_CHECKING:
    from .additions import Layout

Array = NDArray[np.float64]

_VECTOR: Final = float64[::1]
DRIVE: Final = void(_VECTOR, _VECTOR, _VECTOR)
STEP: Final = void(_VECTOR, _VECTOR, _VECTOR)
REMEMBER: Final = void(_VECTOR, _VECTOR, _VECTOR, _VECTOR)
READ: Final = void(_VECTOR, _VECTOR, _VECTOR, _VECTOR)
"""DRIVE, STEP, REMEMBER and READ are the numba signatures with which the four functions are
compiled, as in `njit(STEP, cache=True, error_model="numpy")`."""
MEASURE: Final = void(_VECTOR, _VECTOR, _VECTOR, _VECTOR)
"""The numba signature of `Plant.measures`."""
_MATRIX: Final = float64[:, ::1]
DRIVE_IN_LANES: Final = void(_VECTOR, _MATRIX)
STEP_IN_LANES: Final = void(_MATRIX, _MATRIX, _MATRIX, _VECTOR)
REMEMBER_IN_LANES: Final = STEP_IN_LANES
READ_IN_LANES: Final = void(_MATRIX, _MATRIX, _MATRIX, _VECTOR, _MATRIX)
"""The four signatures that end in _IN_LANES are those of the optional functions in `InLanes`."""


@dataclass(frozen=True, slots=True)
class State:
    """One state of a plant.

    Attributes:
        name: name used in reports.
        unit: SI unit.
        change: small change of the state, SI, by which derivatives are taken by differences.
        noise: standard deviation, SI, of the error that the model makes in this state over one
            sample.
    """

    name: str
    unit: str
    change: float
    noise: float


@dataclass(frozen=True, slots=True)
class Channel:
    """One channel of a recording, which a plant predicts.

    Attributes:
        channel: name of the recording's column.
        unit: SI unit of the readings.
        noise: standard deviation of the noise of a reading, SI, greater than 0.
        resolution: step of a counting sensor, SI; 0 if the sensor does not count.
        lower: lower end of the sensor's range, SI; a reading at or below it is saturated.
        upper: upper end of the range, SI; a reading at or above it is saturated.
        shown: unit used in reports, and the number of such units in one SI unit; None for the SI
            unit.
    """

    channel: str
    unit: str
    noise: float
    resolution: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf
    shown: tuple[str, float] | None = None


@dataclass(frozen=True, slots=True)
class Output(Channel):
    """One measured channel of a plant.

    Attributes:
        of: names of the regions (`Region`) that an error of the readings may depend on, besides
            time.
    """

    of: tuple[str, ...] = ()

    @property
    def variance(self) -> float:
        """Return the variance of a reading, from its noise and its rounding to the resolution."""
        return self.noise**2 + self.resolution**2 / 12.0


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a plant. Its value is not here: each model has its own.

    Attributes:
        name: name, as in model files.
        unit: SI unit.
        lower: least value that a model file may give, SI.
        upper: greatest value that a model file may give, SI.
        neutral: value at which what the parameter describes is absent; None if it is present in
            every plant.
        probe: small but visible change, SI, for derivatives by differences. 0 stands for a 1000th
            of the range, or for a 100th of the value if that is less and the value is not 0.
        about: symbol and source of the parameter, which are written to model files.
    """

    name: str
    unit: str
    lower: float
    upper: float
    neutral: float | None = None
    probe: float = 0.0
    about: str = ""


@dataclass(frozen=True, slots=True)
class Knob:
    """One parameter that an effect moves off its neutral value.

    Attributes:
        key: name of the knob within the effect, as in a model file.
        parameter: name of the plant's parameter.
        probe: small but visible change, SI, for derivatives by differences.
        lower: least plausible value, SI.
        upper: greatest plausible value, SI.
        follows: names of other parameters, which are scaled by the same factor as this one.
        logarithmic: whether fits step in the logarithm of the value; `lower` must then be above 0.
    """

    key: str
    parameter: str
    probe: float
    lower: float
    upper: float
    follows: tuple[str, ...] = ()
    logarithmic: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Trace:
    """One recording with its predictions one sample ahead.

    Attributes:
        inputs: float64 (n, inputs), as commanded.
        states: float64 (n, states), filtered.
        innovations: float64 (n, outputs), divided by their standard deviations; 0 where a reading
            is not used.
        readings: float64 (n, outputs), as recorded; a missing one is replaced by the last before
            it. Where the model is far off, the filtered states are wrong as well, and the readings
            are the better source.
    """

    inputs: Array
    states: Array
    innovations: Array
    readings: Array


Proposal = Callable[[Sequence[Trace], Mapping[str, float]], tuple[Mapping[str, float], ...]]


@dataclass(frozen=True, slots=True)
class Effect:
    """A physical effect that a model may lack.

    Attributes:
        name: name used in reports and model files.
        equation: what the effect adds to the model, in symbols.
        where: name of the equation that the effect enters (`Equation.name`), or of the channel
            whose readings it changes.
        knobs: parameters that are fitted.
        starts: values of the knobs, by key, from which fits start where the present values are no
            start, because the cost has no slope there. A knob that a start lacks keeps its value.
            Without `starts` and `propose` fits start from the present values.
        unseen: what recordings cannot show of the effect on principle, in words for the report.
        propose: (recordings as predicted, values of all parameters by name) -> further starts, for
            an effect whose starts depend on the recorded motion. It returns an empty tuple if the
            recordings show nothing of the effect.
        own: pairs of a place that a disturbance may enter and a quantity that it may depend on: the
            effect's formula acts there as a curve of that quantity. So a disturbance found there,
            beside the effect, counts as a correction of the formula.
        like: tests by which a discovered curve is recognised as this effect, even if the effect's
            formula explains little of it.
    """

    name: str
    equation: str
    where: str
    knobs: tuple[Knob, ...]
    starts: tuple[Mapping[str, float], ...] = ()
    unseen: str = ""
    propose: Proposal | None = None
    own: tuple[tuple[str, str], ...] = ()
    like: tuple["Likeness", ...] = ()


@dataclass(frozen=True)
class Likeness:
    """A test of whether a discovered curve is an effect, by its place, its quantity and its form.

    Attributes:
        place: name of the place that the disturbance must enter.
        of: name of the quantity that it must depend on.
        read: (quantity (k,), ascending, disturbance (k,), both SI) -> value of the effect's first
            knob that the curve shows, SI; None if the curve is not this effect.
    """

    place: str
    of: str
    read: Callable[[Array, Array], float | None]


@dataclass(frozen=True, slots=True)
class Nuisance:
    """A parameter that differs from rig to rig, and is refitted within a tolerance first of all.

    Attributes:
        parameter: name of the plant's parameter.
        probe: small but visible change, as in `Knob`.
        tolerance: greatest deviation from the nominal value, as a fraction of it.
        nominal: that nominal value, SI.
        effect: name of the effect that a larger deviation counts as; None if there is none.
    """

    parameter: str
    probe: float
    tolerance: float
    nominal: float
    effect: str | None = None


Rate = Callable[[Array, Mapping[str, float]], Array]


@dataclass(frozen=True, slots=True)
class Equation:
    """An equation that a disturbance may enter, or several that one disturbance enters at once.

    Attributes:
        name: name used in reports, such as "force balance" or "flow, chamber 1".
        unit: SI unit of the disturbance.
        state: index of the state whose rate the disturbance changes.
        rate: (states (n, count), parameters by name) -> float64 (n,), the change of that state over
            one sample by one unit of disturbance.
        shown: unit used in reports, and the number of such units in one SI unit.
        of: names of the regions (`Region`) that the disturbance may depend on, besides time.
        also: index and rate of each further state that the same disturbance changes. For example,
            oil that leaks from one chamber enters the other.
    """

    name: str
    unit: str
    state: int
    rate: Rate
    shown: tuple[str, float]
    of: tuple[str, ...]
    also: tuple[tuple[int, Rate], ...] = ()


@dataclass(frozen=True, slots=True)
class Varying:
    """A parameter that may change with a quantity, such as oil that softens while it warms.

    Attributes:
        name: name used in reports, such as "friction level".
        parameters: names of the plant's parameters that change by the same amount, one or two.
        unit: their SI unit.
        probe: small but visible change, SI, for derivatives by differences.
        of: names of the regions that the change may depend on, besides time.
        shown: unit used in reports, and the number of such units in one SI unit.
    """

    name: str
    parameters: tuple[str, ...]
    unit: str
    probe: float
    of: tuple[str, ...]
    shown: tuple[str, float]


@dataclass(frozen=True, slots=True)
class Region:
    """A quantity that says where in its range a plant works, such as its velocity.

    Attributes:
        name: name used in reports, such as "velocity".
        unit: SI unit.
        value: (states (n, count), inputs (n, inputs)) -> float64 (n,), the quantity at each sample.
        shown: unit used in reports, and the number of such units in one SI unit.
        symbol: symbol used in formulas; the name is used if it is empty.
        periodic: whether a disturbance may repeat along the quantity, as along the teeth of a rack.
    """

    name: str
    unit: str
    value: Callable[[Array, Array], Array]
    shown: tuple[str, float]
    symbol: str = ""
    periodic: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Motion:
    """A motion that an experiment may consist of (`estimator.gap.verdict.experiments`).

    Attributes:
        name: name of the motion, unique among motions.
        told: what the motion does, in words.
        inputs: float64 (n, inputs), commands in addition to those of the rig's own control loop.
        course: float64 (n, outputs), readings along which the rig's own control loop keeps the
            outputs; the motion starts from the first of them.
        campaign: contents of a campaign file that runs the motion, without its rig and model.
    """

    name: str
    told: str
    inputs: Array
    course: Array
    campaign: Mapping[str, Any]


@dataclass(frozen=True, eq=False, slots=True)
class InLanes:
    """The same plant for several runs side by side in lanes (`rig.lanes`), with the same inputs.

    The arrays have one column for each run: states (states, LANES), memory (rows, LANES),
    parameters (parameters, LANES) and readings (outputs, LANES).

    Attributes:
        begin: (start states (states, LANES), inputs (m, inputs), values of all parameters by name
            for each lane) -> memory (rows, LANES) at the first sample. It does not know the time
            since the recording began: a plant that depends on that time must run alone (`kind`).
        drive: (inputs, memory), compiled with DRIVE_IN_LANES.
        step: (states, memory, parameters, parameters of the first lane), compiled with
            STEP_IN_LANES.
        remember: (states, memory, parameters, parameters of the first lane), compiled with
            REMEMBER_IN_LANES. `step` must leave in the memory what it needs of the earlier states.
        read: (states, memory, parameters, parameters of the first lane, readings), compiled with
            READ_IN_LANES.
        kind: (values of all parameters by name) -> what all lanes share; None to run alone.
        acting: (values of all parameters by name) -> int64 (k,), ascending indices of the states
            that the filter takes derivatives by; None for all. What may be left out moves nothing
            after the step, or is known: it has no model error, and no other state moves it.
    """

    begin: Callable[[Array, Array, Sequence[Mapping[str, float]]], Array]
    drive: Any
    step: Any
    remember: Any
    read: Any
    kind: Callable[[Mapping[str, float]], tuple[float, ...] | None]
    acting: Callable[[Mapping[str, float]], NDArray[np.int64]] | None = None


@njit(DRIVE, cache=True, error_model="numpy")
def hold(inputs, memory, parameters):
    """Copy the inputs to the memory, for a plant on which they act unchanged and at once."""
    for i in range(inputs.size):
        memory[i] = inputs[i]


@njit(REMEMBER, cache=True, error_model="numpy")
def forget(before, state, memory, parameters):
    """Do nothing, as `remember` of a plant whose readings follow from its state alone.

    This function is also `measures` of a plant without quantities that an addition could depend on.
    """


def begin_held(state: Array, inputs: Array, values: Mapping[str, float], time_s: float) -> Array:
    """Return the inputs (inputs,) of the first sample, as memory that holds inputs alone."""
    return np.array(inputs[0], dtype=np.float64)


Starting = Callable[[Array, Array, Mapping[str, float]], tuple[Array, Array]]
Beginning = Callable[[Array, Array, Mapping[str, float], float], Array]
Write = Callable[[Mapping[str, float], tuple[str, ...], Mapping[str, Any], Any], None]


def not_to_a_file(
    values: Mapping[str, float], effects: tuple[str, ...], provenance: Mapping[str, Any], path: Any
) -> None:
    """Raise TypeError always: the plant was not made of a model file and cannot write one."""
    raise TypeError(f"{path}: this plant was not made of a model file, and writes none")


@dataclass(frozen=True)
class Plant:
    """Everything that the gap workflow knows of a plant.

    Attributes:
        name: name of the plant.
        states: states that the filter estimates.
        inputs: names of the recording's columns that drive the plant.
        input_units: SI units of the inputs, in their order.
        outputs: columns of a recording that are measured.
        parameters: all parameters, in the order of the array that the compiled functions take.
        nominal: values of the parameters by name, SI, in the model that is to be tested.
        step: function compiled with STEP.
        read: function compiled with READ.
        start: (readings (m, outputs) of the first 20 samples, inputs (m, inputs), parameters by
            name) -> (state (count,) at the first sample, its standard deviations (count,)).
            Readings that cannot be used are NaN, except in the first sample.
        effects: effects that a model of the plant may lack, by name.
        nuisances: parameters that are refitted before effects are looked for.
        equations: equations that a disturbance may enter.
        regions: quantities that a disturbance may depend on, by name.
        drive: function compiled with DRIVE.
        remember: function compiled with REMEMBER.
        begin: (start state (count,), inputs (m, inputs) of the first 20 samples, parameters by
            name, time since the recording began, s) -> memory (length,) at the first sample. The
            memory is at least as long as there are inputs.
        violent: (readings (n, outputs), parameters by name) -> bool (n,), whether the plant changes
            so quickly, and by laws so poorly known, that no model predicts what happens when within
            the sample, as on a stop or with an empty chamber. None if a plant is never violent.
        shares: (parameters by name) -> (outputs, states), the part of its optimal gains that the
            filter is to use. It is less than 1 where a late reading shows a past that hardly
            affects the present. None if all gains are used in full.
        period: sampling period, s.
        horizon: how far ahead predictions are judged, s.
        steering: input index, output index and gain of each feedback that keeps a simulation on the
            course of a recording.
        write: (values of all parameters by name, names of effects, provenance, path), writes the
            model file. `rig.runner.experiments.gap_results` and
            `rig.configuration.models.plant_loading` supply it; by default it raises TypeError.
        not_told_apart: for each pair of effects that are the same on principle, the reason in
            words.
        motions: () -> motions that an experiment may consist of; by default there are none.
        loop: as `steering`, but for the control loop that the rig itself closes in those motions.
        in_lanes: functions that run the plant in several lanes side by side; None if it always runs
            alone.
        measures: function compiled with MEASURE: (state, inputs, parameters, measured) writes the
            quantities of `regions`, then for each equation two rates: by how much one unit of
            disturbance changes its state, and its second state, over one sample (0 if it has none).
            With it a model can hold additions (`additions`).
        varying: parameters that may change with a quantity.
        layout: how models of the plant hold additions; `parameters` then end with those of the
            slots (`SLOT_PARAMETERS`). None if they hold none.
        why_no_layout: why models of the plant hold no additions, in words for the report; empty if
            they do, or if nothing is to be told.
    """

    name: str
    states: tuple[State, ...]
    inputs: tuple[str, ...]
    input_units: tuple[str, ...]
    outputs: tuple[Output, ...]
    parameters: tuple[Parameter, ...]
    nominal: Mapping[str, float]
    step: Any
    read: Any
    start: Starting
    effects: Mapping[str, Effect]
    nuisances: tuple[Nuisance, ...]
    equations: tuple[Equation, ...]
    regions: Mapping[str, Region]
    steering: tuple[tuple[int, int, float], ...]
    write: Write = not_to_a_file
    drive: Any = hold
    remember: Any = forget
    begin: Beginning = begin_held
    violent: Callable[[Array, Mapping[str, float]], NDArray[np.bool_]] | None = None
    shares: Callable[[Mapping[str, float]], Array] | None = None
    period: float = 1e-3
    horizon: float = 0.02
    not_told_apart: Mapping[frozenset[str], str] = field(default_factory=dict)
    motions: Callable[[], tuple[Motion, ...]] = tuple
    loop: tuple[tuple[int, int, float], ...] = ()
    in_lanes: InLanes | None = None
    measures: Any = forget
    varying: tuple[Varying, ...] = ()
    layout: "Layout | None" = None
    why_no_layout: str = ""

    @property
    def own_parameters(self) -> tuple[Parameter, ...]:
        """Return the parameters without those of the slots."""
        return self.parameters if self.layout is None else self.parameters[: self.layout.own]

    def vector(self, values: Mapping[str, float]) -> Array:
        """Return values as float64 (parameters,), in the order that compiled functions take."""
        return np.array([values[parameter.name] for parameter in self.parameters])
