"""The product's filter: load, three leak coefficients and spool null bias beside the rig's states.

An extended Kalman filter that predicts with a stable scheme. Friction and environment are one load
state (section 6.3), so that no friction law is assumed. Where the thesis filter takes one forward
Euler step a millisecond, which the oil column does not survive (docs/model.md), this one takes four
semi-implicit ones: velocity first, then position and pressures with the new velocity. That keeps
the oil column's oscillation bounded up to omega h = 2; here omega h is at most 0.24.
"""

from math import cos, exp, sin, sqrt
from typing import Final, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from rig.plant import Model, Parameters
from rig.plant.dynamics import chamber_volumes, valve_conductance
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.plant.sensors import SensorParameters

Array = NDArray[np.float64]

STATES: Final = (
    "spool_m",
    "pressure_1_Pa",
    "pressure_2_Pa",
    "position_m",
    "velocity_m_per_s",
    "spool_velocity_m_per_s",
    "load_N",
    "external_leakage_1_m3_per_s_sqrtPa",
    "external_leakage_2_m3_per_s_sqrtPa",
    "internal_leakage_m3_per_s_sqrtPa",
    "null_bias_m",
)
STATE_COUNT: Final = len(STATES)

DRY: Final = 1e5
"""Below this pressure (Pa) a chamber may hold a vapour cavity, whose volume no sensor sees: three
times the noise of a 20.7 MPa transducer."""

_SUBSTEPS: Final = 4
# Rows of the transition matrix that are not the identity: the six rig states come first.
_DYNAMIC: Final = 6


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
    """Set the state (11,) to a first sample; for want of a spool reading, take the command's."""
    x[:] = 0.0
    x[0] = par.valve_gain * command if np.isnan(spool) else spool
    x[1] = p1
    x[2] = p2
    x[3] = position
    x[6] = par.piston_area * (p1 - p2)


@njit(cache=True, error_model="numpy")
def _smooth_root(drop):
    """Return a root of the drop (Pa^0.5) that stays smooth at zero, and its slope; 10 kPa wide."""
    width = 1e4
    size = sqrt(drop * drop + width * width)
    root = drop / sqrt(size)
    slope = (1.0 - 0.5 * drop * drop / (size * size)) / sqrt(size)
    return root, slope


