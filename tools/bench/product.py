"""Runs the product filter and its C reference over a record, for `tools.bench.filters`."""

import ctypes
import time
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.filters.divergence import RESETS, SUPPLY
from estimator.filters.product import WORK_SHAPE, product_step
from estimator.filters.product_model import STATE_COUNT
from estimator.filters.product_noise import ProductNoise, product_noise
from estimator.filters.ud import dense_covariance
from rig.jit import njit
from rig.plant import NOMINAL, Parameters
from rig.plant.sensors import DATA_SHEET

Array = NDArray[np.float64]

C_SOURCE: Final = Path(__file__).parent / "c" / "product_filter.c"

_PARAMETERS: Final = (
    "piston_area",
    "moving_mass",
    "stroke_min",
    "stroke_max",
    "line_volume_1",
    "line_volume_2",
    "bulk_modulus",
    "density",
    "supply_pressure",
    "return_pressure",
    "discharge_coefficient",
    "area_gradient",
    "valve_gain",
    "valve_natural_frequency",
    "valve_damping",
    "entrained_air",
)
_NOISES: Final = (
    "position",
    "pressure",
    "spool",
    "spool_velocity",
    "chamber_pressure",
    "velocity",
    "load",
    "leakage",
    "null_bias",
)
"""`struct constants` of the C reference has `_PARAMETERS`, then these, then the ranges."""

NOISE: Final = product_noise(DATA_SHEET, NOMINAL)


class ProductRecord(NamedTuple):
    """A simulated run over which the product filter is run.

    Attributes:
        command: (n,) V, before each sample.
        measured: (n, 5) position, p1, p2, spool and supply pressure, SI.
        start: the filter's states before the first sample.
    """

    command: Array
    measured: Array
    start: Array


@njit(cache=True, error_model="numpy")
def run_product(
    x: Array,
    factors: Array,
    command: Array,
    measured: Array,
    par: Parameters,
    noise: ProductNoise,
    work: Array,
    out: Array,
) -> None:
    """Run the product filter over a record of n samples.

    `command` is (n,), V, and `measured` (n, 5) as in `ProductRecord`. `x`, `factors` and `work` are
    updated in place; `out` (10,) receives the outputs of the last sample.
    """
    for k in range(command.size):
        z = measured[k]
        reading = (z[0], z[1], z[2], z[3], z[4])
        product_step(x, factors, command[k], reading, par, noise, work, out)


def c_constants() -> Array:
    """Return parameters, noise and ranges in the order of `struct constants` of the C reference."""
    parameters = [getattr(NOMINAL, name) for name in _PARAMETERS]
    return np.array([*parameters, *(getattr(NOISE, name) for name in _NOISES), *NOISE.ranges])


def start(record: ProductRecord) -> tuple[Array, Array, Array, Array]:
    """Return the filter's state, factors, work and output arrays before a record's first sample."""
    work = np.zeros(WORK_SHAPE)
    work[0, SUPPLY] = NOMINAL.supply_pressure
    return record.start.copy(), np.diag(np.array(NOISE.initial) ** 2), work, np.empty(10)


def run_ours(record: ProductRecord) -> tuple[Array, Array, Array]:
    """Run our filter over a record; return its state, factors and output after the last sample.

    Raises:
        RuntimeError: the filter was lost and started anew, which the C reference cannot do.
    """
    x, factors, work, out = start(record)
    run_product(x, factors, record.command, record.measured, NOMINAL, NOISE, work, out)
    if work[0, RESETS]:
        raise RuntimeError("the record loses the filter; the C reference stops there")
    return x, factors, out


def run_reference(library: ctypes.CDLL, record: ProductRecord) -> tuple[Array, Array, Array]:
    """Run the C reference over a record; return its state, factors and output at the end.

    Raises:
        RuntimeError: the filter was lost at a sample, where the C reference stops.
    """
    x, factors, _, out = start(record)
    arrays = (x, factors, record.command, record.measured, c_constants(), out)
    library.product_run.restype = ctypes.c_long
    taken = library.product_run(
        ctypes.c_long(record.command.size), *(ctypes.c_void_p(a.ctypes.data) for a in arrays)
    )
    if taken < record.command.size:
        raise RuntimeError(f"the C reference was lost at sample {taken}")
    return x, factors, out


def disagreement(library: ctypes.CDLL, record: ProductRecord) -> float:
    """Return the largest difference of x and P between ours and the C reference at the end.

    Differences are in standard deviations, or in products of two of them for P.
    """
    x, factors, _ = run_ours(record)
    other, other_factors, _ = run_reference(library, record)
    P = dense_covariance(factors)
    deviation = np.sqrt(np.diag(P))
    difference = np.abs(P - dense_covariance(other_factors)) / np.outer(deviation, deviation)
    return float(max(np.abs((x - other) / deviation).max(), difference.max()))


def contestants(
    record: ProductRecord, library: ctypes.CDLL | None
) -> dict[str, Callable[[], float]]:
    """Return, by implementation, a function that runs it once and returns its time, ns a sample."""
    found: dict[str, Callable[[], float]] = {
        "ours": lambda: _timed(lambda: run_ours(record), record)
    }
    if library is not None:
        found["C"] = lambda: _timed(lambda: run_reference(library, record), record)
    return found


def _timed(run: Callable[[], object], record: ProductRecord) -> float:
    begun = time.thread_time_ns()
    run()
    return (time.thread_time_ns() - begun) / record.command.size


def product_record(command: Array, measured: Array, truth: Array) -> ProductRecord:
    """Return a record for the product filter, with readings of spool and supply pressure added.

    Args:
        command: (n,) V, before each sample.
        measured: (n, 3) position, p1 and p2, SI, which the thesis's filters use.
        truth: (n + 1, 7) true states in the thesis's order, SI.
    """
    noise = np.random.default_rng(2).normal(size=(command.size, 2))
    spool = truth[1:, 0] + DATA_SHEET.spool_noise * noise[:, 0]
    supply = NOMINAL.supply_pressure + DATA_SHEET.supply_pressure_noise * noise[:, 1]
    x = np.zeros(STATE_COUNT)
    x[:7] = truth[0]
    return ProductRecord(command, np.column_stack([measured, spool, supply]), x)
