"""The product's filter: load, three leak coefficients and spool null bias beside the rig's states.

An extended Kalman filter on `estimator.product_model`. Measurements are independent, so that they
correct one after the other; of the symmetric covariance only the upper triangle is computed.
"""

from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rig.plant import Model, Parameters
from rig.plant.compiled import inlined, inner
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.plant.sensors import SensorParameters

from .fused import fma
from .product_model import DYNAMIC, STATE_COUNT, predict_product

Array = NDArray[np.float64]

DRY: Final = 1e5
"""Below this pressure (Pa) a chamber may hold a vapour cavity, whose volume no sensor sees: three
times the noise of a 20.7 MPa transducer."""

WORK_SHAPE: Final = (2 * DYNAMIC + 1, STATE_COUNT)
"""Shape of the scratch array of `product_step`: Jacobian, its product with P, one gain."""


class ProductNoise(NamedTuple):
    """Noise the product filter assumes: variances of the sensors and a stated model-error budget.

    Sensor variances follow the data sheets; process variances are per millisecond.
    """

    position: float
    pressure: float
    spool: float
    spool_velocity: float
    chamber_pressure: float
    velocity: float
    load: float
    leakage: float
    null_bias: float


def product_noise(sensors: SensorParameters, parameters: Parameters) -> ProductNoise:
    """Return the filter's noise variances for given sensors.

    The encoder's error is uniform over one count. The budget: the valve model is off by 2 um (white
    over its bandwidth), a chamber's flow by 0.1 L/min, the load moves by 150 N/ms (it carries the
    friction, which turns around within some 20 ms), a leak by 0.1 L/min at half supply pressure in
    a second, the spool's null by 0.02 um in a second.
    """
    half_supply = 0.5 * parameters.supply_pressure
    spool_acceleration = 2e-6 * parameters.valve_natural_frequency**2
    middle = 0.5 * (parameters.stroke_max - parameters.stroke_min)
    volume = parameters.line_volume_1 + parameters.piston_area * middle
    flow = 0.1 * LITRE_PER_MINUTE
    return ProductNoise(
        position=sensors.position_resolution**2 / 12.0,
        pressure=sensors.pressure_noise**2,
        spool=sensors.spool_noise**2,
        spool_velocity=(spool_acceleration * TICK) ** 2,
        chamber_pressure=(parameters.bulk_modulus / volume * flow * TICK) ** 2,
        velocity=1e-8,
        load=150.0**2,
        leakage=(flow / sqrt(half_supply)) ** 2 * TICK,
        null_bias=(2e-8) ** 2 * TICK,
    )


def initial_covariance(model: Model) -> Array:
    """Return P0 (11, 11): first samples to their noise, null to 5 um, leaks to 0.02 L/min.

    A leak and a shifted null look alike at first; what is there from the start is taken for the
    null.
    """
    leak = 0.02 * LITRE_PER_MINUTE / sqrt(0.5 * model.parameters.supply_pressure)
    sigma = np.array([2e-6, 5e4, 5e4, 2e-5, 0.05, 1e-2, 500.0, leak, leak, leak, 5e-6])
    return np.diag(sigma**2)


@njit(cache=True, error_model="numpy")
def start_product(x, position, p1, p2, spool, command, par):
    """Set the state (11,) to a first sample; for want of a spool reading, take the command's.

    Leaks and null bias start from what the model says of them. Without position or a pressure all
    states are NaN, and the next sample is the first.
    """
    if np.isnan(position + p1 + p2):
        x[:] = np.nan
        return
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


@inlined
def _spool_rows(jacobian, a, b):
    """Return the products of the Jacobian's rows of spool and spool velocity with a column.

    `a` and `b` are the column's entries of these two states; the rows have no others.
    """
    return (
        fma(jacobian[0, 5], b, jacobian[0, 0] * a),
        fma(jacobian[5, 5], b, jacobian[5, 0] * a),
    )


@inlined
def _full_rows(jacobian, matrix, i):
    """Return the products of the Jacobian's rows 1 to 4 with row `i` of a matrix of 11 columns."""
    s1 = s2 = s3 = s4 = 0.0
    for k in range(STATE_COUNT):
        c = matrix[i, k]
        s1 = fma(jacobian[1, k], c, s1)
        s2 = fma(jacobian[2, k], c, s2)
        s3 = fma(jacobian[3, k], c, s3)
        s4 = fma(jacobian[4, k], c, s4)
    return s1, s2, s3, s4


