"""The filters by name, behind one compiled step that the loop and the replay both call.

Every filter takes the same measurements and writes the same ten outputs a sample; its states are
its own. A code tells compiled loops which filter it is.
"""

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.plant import DATA_SHEET, Model, Parameters, SensorParameters, inlined, inner

from . import product, thesis
from .divergence import RESETS
from .product import product_step, start_product
from .product_model import STATE_COUNT, STATES
from .product_noise import ProductNoise, product_noise
from .thesis import thesis6_step, thesis7_step
from .ud import dense_covariance

Array = NDArray[np.float64]

PRODUCT: Final = None
"""No number: where it is chosen the compiler leaves out the others, half of what there is to do."""
THESIS_6: Final = 1
THESIS_7: Final = 2

OUTPUTS: Final = (
    "innovation_position_m",
    "innovation_pressure_1_Pa",
    "innovation_pressure_2_Pa",
    "residual_position_m",
    "residual_pressure_1_Pa",
    "residual_pressure_2_Pa",
    "innovation_variance_position_m2",
    "innovation_variance_pressure_1_Pa2",
    "innovation_variance_pressure_2_Pa2",
    "filter_resets",
)
"""What every filter writes a sample: z - H x(-), z - H x(+), the innovation's variance, and how
often it has started anew for being lost (`estimator.filters.divergence`; the thesis's never do)."""

_THESIS_STATES: Final = STATES[:6]


@dataclass(frozen=True)
class Filter:
    """A filter that can be chosen by name."""

    name: str
    code: int | None
    states: tuple[str, ...]
    summary: str
    factored: bool = False
    """Whether the covariance is kept as its factors (`estimator.filters.ud`)."""


FILTERS: Final = {
    entry.name: entry
    for entry in (
        Filter(
            "product",
            PRODUCT,
            STATES,
            "load, three leak coefficients and spool null bias as states; stable prediction",
            factored=True,
        ),
        Filter("thesis-6", THESIS_6, _THESIS_STATES, "eq. 2.15 with the Karnopp friction model"),
        Filter(
            "thesis-7", THESIS_7, (*_THESIS_STATES, "load_N"), "eqs. 6.13 to 6.19, load as state"
        ),
    )
}
DEFAULT_FILTER: Final = "product"


def filter_named(name: str) -> Filter:
    """Return a filter by name.

    Raises:
        ValueError: there is no such filter; the message lists those there are.
    """
    try:
        return FILTERS[name]
    except KeyError:
        raise ValueError(f"no filter {name!r}; choose one of {', '.join(FILTERS)}") from None


@dataclass
class FilterMemory:
    """A filter's state between samples.

    Attributes:
        filter: which filter.
        x: state vector.
        covariance: P, or its factors where the filter is `factored`.
        noise: what the product filter assumes.
        work: the product filter's memory of its own health, and scratch.
    """

    filter: Filter
    x: Array
    covariance: Array
    noise: ProductNoise
    work: Array

    @property
    def dense_covariance(self) -> Array:
        """P, square over the filter's states."""
        return dense_covariance(self.covariance) if self.filter.factored else self.covariance

    def copy(self) -> "FilterMemory":
        """Return a filter that goes on from here by itself."""
        return replace(
            self, x=self.x.copy(), covariance=self.covariance.copy(), work=self.work.copy()
        )

    @property
    def resets(self) -> int:
        """How often the filter has started anew for being lost."""
        return int(self.work[0, RESETS])


def start_memory(name: str, model: Model, sensors: SensorParameters = DATA_SHEET) -> FilterMemory:
    """Return a filter's memory before its first sample; `model` is what the filter assumes."""
    chosen = filter_named(name)
    if chosen.code is PRODUCT:
        x, covariance = np.zeros(STATE_COUNT), np.zeros((STATE_COUNT, STATE_COUNT))
    else:
        x, covariance = thesis.initial_state(chosen.code != THESIS_6)
    noise = product_noise(sensors, model.parameters)
    return FilterMemory(chosen, x, covariance, noise, np.zeros(product.WORK_SHAPE))


class CompiledFilter(NamedTuple):
    """A filter as compiled code takes it: which it is, what it assumes, and where it writes."""

    code: int | None
    """Which filter."""
    x: Array
    """(states,) the newest estimates; updated."""
    covariance: Array
    """As in `FilterMemory`; updated."""
    parameters: Parameters
    """Of the rig, as the filter assumes them."""
    noise: ProductNoise
    """What the product filter assumes of the transducers."""
    work: Array
    """The product filter's memory and scratch; updated."""


def compiled_filter(memory: FilterMemory, assumed: Parameters) -> CompiledFilter:
    """Return a filter's memory for compiled code, which goes on in the same arrays."""
    return CompiledFilter(
        memory.filter.code, memory.x, memory.covariance, assumed, memory.noise, memory.work
    )


