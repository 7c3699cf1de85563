"""The product's filter: load, three leak coefficients and spool null bias beside the rig's states.

An extended Kalman filter on `estimator.filters.product_model` in UD form (`estimator.filters.ud`).
The prediction moves the first six states only, and those after it are random walks with noise of
their own: it takes an orthogonalisation of six rows and five rank-one additions. Measurements are
independent, so that they correct one after the other.

What is measured:

- position, both pressures and, if there is one, the spool. Readings that are missing (NaN), beyond
  the transducer's range or saturated are skipped.
- The supply pressure is an input of the prediction, as the command is: a reading is taken for the
  supply from the tick before, and kept until the next. Its noise moves the flow of an edge by far
  less than the 0.1 L/min of the budget. Without a transducer it is the model's.
- Not the load cell. It sees the environment's part of the load alone; the other part, friction,
  is not known to better than some 1000 N nor white, whereas the pressures show the whole load to
  some 30 N in a sample. As a measurement of this state it would only bias it.

Estimates are kept within what the rig can be (`Ranges`), so that a prediction through seconds
without readings stays finite. `estimator.filters.divergence` tells when a filter is lost; then it
starts anew.
"""

from math import isfinite
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.plant import PATH_SIZE, inlined, inner

from .divergence import (
    PATIENCE,
    RESETS,
    SUPPLY,
    clear_window,
    count_reset,
    is_finite,
    is_lost,
    take_innovation,
)
from .fused import fma
from .product_model import DYNAMIC, STATE_COUNT, predict_product
from .product_noise import DRY
from .readings import acting_command, settled_supply, true_position, true_pressures
from .ud import add_noise, correct, forget, orthogonalise, variance_of

Array = NDArray[np.float64]

_NOISES: Final = 4
"""Dynamic states with process noise of their own: both pressures, velocity, spool velocity."""

