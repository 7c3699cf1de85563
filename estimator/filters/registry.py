"""The filters by name, with one compiled step that the loop and the replay both call.

All filters take the same measurements and write the same ten outputs for a sample, but their states
differ. In compiled code a filter is identified by its `code`.
"""

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.plant import DATA_SHEET, Model, Parameters, SensorParameters, inlined, inner

from . import product, thesis
from .product import product_step, start_product
from .product_model import STATE_COUNT, STATES
from .product_noise import ProductNoise, product_noise
from .thesis import thesis6_step, thesis7_step
from .ud import dense_covariance

Array = NDArray[np.float64]

PRODUCT: Final = None
"""Code of the product filter. It is None and not a number, so that the compiler knows it by type
and leaves out the other filters, which are half of its work."""
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
"""Names of the ten outputs that every filter writes for a sample.

They are the innovations z - H x(-), the residuals z - H x(+), the variances of the innovations, and
how often the filter was lost and has started anew (`estimator.filters.divergence`; always 0 for the
thesis filters)."""

_THESIS_STATES: Final = STATES[:6]


@dataclass(frozen=True)
class Filter:
    """A filter that can be chosen by name, with the names of its states and a summary for users."""

    name: str
    code: int | None
    states: tuple[str, ...]
    summary: str


FILTERS: Final = {
    entry.name: entry
    for entry in (
        Filter(
            "product",
            PRODUCT,
            STATES,
            "load, three leak coefficients and spool null bias as states; stable prediction",
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
        ValueError: there is no filter of that name; the message lists the existing ones.
    """
    try:
        return FILTERS[name]
    except KeyError:
        raise ValueError(f"no filter {name!r}; choose one of {', '.join(FILTERS)}") from None


@dataclass
class FilterMemory:
    """The memory of one running filter between samples; its arrays are updated in place.

    Attributes:
        filter: the filter.
        x: estimated states, (states,).
        covariance: covariance P of the states; of the product filter its factors
            (`estimator.filters.ud`).
        noise: noise that the product filter assumes.
        work: the product filter's `work` array (`product.WORK_SHAPE`).
    """

    filter: Filter
    x: Array
    covariance: Array
    noise: ProductNoise
    work: Array

    @property
    def dense_covariance(self) -> Array:
        """Return the covariance P, (states, states)."""
        if self.filter.code is PRODUCT:
            return dense_covariance(self.covariance)
        return self.covariance

    def copy(self) -> "FilterMemory":
        """Return a copy that continues from the present state independently of this one."""
        return replace(
            self, x=self.x.copy(), covariance=self.covariance.copy(), work=self.work.copy()
        )


def start_memory(name: str, model: Model, sensors: SensorParameters = DATA_SHEET) -> FilterMemory:
    """Return a filter's memory before its first sample; `model` is what the filter assumes.

    Raises:
        ValueError: there is no filter of that name.
    """
    chosen = filter_named(name)
    if chosen.code is PRODUCT:
        x, covariance = np.zeros(STATE_COUNT), np.zeros((STATE_COUNT, STATE_COUNT))
    else:
        x, covariance = thesis.initial_state(chosen.code != THESIS_6)
    noise = product_noise(sensors, model.parameters)
    return FilterMemory(chosen, x, covariance, noise, np.zeros(product.WORK_SHAPE))


class CompiledFilter(NamedTuple):
    """The memory of one running filter in the form that compiled code takes."""

    code: int | None
    """`PRODUCT`, `THESIS_6` or `THESIS_7`."""
    x: Array
    """The newest estimates, (states,); updated."""
    covariance: Array
    """The covariance or its factors, as in `FilterMemory`; updated."""
    parameters: Parameters
    """Parameters of the rig that the filter assumes."""
    noise: ProductNoise
    """Noise that the product filter assumes."""
    work: Array
    """The product filter's memory and scratch; updated."""


def compiled_filter(memory: FilterMemory, assumed: Parameters) -> CompiledFilter:
    """Return a filter's memory in the form for compiled code, which updates the same arrays."""
    return CompiledFilter(
        memory.filter.code, memory.x, memory.covariance, assumed, memory.noise, memory.work
    )


@inner
def filter_start(filt, command, reading):
    """Start a filter, in place, with its first sample, which only the product filter uses.

    The thesis filters ignore that sample, as they start from their printed x0 (section 4.5).

    Args:
        filt: `CompiledFilter`, updated.
        command: command in V that is held from this sample on.
        reading: the sample, as in `product_step`.
    """
    if filt.code is None:
        start_product(
            filt.x, filt.covariance, command, reading, filt.parameters, filt.noise, filt.work
        )


@inlined
def filter_step(filt, command, reading, out):
    """Advance a filter by one sample, in place, whichever of the three it is.

    Args:
        filt: `CompiledFilter`, updated.
        command: command in V held since the last sample.
        reading: position (m), pressures 1 and 2 (Pa), spool (m), supply pressure (Pa), as in
            `product_step`; the thesis filters use neither spool nor supply pressure.
        out: float64 (10,), overwritten, in the order of `OUTPUTS`.
    """
    _step_of(filt.code, filt, command, reading, out)


@inlined
def _step_of(code, filt, command, reading, out):
    """Advance the filter of the given code, as `filter_step` does.

    The code is an argument of its own so that the compiler leaves out all other filters.
    """
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
        filter: the filter.
        time_s: time of each sample, float64 (n,).
        states: estimates after each sample, float64 (n, states), SI, columns as `filter.states`;
            NaN until the product filter has started.
        outputs: float64 (n, 10), columns as `OUTPUTS`; NaN in the first row, and in all rows up to
            the one that starts the product filter.
        covariance: covariance P after the last sample, (states, states).
    """

    filter: Filter
    time_s: Array
    states: Array
    outputs: Array
    covariance: Array

    def state(self, name: str) -> Array:
        """Return one state's estimates (n,), SI, by its name in `filter.states`.

        Raises:
            ValueError: the filter has no state of that name.
        """
        return self.states[:, self.filter.states.index(name)]

    @property
    def innovation(self) -> Array:
        """Return the innovations of position (m), pressures 1 and 2 (Pa): float64 (n, 3)."""
        return self.outputs[:, 0:3]

    @property
    def residual(self) -> Array:
        """Return the residuals of position (m), pressures 1 and 2 (Pa): (n, 3) (eq. 4.24)."""
        return self.outputs[:, 3:6]

    @property
    def reset_times_s(self) -> Array:
        """Return the times in s at which the filter was found lost and started anew."""
        return self.time_s[1:][np.diff(self.outputs[:, 9]) > 0.0]


def run_filter(
    time_s: Array,
    command: Array,
    measured: Array,
    model: Model,
    name: str = DEFAULT_FILTER,
    sensors: SensorParameters = DATA_SHEET,
) -> FilterRun:
    """Run a filter over a recording's samples, as the loop would have, and return its estimates.

    Args:
        time_s: time of each sample at 1 kHz, float64 (n,), at least one.
        command: float64 (n,), V; row k is held from sample k to k + 1.
        measured: float64 (n, 4 or 5): position (m), pressures 1 and 2 (Pa), spool (m) and, from a
            rig that measures it, supply pressure (Pa); a NaN is skipped.
        model: the model that the filter assumes.
        name: a name in `FILTERS`.
        sensors: data sheet of the transducers.

    Raises:
        ValueError: there is no filter of that name, or the arrays' shapes do not fit.
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