@inner
def filter_start(filt, command, reading):
    """Take the first sample. The thesis filters start from their printed x0 (section 4.5).

    Args:
        filt: `CompiledFilter`; updated.
        command: V, held from this sample on.
        reading: as in `product_step`.
    """
    if filt.code is None:
        start_product(
            filt.x, filt.covariance, command, reading, filt.parameters, filt.noise, filt.work
        )


@inlined
def filter_step(filt, command, reading, out):
    """Advance a filter by one sample; see `product_step` for the arguments.

    The thesis filters use neither the spool nor the supply pressure.
    """
    _step_of(filt.code, filt, command, reading, out)


@inlined
def _step_of(code, filt, command, reading, out):
    """Advance the filter of a code, an argument of its own: the compiler leaves out the others."""
    x, covariance, par = filt.x, filt.covariance, filt.parameters
    if code is None:
        product_step(x, covariance, command, reading, par, filt.noise, filt.work, out)
        return
    out[9] = 0.0
    if code == THESIS_6:
        thesis6_step(x, covariance, command, reading[0], reading[1], reading[2], par, out)
    else:
        thesis7_step(x, covariance, command, reading[0], reading[1], reading[2], par, out)


@njit(cache=True, error_model="numpy", nogil=True)
def _run(filt, command, measured, states, outputs):
    z, count = measured, filt.x.size
    filter_start(filt, command[0], (z[0, 0], z[0, 1], z[0, 2], z[0, 3], z[0, 4]))
    outputs[0] = np.nan
    for i in range(count):
        states[0, i] = filt.x[i]
    for k in range(1, command.size):
        reading = (z[k, 0], z[k, 1], z[k, 2], z[k, 3], z[k, 4])
        filter_step(filt, command[k - 1], reading, outputs[k])
        for i in range(count):
            states[k, i] = filt.x[i]


@dataclass(frozen=True)
class FilterRun:
    """A filter's estimates over a recording.

    Attributes:
        filter: which filter.
        time_s: float64 (n,).
        states: float64 (n, filter states), a posteriori, SI, columns as `filter.states`.
        outputs: float64 (n, 10), columns as `OUTPUTS`; the first row starts the filter and is NaN.
        covariance: final covariance P, square over the filter's states.
    """

    filter: Filter
    time_s: Array
    states: Array
    outputs: Array
    covariance: Array

    def state(self, name: str) -> Array:
        """Return one state's trajectory by its name in `filter.states`."""
        return self.states[:, self.filter.states.index(name)]

    @property
    def innovation(self) -> Array:
        """Innovations of position (m), pressure 1 and pressure 2 (Pa): float64 (n, 3)."""
        return self.outputs[:, 0:3]

    @property
    def residual(self) -> Array:
        """A posteriori residuals of position (m), pressures 1 and 2 (Pa): (n, 3) (eq. 4.24)."""
        return self.outputs[:, 3:6]

    @property
    def reset_times_s(self) -> Array:
        """When the filter was found lost and started anew, s: one entry a reset."""
        return self.time_s[1:][np.diff(self.outputs[:, 9]) > 0.0]


def run_filter(
    time_s: Array,
    command: Array,
    measured: Array,
    model: Model,
    name: str = DEFAULT_FILTER,
    sensors: SensorParameters = DATA_SHEET,
) -> FilterRun:
    """Run a filter over a recording's samples, as the loop would have.

    Args:
        time_s: float64 (n,), 1 kHz.
        command: float64 (n,), V; row k is held from sample k to k + 1.
        measured: float64 (n, 4 or 5): position (m), pressures 1 and 2 (Pa), spool (m) and, from a
            rig that measures it, supply pressure (Pa); NaN is skipped.
        model: the model the filter assumes.
        name: a name in `FILTERS`.
        sensors: data sheet of the transducers.

    Raises:
        ValueError: no filter of that name, or arrays of different lengths.
    """
    rows = time_s.size
    if measured.shape not in ((rows, 4), (rows, 5)) or command.shape != time_s.shape:
        raise ValueError(
            f"measured {measured.shape} and command {command.shape} do not fit {rows} rows "
            "of (position, pressure 1, pressure 2, spool[, supply pressure])"
        )
    if measured.shape[1] == 4:
        measured = np.column_stack([measured, np.full(rows, np.nan)])
    memory = start_memory(name, model, sensors)
    states = np.empty((time_s.size, memory.x.size))
    outputs = np.empty((time_s.size, len(OUTPUTS)))
    _run(
        compiled_filter(memory, model.parameters),
        np.ascontiguousarray(command),
        np.ascontiguousarray(measured),
        states,
        outputs,
    )
    return FilterRun(memory.filter, time_s, states, outputs, memory.dense_covariance)
