"""What the workflow needs to know of a plant; docs/another_plant.md walks through a second one.

A plant is a discrete-time model, one sample a step, in four compiled functions. Between its states,
which the filter estimates, and what is commanded and read there may be a memory, which it does not:
the play of a spool, the lag of a transducer. Each sample, in this order:

    drive(inputs, memory, parameters)              what reaches the plant of the inputs
    step(state, memory, parameters)                the state one sample later, in place
    remember(before, state, memory, parameters)    what the sensors make of the state's move
    read(state, memory, parameters, readings)      the readings, without noise

Between two samples a filter corrects the state: `before` is the state that was stepped, not the one
that was last remembered.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np
from numba import float64, void
from numpy.typing import NDArray

from rig.jit import njit

Array = NDArray[np.float64]

_VECTOR: Final = float64[::1]
DRIVE: Final = void(_VECTOR, _VECTOR, _VECTOR)
STEP: Final = void(_VECTOR, _VECTOR, _VECTOR)
REMEMBER: Final = void(_VECTOR, _VECTOR, _VECTOR, _VECTOR)
READ: Final = void(_VECTOR, _VECTOR, _VECTOR, _VECTOR)
"""Signatures to compile the four functions with: `njit(STEP, cache=True, error_model="numpy")`."""
_MATRIX: Final = float64[:, ::1]
DRIVE_IN_LANES: Final = void(_VECTOR, _MATRIX)
STEP_IN_LANES: Final = void(_MATRIX, _MATRIX, _MATRIX, _VECTOR)
REMEMBER_IN_LANES: Final = STEP_IN_LANES
READ_IN_LANES: Final = void(_MATRIX, _MATRIX, _MATRIX, _VECTOR, _MATRIX)
"""Signatures of what a plant may give beside, see `InLanes`."""


@dataclass(frozen=True, slots=True)
class State:
    """One state of a plant.

    Attributes:
        name: as in reports.
        unit: SI.
        change: a small change of it, for derivatives by differences.
        noise: standard deviation of the model's own error over one sample.
    """

    name: str
    unit: str
    change: float
    noise: float


@dataclass(frozen=True, slots=True)
class Output:
    """One measured channel of a recording.

    Attributes:
        channel: column of the recording.
        unit: SI.
        noise: standard deviation of a reading.
        resolution: step of a counting sensor, 0 if it has none.
        lower: least reading; at or below it a reading is saturated.
        upper: greatest reading.
        shown: unit in reports, and how many of it are one SI unit.
        of: what an error of its readings is drawn against, names of `Region`.
    """

    channel: str
    unit: str
    noise: float
    resolution: float = 0.0
    lower: float = -np.inf
    upper: float = np.inf
    shown: tuple[str, float] | None = None
    of: tuple[str, ...] = ()

    @property
    def variance(self) -> float:
        """Variance of a reading, rounding included."""
        return self.noise**2 + self.resolution**2 / 12.0


@dataclass(frozen=True, slots=True)
class Parameter:
    """One parameter of a plant; its value is the model's.

    Attributes:
        name: as in model files.
        unit: SI.
        lower: least value that a model file may give.
        upper: greatest value.
        neutral: value at which what it describes is not there, None if every plant has it.
        probe: a small but visible change, for derivatives by differences; 0 for a 1000th of its
            range, or a 100th of its value if that is less.
        about: its symbol and source, for model files.
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
    """A parameter that an effect moves off its neutral value.

    Attributes:
        key: its name in the effect, as in a model file.
        parameter: of the plant.
        probe: a small but visible change, for derivatives by differences.
        lower: least plausible value.
        upper: greatest plausible value.
        follows: other parameters that change in proportion, relative to their own values.
        logarithmic: whether its size is sought on a logarithmic scale; it is positive then.
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
    """One recording as predicted one sample ahead.

    Attributes:
        inputs: float64 (n, inputs), as commanded.
        states: float64 (n, states), filtered.
        innovations: float64 (n, outputs), over their standard deviations.
        readings: float64 (n, outputs); where the model is far off, so are the states.
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
        name: in reports and model files.
        equation: what it adds, in symbols.
        where: name of the equation it enters (`Equation.name`) or the channel it is read in.
        knobs: what is fitted.
        starts: values of the knobs, by key, to start a fit from where the neutral ones are no
            start (no slope there); empty for those that can be reached from the neutral values.
        unseen: what of it cannot be told on principle, for the report.
        propose: (recordings as predicted, values of all parameters by name) -> further starts,
            where these depend on the motion; empty if the recordings show nothing of the effect.
    """

    name: str
    equation: str
    where: str
    knobs: tuple[Knob, ...]
    starts: tuple[Mapping[str, float], ...] = ()
    unseen: str = ""
    propose: Proposal | None = None


@dataclass(frozen=True, slots=True)
class Nuisance:
    """A parameter that differs from rig to rig: refitted within a tolerance first.

    Attributes:
        parameter: of the plant.
        probe: as of `Knob`.
        tolerance: greatest deviation, as a fraction of the nominal value.
        nominal: that value.
        effect: name of the effect it is beyond the tolerance, None if it has none.
    """

    parameter: str
    probe: float
    tolerance: float
    nominal: float
    effect: str | None = None


@dataclass(frozen=True, slots=True)
class Held:
    """A disturbance in symbols as a plant's parameters hold it.

    Attributes:
        values: of all parameters, with it; empty if none of its terms can be held.
        knobs: of its terms, to be refitted.
        refused: number of each term that cannot be held, and why, in words.
    """

    values: Mapping[str, float]
    knobs: tuple[Knob, ...]
    refused: tuple[tuple[int, str], ...] = ()


Rate = Callable[[Array, Mapping[str, float]], Array]


@dataclass(frozen=True, slots=True)
class Equation:
    """An equation that a disturbance may enter, or several that one disturbance enters at once.

    Attributes:
        name: as in reports: "force balance", "chamber 1".
        unit: of the disturbance, SI.
        state: index of the state whose rate it drives.
        rate: (states (n, count), parameters by name) -> float64 (n,), change of that state in one
            sample by one unit of disturbance.
        shown: unit in reports, and how many of it are one SI unit.
        of: what it is drawn against, names of `Region`.
        also: further states that the same disturbance drives, with their rates: what leaks from one
            chamber comes into the other.
    """

    name: str
    unit: str
    state: int
    rate: Rate
    shown: tuple[str, float]
    of: tuple[str, ...]
    also: tuple[tuple[int, Rate], ...] = ()


@dataclass(frozen=True, slots=True)
class Region:
    """A quantity that says where in its range a plant is working.

    Attributes:
        name: as in reports: "velocity".
        unit: SI.
        value: (states (n, count), inputs (n, inputs)) -> float64 (n,).
        shown: unit in reports, and how many of it are one SI unit.
        symbol: in formulas, its name if empty.
        periodic: whether something may repeat along it, such as the teeth of a rack.
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
        name: of it, alone of its kind.
        told: what it does, in words.
        inputs: float64 (n, inputs), beside what the rig's own loop adds.
        course: float64 (n, outputs), where the rig's own loop keeps the outputs; readings to start
            from.
        campaign: of a campaign file that runs it, without rig and model.
    """

    name: str
    told: str
    inputs: Array
    course: Array
    campaign: Mapping[str, Any]


@dataclass(frozen=True, eq=False, slots=True)
class InLanes:
    """A plant for several runs side by side (`rig.lanes`), by the same inputs.

    States (states, LANES), memory (rows, LANES), parameters (parameters, LANES) and readings
    (outputs, LANES) have a column for each run.

    Attributes:
        begin: (start states (states, LANES), inputs (m, inputs), values of all parameters by name
            of each lane) -> memory (rows, LANES) at the first sample; what depends on the time
            since the recording began runs alone (`kind`).
        drive: (inputs, memory), compiled with DRIVE_IN_LANES.
        step: (states, memory, parameters, those of the first lane), compiled with STEP_IN_LANES.
        remember: (states, memory, parameters, those of the first lane), compiled with
            REMEMBER_IN_LANES. What it needs of the states before, `step` leaves in the memory.
        read: (states, memory, parameters, those of the first lane, readings), compiled with
            READ_IN_LANES.
        kind: (values of all parameters by name) -> what runs must have in common to be side by
            side; None of one that runs alone.
    """

    begin: Callable[[Array, Array, Sequence[Mapping[str, float]]], Array]
    drive: Any
    step: Any
    remember: Any
    read: Any
    kind: Callable[[Mapping[str, float]], tuple[float, ...] | None]


@njit(DRIVE, cache=True, error_model="numpy")
def hold(inputs, memory, parameters):
    """Drive of a plant that its inputs reach as they are: they are kept in the memory."""
    for i in range(inputs.size):
        memory[i] = inputs[i]


@njit(REMEMBER, cache=True, error_model="numpy")
def forget(before, state, memory, parameters):
    """Remember nothing: the readings of such a plant follow from its state."""


def begin_held(state: Array, inputs: Array, values: Mapping[str, float], time_s: float) -> Array:
    """Return the memory of a plant that keeps nothing but its inputs (inputs,)."""
    return np.array(inputs[0], dtype=np.float64)


Write = Callable[[Mapping[str, float], tuple[str, ...], Mapping[str, Any], Any], None]


def not_to_a_file(
    values: Mapping[str, float], effects: tuple[str, ...], provenance: Mapping[str, Any], path: Any
) -> None:
    """Refuse to write: a plant that no model file was read for has none.

    Raises:
        TypeError: always.
    """
    raise TypeError(f"{path}: this plant was not made of a model file, and writes none")


@dataclass(frozen=True)
class Plant:
    """A plant as the workflow sees it.

    Attributes:
        name: of the plant.
        states: what the filter estimates.
        inputs: columns of a recording that drive it.
        outputs: columns of a recording that are measured.
        parameters: in the order of the array that the compiled functions take.
        nominal: their values by name: the model to be tested, SI.
        step: compiled with STEP.
        read: compiled with READ.
        start: (readings (m, outputs) of the first samples, inputs (m, inputs), parameters by name)
            -> (state (count,), its standard deviations (count,)).
        effects: what it may lack, by name.
        nuisances: what is refitted first.
        equations: where disturbances enter.
        regions: what these are drawn against, by name.
        drive: compiled with DRIVE.
        remember: compiled with REMEMBER.
        begin: (start state (count,), inputs (m, inputs), parameters by name, time since the
            recording began, s) -> memory (length,) at the first sample; at least as long as there
            are inputs.
        violent: (readings (n, outputs), parameters by name) -> bool (n,): where the plant changes
            so quickly, and by laws known so badly, that no model predicts within a sample what
            happens when: on a stop, with an empty chamber; None if there is nothing of the kind.
        memories: parameters, neutral at 0, by which readings depend on the states before.
        shares: (parameters by name) -> (outputs, states): part of its best gains that the filter
            is to use, less than 1 where a reading tells of a past that hardly matters any more;
            None if all are used.
        period: one sample, s.
        horizon: how far ahead predictions are judged, s.
        steering: input, output and gain that keep a simulation on the course of a recording.
        write: (values of all parameters by name, names of effects, provenance, path): writes the
            model file. `rig.runner.experiments.gap_results` and
            `rig.configuration.models.plant_loading` give it.
        not_told_apart: reasons, by pair of effects, why these are the same on principle.
        motions: () -> motions that an experiment may consist of; none if none is known.
        loop: as `steering`, of the loop that the rig itself closes in them.
        hold_terms: (name of an equation or reading, terms (`terms.Term`), their coefficients, SI,
            values of all parameters by name) -> how the model holds a disturbance in symbols; None
            if it cannot hold any.
        held_terms: (values of all parameters by name) -> that equation and its terms, each with
            its coefficients.
        in_lanes: the same plant for several runs side by side; None if it runs alone.
    """

    name: str
    states: tuple[State, ...]
    inputs: tuple[str, ...]
    outputs: tuple[Output, ...]
    parameters: tuple[Parameter, ...]
    nominal: Mapping[str, float]
    step: Any
    read: Any
    start: Callable[[Array, Array, Mapping[str, float]], tuple[Array, Array]]
    effects: Mapping[str, Effect]
    nuisances: tuple[Nuisance, ...]
    equations: tuple[Equation, ...]
    regions: Mapping[str, Region]
    steering: tuple[tuple[int, int, float], ...]
    write: Callable[[Mapping[str, float], tuple[str, ...], Mapping[str, Any], Any], None] = (
        not_to_a_file
    )
    drive: Any = hold
    remember: Any = forget
    begin: Callable[[Array, Array, Mapping[str, float], float], Array] = begin_held
    violent: Callable[[Array, Mapping[str, float]], NDArray[np.bool_]] | None = None
    memories: tuple[str, ...] = ()
    shares: Callable[[Mapping[str, float]], Array] | None = None
    period: float = 1e-3
    horizon: float = 0.02
    not_told_apart: Mapping[frozenset[str], str] = field(default_factory=dict)
    motions: Callable[[], tuple[Motion, ...]] = tuple
    loop: tuple[tuple[int, int, float], ...] = ()
    hold_terms: Callable[[str, Sequence[Any], Array, Mapping[str, float]], Held] | None = None
    held_terms: Callable[[Mapping[str, float]], tuple[str, Any]] | None = None
    in_lanes: InLanes | None = None

    def remembers(self, values: Mapping[str, float]) -> bool:
        """Return whether readings depend on the states before."""
        return any(values[name] != 0.0 for name in self.memories)

    def vector(self, values: Mapping[str, float]) -> Array:
        """Return the values of all parameters as the compiled functions take them."""
        return np.array([values[parameter.name] for parameter in self.parameters])
