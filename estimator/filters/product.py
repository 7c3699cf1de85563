"""The product filter, whose states include the load, three leak coefficients and the null bias.

It is an extended Kalman filter with the model of `estimator.filters.product_model`, in UD form
(`estimator.filters.ud`). The prediction changes the first six states only. The other five are
random walks, each with noise of its own. A prediction therefore takes an orthogonalisation of six
rows and five rank-one additions. The noises of the measurements are independent, so that the
measurements correct the state one after the other.

The filter uses the readings as follows:

- Position, both pressures and, if there is one, the spool are measurements. Readings that are
  missing (NaN), beyond the transducer's range or saturated are skipped.
- The supply pressure is an input of the prediction, as the command is. A reading counts for the
  tick that ends with it, and holds until the next reading. Its noise changes the flow of an edge by
  far less than the 0.1 L/min of the noise budget. Without a transducer, the model's value is used.
- The load cell is not used. It measures the environment's part of the load alone. The other part,
  friction, is known to some 1000 N only and is not white, whereas the pressures show the whole load
  to some 30 N in a sample. As a measurement, the load cell would only bias the load.

Estimates are limited to what the rig can be (`Ranges`), so that a prediction through seconds
without readings stays finite. `estimator.filters.divergence` detects when the filter is lost; the
filter then starts anew.
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
from .ud import add_noises, correct, forget, orthogonalise, variance_of

Array = NDArray[np.float64]

_NOISES: Final = 4
"""Number of predicted states with process noise: both pressures, velocity, spool velocity."""

_PATH_ROWS: Final = -(-PATH_SIZE // STATE_COUNT)
_SCRATCH_ROWS: Final = 2 + 2 * DYNAMIC
WORK_SHAPE: Final = (_SCRATCH_ROWS + _PATH_ROWS, STATE_COUNT)
"""Shape of the array `work` of `product_step`.

Its rows hold, in this order: the array `watch` of `estimator.filters.divergence`, a scratch vector,
the Jacobian, the rows to orthogonalise, and the memory of the command path
(`estimator.filters.readings`)."""


@njit(cache=True, error_model="numpy")
def start_product(x, factors, command, reading, par, noise, work):
    """Start the filter from a first sample: set state, factors and `work`, in place.

    Position, pressures and spool start from the readings and the load from the pressures;
    velocities start at 0, leaks and null bias from the model. Without a spool reading, the spool
    starts where `command` (V), which is held from this sample on, puts it. If position or a
    pressure is missing (NaN or out of range), all states are set to NaN, and `product_step`
    starts the filter from the next complete sample. `work` is set up in either case. The other
    arguments are as in `product_step`.
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
    """Return the reading if it lies strictly between the bounds, else NaN."""
    return reading if lower < reading < upper else np.nan


@inlined
def _in_range(reading, par, ranges):
    """Return true position (m), pressures 1 and 2 (Pa), and spool (m) that a sample shows.

    Gains and biases are undone (`estimator.filters.readings`). NaN stands for a pressure whose
    reading is out of its range, and for a position or a spool that is itself out of its range.
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
    """Return whether position or a pressure is missing (NaN) in a sample from `_in_range`."""
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
    """Replace the factors of P, in place, by those of Phi P Phi^T + Q.

    Q here has the noise of the first six states only. Products with zeros and ones of Phi are left
    out (`estimator.filters.product_model.DYNAMIC`). The lower right part of U belongs to the random
    walks and does not change.

    Args:
        factors: (11, 11), updated.
        jacobian: the first six rows of Phi, (6, 11); the others are those of the identity.
        noise: `ProductNoise`.
        rows: scratch (6, 10).
        weights: scratch (10,) or longer.
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
    """Predict the state x (11,) and its factors (11, 11) one tick ahead, in place.

    Args:
        x: state, updated.
        factors: factors of its covariance, updated.
        command: command in V that acts on the spool during the tick.
        supply: supply pressure, Pa.
        par: `Parameters` that the filter assumes.
        noise: `ProductNoise` that the filter assumes.
        jacobian: (6, 11), overwritten with the first six rows of the Jacobian.
        rows: scratch (6, 10).
        vector: scratch (11,).
    """
    predict_product(x, command, supply, par, jacobian)
    _predict_factors(factors, jacobian, noise, rows, vector)
    walks = noise.load, noise.leakage, noise.leakage, noise.leakage, noise.null_bias
    add_noises(factors, walks, rows)


@inlined
def _kept(value, bound):
    return min(max(value, -bound), bound)


@inlined
def confine(x, ranges):
    """Limit the states x (11,), in place, to the bounds in `ranges`, some of them times 2 or 4.

    Pressures may be negative, as a pressure below zero stands for a cavity. The spool velocity is
    not limited.
    """
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
    """Return whether the estimated leaks and null bias are in a range that a rig can have."""
    return min(x[7], x[8], x[9]) > -ranges.negative_leakage and abs(x[10]) < ranges.null_bias


@inner
def _reset(x, factors, command, shown, par, noise, work):
    """Start the filter anew from a sample of `_in_range`, in place; count the reset in `work`.

    A missing position or pressure is replaced by the old estimate; if that is not finite, by the
    middle of the range or half the supply pressure.
    """
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
    """Advance the product filter by one sample: predict, correct by the readings, limit the states.

    A state of NaN means that the filter has not started. The first sample with position and both
    pressures then only starts it; a sample before that changes no state. If the filter is lost
    after the correction (`estimator.filters.divergence`), it starts anew from this sample.

    Args:
        x: state (11,) in the order of `product_model.STATES`, updated in place.
        factors: factors of the covariance (11, 11), as in `estimator.filters.ud`, updated in place.
        command: command in V held since the last sample. If it is NaN or infinite, the filter takes
            the command that would keep the spool where it is estimated to be.
        reading: measured position (m), pressures of chambers 1 and 2 (Pa), spool (m) and supply
            pressure (Pa). A value that is NaN or out of range is skipped; for the supply pressure,
            the last value then still holds. A pressure below `DRY` sets its state to the reading
            and corrects no other.
        par: `Parameters` that the filter assumes.
        noise: `ProductNoise` that the filter assumes.
        work: float64 of `WORK_SHAPE`, updated: the memory `watch` of
            `estimator.filters.divergence`, scratch, and the memory of the command path.
        out: float64 (10,), overwritten. 0 to 2 are the innovations, 3 to 5 the residuals after the
            correction and 6 to 8 the innovation variances, each of position, pressure 1 and
            pressure 2; 9 is the number of resets so far. A skipped reading has a variance, but NaN
            as innovation and residual. All ten are NaN up to the sample that starts the filter, and
            for that sample too.
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
        # The supply pressure was never measured: take the model's pressure behind its line.
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
            # The model's compression does not hold in a dry chamber: the pressure is set to the
            # reading, and the other states are not corrected by it.
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
