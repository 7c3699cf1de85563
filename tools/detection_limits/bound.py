"""Computes the posterior Cramer-Rao bound on a leak's flow, along a known motion of the rig.

No estimator can have a smaller error than the bound (in the sense of van Trees 1968). It follows
from the information that samples give about states and constants, by the recursion of Tichavsky,
Muravchik and Nehorai 1998 (IEEE Transactions on Signal Processing 46). For a linearised model with
additive Gaussian noise, the inverse of this information is the covariance of the Kalman filter
along the true trajectory. The covariance form is used here; it also holds for states that have no
process noise.
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
"""Standard deviations (SI) of the first 7 states before any sample, wider than any rig's states."""
_WIDE: Final = 10.0 * LITRE_PER_MINUTE
"""Standard deviation of a leak's flow before any sample, m^3/s at its mean drop; any size fits."""
DAY_S: Final = 86400.0


def exact_noise(course: Course) -> ProductNoise:
    """Return the noise of sensors and load alone, for a model that is exact but for the load.

    The sensors' noise is that of their data sheet; the load follows the filter's random walk.
    """
    noise = product_noise(DATA_SHEET, course.parameters)
    return noise._replace(
        spool_velocity=0.0, chamber_pressure=0.0, velocity=0.0, leakage=0.0, null_bias=0.0
    )


def budgeted_noise(course: Course) -> ProductNoise:
    """Return the noise of sensors and load, and the filter's budget for errors of its model."""
    return product_noise(DATA_SHEET, course.parameters)._replace(leakage=0.0)


@dataclass(frozen=True)
class Bound:
    """The smallest possible standard error of a leak's flow, by the time since its onset.

    Attributes:
        windows_s: float64 (n,), times since the onset, s.
        flow: float64 (3, n), standard errors in m^3/s, for leaks of chamber 1, of chamber 2 and
            between them. For each, the other leaks are known to be absent.
    """

    windows_s: Array
    flow: Array

    def smallest(self, false_alarms_per_day: float, power: float) -> Array:
        """Return the smallest leak that any test can find at these rates, float64 (3, n), m^3/s.

        The most powerful test (Neyman and Pearson) for a known place and onset is made once in each
        window. Its threshold is such that a healthy rig exceeds it as often as stated.

        Args:
            false_alarms_per_day: rate of false alarms, if windows follow one another all day; it
                counts as one in two windows at most.
            power: probability that the leak is found.
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
    """Return the bound for a leak that begins at a known time, after a healthy run.

    Args:
        course: the motion; both chamber pressures must stay 1e5 Pa above return pressure.
        noise: noise of sensors and model.
        onset_s: time from the first sample to the onset, s.
        windows_s: times since the onset for which the bound is computed, ascending, s.
        weaknesses: names of the constants that are unknown within their tolerances; None means all
            of `known`.
        spool_sensor: whether the spool is measured.
        supply_sensor: whether the supply pressure is measured, by a transducer like the chambers';
            this matters only if the supply pressure is one of the unknown constants.

    Raises:
        ValueError: the course is too short, or a chamber pressure is too low for a linear model.
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
    # The information's diagonal gives each leak's error if the other leaks are known.
    coefficients = 1.0 / np.sqrt(np.diagonal(information, axis1=1, axis2=2)).T
    sizes = np.cumsum(roots, axis=1)[:, reports - onset] / (reports - onset + 1)
    return Bound(np.asarray(windows_s, dtype=np.float64), coefficients * sizes)


class _Constants(NamedTuple):
    """Arguments of `leak_covariances` that describe the unknown constants."""

    lower: tuple[Parameters, ...]
    upper: tuple[Parameters, ...]
    columns: NDArray[np.int64]
    flows: Array
    biases: NDArray[np.int64]
    covariance: Array


def _constants(course: Course, names: tuple[str, ...], sizes: Array) -> _Constants:
    """Return the unknown constants for the weaknesses with the given names.

    `sizes` are the mean roots (3,) of the pressure drops across the leaks, in Pa^0.5.
    """
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
    # Compiled code cannot index an empty tuple; if there are no columns, (par,) is not used.
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
    """Return the product model's states along a course, float64 (ticks, 11).

    The leaks and the null bias among them are 0.
    """
    par = course.parameters
    spool, rate, p1, p2, position, velocity = course.states.T[:6]
    states = np.zeros((course.command.size, STATE_COUNT))
    states[:, :6] = np.stack([spool, p1, p2, position, velocity, rate], axis=1)
    acceleration = np.diff(velocity, append=velocity[-1]) / TICK
    states[:, 6] = par.piston_area * (p1 - p2) - par.moving_mass * acceleration
    return states


def _leak_roots(pressures: Array) -> Array:
    """Return the square roots (3, n), in Pa^0.5, of the pressure drops across the three leaks.

    `pressures` (n, 2) are those of the chambers, in Pa above return pressure.
    """
    p1, p2 = pressures.T
    return np.sqrt(np.abs(np.stack([p1, p2, p1 - p2])))