@njit(cache=True, error_model="numpy", forceinline=True)
def _predict_covariance(covariance, jacobian, product):
    """Replace the upper triangle of a symmetric P by Phi P Phi^T.

    Zeros and identity of Phi are left out (`estimator.product_model.DYNAMIC`).
    """
    for j in range(STATE_COUNT):
        # P is symmetric: its rows are its columns.
        p0, p5 = covariance[j, 0], covariance[j, 5]
        product[0, j], product[5, j] = _spool_rows(jacobian, p0, p5)
        s1, s2, s3, s4 = _full_rows(jacobian, covariance, j)
        product[1, j] = s1
        product[2, j] = s2
        product[3, j] = s3
        product[4, j] = s4
    for i in range(DYNAMIC):
        s0, s5 = _spool_rows(jacobian, product[i, 0], product[i, 5])
        s1, s2, s3, s4 = _full_rows(jacobian, product, i)
        covariance[i, 0] = s0
        covariance[i, 1] = s1
        covariance[i, 2] = s2
        covariance[i, 3] = s3
        covariance[i, 4] = s4
        covariance[i, 5] = s5
        for j in range(DYNAMIC, STATE_COUNT):
            covariance[i, j] = product[i, j]


@njit(cache=True, error_model="numpy", forceinline=True)
def _correct(x, covariance, index, measured, variance, gain):
    """Apply one scalar measurement of a state: P - K S K^T with K = P h / S, P's upper triangle."""
    inverse = 1.0 / (covariance[index, index] + variance)
    weight = (measured - x[index]) * inverse
    for i in range(STATE_COUNT):
        gain[i] = covariance[min(i, index), max(i, index)]
        x[i] = fma(gain[i], weight, x[i])
    for i in range(STATE_COUNT):
        share = -gain[i] * inverse
        for j in range(i, STATE_COUNT):
            covariance[i, j] = fma(share, gain[j], covariance[i, j])


@njit(cache=True, error_model="numpy", forceinline=True)
def _mirror(covariance):
    """Copy the upper triangle of a square matrix to the lower one."""
    for i in range(covariance.shape[0]):
        for j in range(i):
            covariance[i, j] = covariance[j, i]


@inner
def _start_afresh(x, covariance, index, measured, variance):
    """Take a state as measured and forget what its error had to do with the others'.

    In a dry chamber the oil's compression is not what the model says: nothing is learnt from it.
    """
    x[index] = measured
    covariance[index, :] = 0.0
    covariance[:, index] = 0.0
    covariance[index, index] = variance


@njit(cache=True, error_model="numpy")
def product_step(x, covariance, command, position, p1, p2, spool, par, noise, work, out):
    """Advance the product filter by one sample.

    Args:
        x: state (11,), updated in place.
        covariance: its covariance (11, 11), updated in place.
        command: command in V held since the last sample.
        position: measured, m; NaN is skipped.
        p1: measured pressure of chamber 1, Pa; NaN is skipped.
        p2: measured pressure of chamber 2, Pa; NaN is skipped.
        spool: measured spool displacement, m; NaN is skipped.
        par: `Parameters` the filter assumes.
        noise: `ProductNoise`.
        work: scratch, float64 of `WORK_SHAPE`.
        out: float64 (9,): innovations, a posteriori residuals and innovation variances of position,
            pressure 1 and pressure 2.
    """
    jacobian, product, gain = work[:DYNAMIC], work[DYNAMIC : 2 * DYNAMIC], work[2 * DYNAMIC]
    if np.isnan(x[3]):
        start_product(x, position, p1, p2, spool, command, par)
        out[:] = np.nan
        return
    predict_product(x, command, par, jacobian)
    _predict_covariance(covariance, jacobian, product)
    covariance[1, 1] += noise.chamber_pressure
    covariance[2, 2] += noise.chamber_pressure
    covariance[4, 4] += noise.velocity
    covariance[5, 5] += noise.spool_velocity
    covariance[6, 6] += noise.load
    covariance[7, 7] += noise.leakage
    covariance[8, 8] += noise.leakage
    covariance[9, 9] += noise.leakage
    covariance[10, 10] += noise.null_bias

    out[0] = position - x[3]
    out[1] = p1 - x[1]
    out[2] = p2 - x[2]
    out[6] = covariance[3, 3] + noise.position
    out[7] = covariance[1, 1] + noise.pressure
    out[8] = covariance[2, 2] + noise.pressure
    if not np.isnan(spool):
        _correct(x, covariance, 0, spool, noise.spool, gain)
    if not np.isnan(position):
        _correct(x, covariance, 3, position, noise.position, gain)
    for index, pressure in ((1, p1), (2, p2)):
        if pressure < DRY:
            _start_afresh(x, covariance, index, pressure, noise.pressure)
        elif not np.isnan(pressure):
            _correct(x, covariance, index, pressure, noise.pressure, gain)
    _mirror(covariance)
    out[3] = position - x[3]
    out[4] = p1 - x[1]
    out[5] = p2 - x[2]
