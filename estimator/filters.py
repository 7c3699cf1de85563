"""The filters by name, behind one compiled step that the loop and the replay both call.

Every filter takes the same measurements and writes the same nine outputs a sample; its states are
its own. A code tells compiled loops which filter it is.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rig.plant import Model
from rig.plant.compiled import inlined, inner
from rig.plant.sensors import DATA_SHEET, SensorParameters

from . import product, thesis
from .product import ProductNoise, product_noise, product_step, start_product
from .product_model import STATE_COUNT, STATES
from .thesis import thesis6_step, thesis7_step

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
)
"""What every filter writes a sample: z - H x(-), z - H x(+) and the innovation's variance."""

_THESIS_STATES: Final = STATES[:6]


@dataclass(frozen=True)
class Filter:
    """A filter that can be chosen by name."""

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
        ValueError: there is no such filter; the message lists those there are.
    """
    try:
        return FILTERS[name]
    except KeyError:
        raise ValueError(f"no filter {name!r}; choose one of {', '.join(FILTERS)}") from None


@dataclass
class FilterMemory:
    """A filter's state between samples: state vector, covariance, noise and scratch space."""

    filter: Filter
    x: Array
    covariance: Array
    noise: ProductNoise
    work: Array


def start_memory(name: str, model: Model, sensors: SensorParameters = DATA_SHEET) -> FilterMemory:
    """Return a filter's memory before its first sample; `model` is what the filter assumes."""
    chosen = filter_named(name)
    if chosen.code is PRODUCT:
        x, covariance = np.zeros(STATE_COUNT), product.initial_covariance(model)
    else:
        x, covariance = thesis.initial_state(chosen.code == THESIS_7)
    noise = product_noise(sensors, model.parameters)
    return FilterMemory(chosen, x, covariance, noise, np.zeros(product.WORK_SHAPE))


@inner
def filter_start(code, x, position, p1, p2, spool, command, par):
    """Take the first sample. The thesis filters start from their printed x0 (section 4.5)."""
    if code is None:
        start_product(x, position, p1, p2, spool, command, par)


@inlined
def filter_step(code, x, covariance, command, position, p1, p2, spool, par, noise, work, out):
    """Advance the filter `code` by one sample; see `product_step` for the arguments.

    The thesis filters do not use the spool.
    """
    if code is None:
        product_step(x, covariance, command, position, p1, p2, spool, par, noise, work, out)
    elif code == THESIS_6:
        thesis6_step(x, covariance, command, position, p1, p2, par, out)
    else:
        thesis7_step(x, covariance, command, position, p1, p2, par, out)


@njit(cache=True, error_model="numpy", nogil=True)
def _run(code, x, covariance, par, noise, work, command, measured, states, outputs):
    filter_start(
        code, x, measured[0, 0], measured[0, 1], measured[0, 2], measured[0, 3], command[0], par
    )
    outputs[0] = np.nan
    for i in range(x.size):
        states[0, i] = x[i]
    for k in range(1, command.size):
        filter_step(code, x, covariance, command[k - 1], measured[k, 0], measured[k, 1],
                    measured[k, 2], measured[k, 3], par, noise, work, outputs[k])  # fmt: skip
        for i in range(x.size):
            states[k, i] = x[i]


@dataclass(frozen=True)
class FilterRun:
    """A filter's estimates over a recording.

    Attributes:
        filter: which filter.
        time_s: float64 (n,).
        states: float64 (n, filter states), a posteriori, SI, columns as `filter.states`.
        outputs: float64 (n, 9), columns as `OUTPUTS`; the first row starts the filter and is NaN.
        covariance: final covariance.
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
        measured: float64 (n, 4): position (m), pressures 1 and 2 (Pa), spool (m); NaN is skipped.
        model: the model the filter assumes.
        name: a name in `FILTERS`.
        sensors: data sheet of the transducers.

    Raises:
        ValueError: no filter of that name, or arrays of different lengths.
    """
    if measured.shape != (time_s.size, 4) or command.shape != time_s.shape:
        raise ValueError(
            f"measured {measured.shape} and command {command.shape} do not fit {time_s.size} rows "
            "of (position, pressure 1, pressure 2, spool)"
        )
    memory = start_memory(name, model, sensors)
    states = np.empty((time_s.size, memory.x.size))
    outputs = np.empty((time_s.size, len(OUTPUTS)))
    _run(
        memory.filter.code,
        memory.x,
        memory.covariance,
        model.parameters,
        memory.noise,
        memory.work,
        np.ascontiguousarray(command),
        np.ascontiguousarray(measured),
        states,
        outputs,
    )
    return FilterRun(memory.filter, time_s, states, outputs, memory.covariance)
