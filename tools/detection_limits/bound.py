"""The posterior Cramer-Rao bound on a leak's flow, along a known motion of the rig.

The information that samples carry about states and constants follows the recursion of Tichavsky,
Muravchik and Nehorai 1998 (IEEE Transactions on Signal Processing 46), which bounds the error of
any estimator in the sense of van Trees 1968. For a linearised model with additive Gaussian noise
its inverse is the Kalman filter's covariance along the true trajectory, and in that form it also
holds where states have no noise of their own.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.filters.product_model import STATE_COUNT
from estimator.filters.product_noise import ProductNoise, product_noise
from rig.plant import Parameters
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.plant.sensors import DATA_SHEET

from .courses import Course
from .recursion import STEP, leak_covariances
from .weaknesses import (
    NULL_BIAS,
    OF_PARAMETERS,
    OF_TRANSDUCERS,
    SUPPLY,
    TOLERANCE,
    inflows,
    known,
    shifted,
)

Array = NDArray[np.float64]

_LEAKS: Final = (7, 8, 9)
_NULL: Final = 10
_LOOSE: Final = np.array([1e-4, 1e6, 1e6, 1e-2, 1.0, 0.1, 1e4])
"""Standard deviations of the first states before any sample: wider than the rig."""
_WIDE: Final = 10.0 * LITRE_PER_MINUTE
"""Leak, m^3/s at its mean drop, that is believed possible beforehand: as good as any."""
DAY_S: Final = 86400.0


def exact_noise(course: Course) -> ProductNoise:
    """Return the noise of a rig that the model describes exactly, but for its load.

    What the sensors' data sheets say, and the filter's random walk of the load.
    """
    noise = product_noise(DATA_SHEET, course.parameters)
    return noise._replace(
        spool_velocity=0.0, chamber_pressure=0.0, velocity=0.0, leakage=0.0, null_bias=0.0
    )


def budgeted_noise(course: Course) -> ProductNoise:
    """Return the same with the filter's stated budget for what its model is wrong by."""
    return product_noise(DATA_SHEET, course.parameters)._replace(leakage=0.0)


@dataclass(frozen=True)
class Bound:
    """The least standard error of a leak's flow, by window.

    Attributes:
        windows_s: float64 (n,), time from the leak's onset.
        flow: float64 (3, n), m^3/s: leaks of chamber 1, of chamber 2 and between them, each where
            the others are known not to be there.
    """

    windows_s: Array
    flow: Array

    def smallest(self, false_alarms_per_day: float, power: float) -> Array:
        """Return the smallest leak that any test can find at these rates, float64 (3, n), m^3/s.

        The most powerful test (Neyman and Pearson) of the leak's place and onset, one a window:
        its threshold lies where the stated number of a day's windows exceed it.
        """
        normal = NormalDist()
        alarms = np.minimum(false_alarms_per_day * self.windows_s / DAY_S, 0.5)
        sigmas = np.array([normal.inv_cdf(1.0 - p) for p in alarms]) + normal.inv_cdf(power)
        return np.asarray(sigmas * self.flow)