_PATH_ROWS: Final = -(-PATH_SIZE // STATE_COUNT)
_SCRATCH_ROWS: Final = 2 + 2 * DYNAMIC
WORK_SHAPE: Final = (_SCRATCH_ROWS + _PATH_ROWS, STATE_COUNT)
"""Shape of the array `work` of `product_step`: what `estimator.filters.divergence` keeps, a vector,
the Jacobian, the rows to orthogonalise, and the command path's memory
(`estimator.filters.readings`)."""


@njit(cache=True, error_model="numpy")
def start_product(x, factors, command, reading, par, noise, work):
    """Set the state (11,) and its covariance's factors (11, 11) by a first sample.

    The arguments are those of `product_step`, but for the command: it is held from this sample on.
    For want of a spool reading the command's is taken; leaks and null bias start from what the
    model says of them. Without position or a pressure all states are NaN, and the next sample is
    the first.
    """
    work[0, SUPPLY] = par.supply_pressure
    work[0, RESETS] = work[0, PATIENCE] = 0.0
    clear_window(work[0])
    path = work[_SCRATCH_ROWS:].reshape(_PATH_ROWS * STATE_COUNT)
    path[:] = 0.0
    shown = _in_range(reading, par, noise.ranges)
    if _lacks_motion(shown):
        x[:] = np.nan
        return
    _start_from(x, factors, command, shown, par, noise)


@inlined
def _between(reading, lower, upper):
    """Return a reading, or NaN where the transducer is beyond its range or saturated."""
    return reading if lower < reading < upper else np.nan


@inlined
def _in_range(reading, par, ranges):
    """Return position, both pressures and spool as the readings show them.

    They follow `estimator.filters.readings`; of a reading out of its range comes NaN.
    """
    p1 = _between(reading[1], ranges.pressure_min, ranges.pressure_max)
    p2 = _between(reading[2], ranges.pressure_min, ranges.pressure_max)
    p1, p2 = true_pressures(p1, p2, par)
    position = true_position(reading[0], par)
    return (
        _between(position, ranges.position_min, ranges.position_max),
        p1,
        p2,
        _between(reading[3], -ranges.spool, ranges.spool),
    )


@inlined
def _lacks_motion(shown):
    """Return whether position or a pressure is missing (NaN)."""
    return np.isnan(shown[0] + shown[1] + shown[2])


@inner
def _start_from(x, factors, command, shown, par, noise):
    position, p1, p2, spool = shown
    x[:] = 0.0
    x[0] = par.valve_gain * command if np.isnan(spool) else spool
    x[1] = p1
    x[2] = p2
    x[3] = position
    x[6] = par.piston_area * (p1 - p2)
    x[7] = par.external_leakage_1
    x[8] = par.external_leakage_2
    x[9] = par.internal_leakage
    x[10] = par.spool_null_bias
    factors[:, :] = 0.0
    for i in range(STATE_COUNT):
        factors[i, i] = noise.initial[i] ** 2


@inlined
def _predict_factors(factors, jacobian, noise, rows, weights):
    """Replace the factors of P by those of Phi P Phi^T + Q.

    Zeros and identity of Phi are left out (`estimator.filters.product_model.DYNAMIC`). The lower
    right part of U is that of the random walks and stays.

    Args:
        factors: (11, 11), updated.
        jacobian: (6, 11), the rows of Phi that are not the identity's.
        noise: `ProductNoise`.
        rows: scratch (6, 10).
        weights: scratch (10,).
    """
    for j in range(STATE_COUNT):
        s1, s2, s3, s4 = jacobian[1, j], jacobian[2, j], jacobian[3, j], jacobian[4, j]
        for k in range(j):
            u = factors[j, k]
            s1 = fma(jacobian[1, k], u, s1)
            s2 = fma(jacobian[2, k], u, s2)
            s3 = fma(jacobian[3, k], u, s3)
            s4 = fma(jacobian[4, k], u, s4)
        a = factors[j, 0] if j > 0 else 1.0
        b = factors[j, 5] if j > 5 else (1.0 if j == 5 else 0.0)
        s0 = fma(jacobian[0, 5], b, jacobian[0, 0] * a)
        s5 = fma(jacobian[5, 5], b, jacobian[5, 0] * a)
        if j < DYNAMIC:
            weights[j] = factors[j, j]
            rows[0, j], rows[1, j], rows[2, j] = s0, s1, s2
            rows[3, j], rows[4, j], rows[5, j] = s3, s4, s5
        else:
            factors[j, 0], factors[j, 1], factors[j, 2] = s0, s1, s2
            factors[j, 3], factors[j, 4], factors[j, 5] = s3, s4, s5
    for i in range(DYNAMIC):
        for k in range(DYNAMIC, DYNAMIC + _NOISES):
            rows[i, k] = 0.0
    rows[1, 6] = rows[2, 7] = rows[4, 8] = rows[5, 9] = 1.0
    weights[6] = weights[7] = noise.chamber_pressure
    weights[8], weights[9] = noise.velocity, noise.spool_velocity
    orthogonalise(rows, weights, factors, DYNAMIC)


@inlined
def predict(x, factors, command, supply, par, noise, jacobian, rows, vector):
    """Advance state and factors by a tick; see `product_step` and `_predict_factors`."""
    predict_product(x, command, supply, par, jacobian)
    _predict_factors(factors, jacobian, noise, rows, vector)
    add_noise(factors, 6, noise.load, vector)
    add_noise(factors, 7, noise.leakage, vector)
    add_noise(factors, 8, noise.leakage, vector)
    add_noise(factors, 9, noise.leakage, vector)
    add_noise(factors, 10, noise.null_bias, vector)


@inlined
def _kept(value, bound):
    return min(max(value, -bound), bound)


@inlined
def confine(x, ranges):
    """Keep the states within what the rig can be; pressures below zero stand for a cavity."""
    x[0] = _kept(x[0], ranges.opening)
    for i in (1, 2):
        x[i] = _kept(x[i], 2.0 * ranges.pressure_max)
    x[3] = min(max(x[3], ranges.position_min), ranges.position_max)
    x[4] = _kept(x[4], 2.0 * ranges.velocity)
    x[6] = _kept(x[6], 4.0 * ranges.load)
    for i in (7, 8, 9):
        x[i] = _kept(x[i], ranges.leakage)
    x[10] = _kept(x[10], ranges.opening)


@inlined
def _is_possible(x, ranges):
    """Return whether leaks and null bias are what a rig can have."""
    return min(x[7], x[8], x[9]) > -ranges.negative_leakage and abs(x[10]) < ranges.null_bias


@inner
def _reset(x, factors, command, shown, par, noise, work):
    """Start anew from a sample; for what it lacks, from the old estimate or the middle."""
    position, p1, p2, spool = shown
    ranges = noise.ranges
    if np.isnan(position):
        middle = 0.5 * (ranges.position_min + ranges.position_max)
        position = x[3] if isfinite(x[3]) else middle
    if np.isnan(p1):
        p1 = x[1] if isfinite(x[1]) else 0.5 * par.supply_pressure
    if np.isnan(p2):
        p2 = x[2] if isfinite(x[2]) else 0.5 * par.supply_pressure
    _start_from(x, factors, command, (position, p1, p2, spool), par, noise)
    count_reset(work[0])


@njit(cache=True, error_model="numpy", forceinline=False)
def product_step(x, factors, command, reading, par, noise, work, out):
    """Advance the product filter by one sample.

    Args:
        x: state (11,), updated in place.
        factors: of its covariance (11, 11), as in `estimator.filters.ud`, updated in place.
        command: command in V held since the last sample; NaN leaves the spool where it is.
        reading: measured position (m), pressures of chambers 1 and 2 (Pa), spool (m) and supply
            pressure (Pa, the last one holds); what is NaN or out of range is skipped.
        par: `Parameters` the filter assumes.
        noise: `ProductNoise`.
        work: float64 of `WORK_SHAPE`: its first row is the filter's memory of its own health
            (`estimator.filters.divergence`), the rest scratch.
        out: float64 (10,): innovations, a posteriori residuals and innovation variances of
            position, pressure 1 and pressure 2; resets so far.
    """
    ranges = noise.ranges
    watch, vector = work[0], work[1]
    jacobian, rows = work[2 : 2 + DYNAMIC], work[2 + DYNAMIC : 2 + 2 * DYNAMIC, :10]
    shown = _in_range(reading, par, ranges)
    position, p1, p2, spool = shown
    if ranges.pressure_min < reading[4] < ranges.pressure_max:
        watch[SUPPLY] = reading[4]
    if np.isnan(x[3]):
        if not _lacks_motion(shown):
            _start_from(x, factors, command, shown, par, noise)
        out[:] = np.nan
        return
    if not isfinite(command):
        command = x[0] / par.valve_gain
    if (par.command_delay != 0.0) | (par.valve_hysteresis != 0.0):
        path = work[_SCRATCH_ROWS:].reshape(_PATH_ROWS * STATE_COUNT)
        command = acting_command(path, command, par)
    fed = watch[SUPPLY]
    if (par.supply_droop != 0.0) & (fed == par.supply_pressure):
        # Never measured: what the model says that its line leaves of it.
        fed = settled_supply(x[0] + x[10], x[1], x[2], par)
    predict(x, factors, command, fed, par, noise, jacobian, rows, vector)
    out[0] = position - x[3]
    out[1] = p1 - x[1]
    out[2] = p2 - x[2]
    out[6] = variance_of(factors, 3) + noise.position
    out[7] = variance_of(factors, 1) + noise.pressure
    out[8] = variance_of(factors, 2) + noise.pressure
    if not np.isnan(spool):
        take_innovation(watch, correct(x, factors, 0, spool, noise.spool, vector))
    if not np.isnan(position):
        take_innovation(watch, correct(x, factors, 3, position, noise.position, vector))
    for index, pressure in ((1, p1), (2, p2)):
        if pressure < DRY:
            # The oil's compression is not what the model says: nothing is learnt from it.
            x[index] = pressure
            forget(factors, index, noise.pressure, vector)
        elif not np.isnan(pressure):
            square = correct(x, factors, index, pressure, noise.pressure, vector)
            take_innovation(watch, square)
    if not is_finite(x, factors) or is_lost(watch, _is_possible(x, ranges)):
        _reset(x, factors, command, shown, par, noise, work)
    confine(x, ranges)
    out[3] = position - x[3]
    out[4] = p1 - x[1]
    out[5] = p2 - x[2]
    out[9] = watch[RESETS]