@njit(cache=True, error_model="numpy")
def predict_product(x, command, par, jacobian):
    """Advance the state (11,) by one tick of constant command and fill the Jacobian's rows (6, 11).

    The spool follows eq. 2.5 exactly. Row order is that of `STATES`; rows 7 to 11 are the identity.
    """
    h = TICK / _SUBSTEPS
    wn = par.valve_natural_frequency
    decay = exp(-par.valve_damping * wn * h)
    # Exact step of the second-order valve about its steady state (damping below one).
    wd = wn * sqrt(1.0 - par.valve_damping * par.valve_damping)
    c, s = cos(wd * h), sin(wd * h)
    ratio = par.valve_damping * wn / wd
    m11 = decay * (c + ratio * s)
    m12 = decay * s / wd
    m21 = -decay * s * wn * wn / wd
    m22 = decay * (c - ratio * s)
    steady = par.valve_gain * command
    area, mass = par.piston_area, par.moving_mass
    supply, back = par.supply_pressure, par.return_pressure
    conductance = valve_conductance(par)
    load, k1, k2, k12, bias = x[6], x[7], x[8], x[9], x[10]
    spool, p1, p2, position, velocity, spool_velocity = x[0], x[1], x[2], x[3], x[4], x[5]

    jacobian[:, :] = 0.0
    for i in range(_DYNAMIC):
        jacobian[i, i] = 1.0
    for _ in range(_SUBSTEPS):
        before = spool
        deviation = spool - steady
        spool = steady + m11 * deviation + m12 * spool_velocity
        spool_velocity = m21 * deviation + m22 * spool_velocity
        opening = 0.5 * (before + spool) + bias

        gain = h / mass
        velocity += gain * (area * (p1 - p2) - load)
        position += h * velocity
        v1, v2 = chamber_volumes(position, par)
        c1 = h * par.bulk_modulus / v1
        c2 = h * par.bulk_modulus / v2
        if opening >= 0.0:
            r1, s1 = _smooth_root(supply - p1)
            r2, s2 = _smooth_root(p2 - back)
            s1 = -s1
        else:
            r1, s1 = _smooth_root(p1 - back)
            r2, s2 = _smooth_root(supply - p2)
            s2 = -s2
        e1, es1 = _smooth_root(p1 - back)
        e2, es2 = _smooth_root(p2 - back)
        e12, es12 = _smooth_root(p1 - p2)
        flow = conductance * opening
        d1 = c1 * (flow * r1 - area * velocity - k1 * e1 - k12 * e12)
        d2 = c2 * (area * velocity - flow * r2 - k2 * e2 + k12 * e12)
        a11 = 1.0 + c1 * (flow * s1 - k1 * es1 - k12 * es12)
        a12 = c1 * k12 * es12
        a22 = 1.0 - c2 * (flow * s2 + k2 * es2 + k12 * es12)
        a21 = c2 * k12 * es12
        x1 = -d1 * area / v1
        x2 = d2 * area / v2
        for j in range(STATE_COUNT):
            js0 = jacobian[0, j]
            jw0 = jacobian[5, j]
            jacobian[0, j] = m11 * js0 + m12 * jw0
            jacobian[5, j] = m21 * js0 + m22 * jw0
            opened = 0.5 * (js0 + jacobian[0, j])
            jp1, jp2 = jacobian[1, j], jacobian[2, j]
            jv = jacobian[4, j] + gain * area * (jp1 - jp2)
            if j == 6:
                jv -= gain
            elif j == 10:
                opened += 1.0
            jx = jacobian[3, j] + h * jv
            jacobian[4, j] = jv
            jacobian[3, j] = jx
            g1 = a11 * jp1 + a12 * jp2 + x1 * jx + c1 * (conductance * r1 * opened - area * jv)
            g2 = a21 * jp1 + a22 * jp2 + x2 * jx + c2 * (area * jv - conductance * r2 * opened)
            if j == 7:
                g1 -= c1 * e1
            elif j == 8:
                g2 -= c2 * e2
            elif j == 9:
                g1 -= c1 * e12
                g2 += c2 * e12
            jacobian[1, j] = g1
            jacobian[2, j] = g2
        p1 += d1
        p2 += d2
    x[0], x[1], x[2], x[3], x[4], x[5] = spool, p1, p2, position, velocity, spool_velocity


@njit(cache=True, error_model="numpy")
def _predict_covariance(covariance, jacobian, product):
    """Replace P by Phi P Phi^T, exploiting that rows 7 to 11 of Phi are the identity."""
    for i in range(_DYNAMIC):
        for j in range(STATE_COUNT):
            total = 0.0
            for k in range(STATE_COUNT):
                total += jacobian[i, k] * covariance[k, j]
            product[i, j] = total
    for i in range(_DYNAMIC):
        for j in range(i, _DYNAMIC):
            total = 0.0
            for k in range(STATE_COUNT):
                total += product[i, k] * jacobian[j, k]
            covariance[i, j] = total
            covariance[j, i] = total
        for j in range(_DYNAMIC, STATE_COUNT):
            covariance[i, j] = product[i, j]
            covariance[j, i] = product[i, j]


@njit(cache=True, error_model="numpy")
def _correct(x, covariance, index, measured, variance, gain):
    """Apply one scalar measurement of a state; return the innovation and its variance.

    P - K S K^T with K = P h / S, kept symmetric by construction.
    """
    innovation = measured - x[index]
    total = covariance[index, index] + variance
    for i in range(STATE_COUNT):
        gain[i] = covariance[i, index] / total
    for i in range(STATE_COUNT):
        x[i] += gain[i] * innovation
        for j in range(i, STATE_COUNT):
            reduced = covariance[i, j] - gain[i] * gain[j] * total
            covariance[i, j] = reduced
            covariance[j, i] = reduced
    return innovation, total


@njit(cache=True, error_model="numpy")
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
        work: scratch, float64 (13, 11).
        out: float64 (9,): innovations, a posteriori residuals and innovation variances of position,
            pressure 1 and pressure 2.
    """
    jacobian, product, gain = work[:6], work[6:12], work[12]
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
    out[3] = position - x[3]
    out[4] = p1 - x[1]
    out[5] = p2 - x[2]