def flow_bound(
    course: Course,
    noise: ProductNoise,
    onset_s: float,
    windows_s: Sequence[float],
    *,
    weaknesses: Collection[str] | None = None,
    spool_sensor: bool = True,
    supply_sensor: bool = True,
) -> Bound:
    """Return the bound for a leak that begins at a known time after healthy running.

    Args:
        course: the motion; its chambers must hold pressure throughout.
        noise: of sensors and model.
        onset_s: time of the onset since the first sample.
        windows_s: ascending.
        weaknesses: constants that are unknown within their tolerances; by default all there are.
        spool_sensor: whether the spool is measured.
        supply_sensor: whether the supply pressure is, by a transducer like the chambers'.

    Raises:
        ValueError: the course is too short, or a chamber runs dry, where the model is not linear.
    """
    onset = round(onset_s / TICK)
    reports = onset + np.round(np.asarray(windows_s) / TICK).astype(np.int64)
    if reports[-1] >= course.command.size:
        raise ValueError(f"course of {course.command.size} ticks ends before tick {reports[-1]}")
    pressures = course.states[: reports[-1] + 1, 2:4] - course.parameters.return_pressure
    if pressures.min() < 1e5:
        raise ValueError(f"{course.name}: a chamber is as low as {pressures.min():.0f} Pa")
    names = known(course) if weaknesses is None else tuple(weaknesses)
    blocks = np.empty((reports.size, 3, 3))
    roots = _leak_roots(pressures[onset:])
    unknown = _constants(course, names, roots.mean(axis=1))
    supply = -1, 0.0
    if supply_sensor and SUPPLY in names:
        constant = [name for name in names if name in OF_PARAMETERS].index(SUPPLY)
        supply = STATE_COUNT + constant, noise.pressure / TOLERANCE[SUPPLY] ** 2
    leak_covariances(
        _product_states(course), course.command, course.parameters, unknown.lower, unknown.upper,
        unknown.columns, unknown.flows, unknown.biases, supply, unknown.covariance, noise,
        spool_sensor, onset, reports, blocks,
    )  # fmt: skip
    information = np.linalg.inv(blocks)
    # The inverse's diagonal: each leak beside the others known, whatever was believed of these.
    coefficients = 1.0 / np.sqrt(np.diagonal(information, axis1=1, axis2=2)).T
    sizes = np.cumsum(roots, axis=1)[:, reports - onset] / (reports - onset + 1)
    return Bound(np.asarray(windows_s, dtype=np.float64), coefficients * sizes)


class _Constants(NamedTuple):
    """What is constant and unknown, as `leak_covariances` takes it."""

    lower: tuple[Parameters, ...]
    upper: tuple[Parameters, ...]
    columns: NDArray[np.int64]
    flows: Array
    biases: NDArray[np.int64]
    covariance: Array


def _constants(course: Course, names: tuple[str, ...], sizes: Array) -> _Constants:
    """Return the weaknesses of some names; `sizes` are the leaks' mean roots (3,) in Pa^0.5."""
    par = course.parameters
    of_parameters = [name for name in names if name in OF_PARAMETERS]
    of_transducers = [name for name in names if name in OF_TRANSDUCERS]
    entering = inflows(course)
    of_flows = [name for name in names if name in entering]
    first = STATE_COUNT + len(of_parameters)
    covariance = np.eye(first + len(of_transducers) + len(of_flows))
    covariance[range(7), range(7)] = _LOOSE**2
    covariance[_LEAKS, _LEAKS] = (_WIDE / sizes) ** 2
    covariance[_NULL, _NULL] = TOLERANCE[NULL_BIAS] ** 2 if NULL_BIAS in names else 0.0
    biases = np.full(4, -1)
    for i, name in enumerate(of_transducers):
        biases[1 + OF_TRANSDUCERS[name]] = first + i
        covariance[first + i, first + i] = TOLERANCE[name] ** 2
    none = np.empty((course.command.size - 1, 0, 2))
    flows = np.stack([TOLERANCE[n] * entering[n] for n in of_flows], axis=1) if of_flows else none
    # Compiled code cannot index an empty tuple; without columns these are not used.
    lower = tuple(shifted(par, name, -STEP) for name in of_parameters) or (par,)
    upper = tuple(shifted(par, name, STEP) for name in of_parameters) or (par,)
    return _Constants(
        lower,
        upper,
        np.arange(STATE_COUNT, first),
        flows,
        biases,
        covariance,
    )


def _product_states(course: Course) -> Array:
    """Return the product model's states along a course, float64 (ticks, 11); no leak, no bias."""
    par = course.parameters
    spool, rate, p1, p2, position, velocity = course.states.T[:6]
    states = np.zeros((course.command.size, STATE_COUNT))
    states[:, :6] = np.stack([spool, p1, p2, position, velocity, rate], axis=1)
    acceleration = np.diff(velocity, append=velocity[-1]) / TICK
    states[:, 6] = par.piston_area * (p1 - p2) - par.moving_mass * acceleration
    return states


def _leak_roots(pressures: Array) -> Array:
    """Return the roots (3, n) in Pa^0.5 of the drops across the leaks; pressures above return's."""
    p1, p2 = pressures.T
    return np.sqrt(np.abs(np.stack([p1, p2, p1 - p2])))
