"""The product filter's model of the rig: its states, their prediction and the Jacobian.

Friction and environment together are one load state (section 6.3), so that no friction law is
assumed. The thesis filter takes one forward Euler step a millisecond, with which the oil column is
unstable (docs/model.md). This model takes two leapfrog steps (Stoermer and Verlet). Each advances
the velocity by half a step, then position and pressures with that velocity by a whole one, then the
velocity by the other half. An undamped oscillation stays bounded up to omega h = 2, with a relative
error of the frequency of (omega h)^2 / 24; here omega h is at most 0.6, at the stroke ends.
"""

from math import copysign, cos, cosh, exp, sin, sinh, sqrt
from typing import Final

from rig.jit import njit
from rig.lanes import anywhere, select
from rig.plant import (
    ATMOSPHERE,
    LEAKS,
    NOMINAL,
    TICK,
    added,
    added_inflows,
    chamber_volumes,
    inlined,
    inner,
    is_real_valve,
    lapped,
    total_mass,
    valve_conductance,
)

from .readings import settled_return

STATES: Final = (
    "spool_m",
    "pressure_1_Pa",
    "pressure_2_Pa",
    "position_m",
    "velocity_m_per_s",
    "spool_velocity_m_per_s",
    "load_N",
    *(f"{leak}_m3_per_s_sqrtPa" for leak in LEAKS),
    "null_bias_m",
)
STATE_COUNT: Final = len(STATES)

DYNAMIC: Final = 6
"""Number of states that the prediction changes; they come first.

Spool and spool velocity (0, 5) depend on each other only; pressures, position and velocity (1 to 4)
depend on every state."""
_SUBSTEPS: Final = 2
_SUBSTEP: Final = TICK / _SUBSTEPS
UNLIMITED: Final = NOMINAL.valve_rate_limit
"""Spool speed limit in m/s from which on the limit is ignored."""
_ROOT_WIDTH: Final = 1e4
"""Pressure drop in Pa, a third of the pressure noise, below which the orifice law is smoothed."""


@inner
def _valve_step(par):
    """Return the exact transition matrix of the spool over a substep (eq. 2.5), row by row.

    It acts on the spool's deviation from its steady state (m) and on the spool velocity (m/s), and
    holds at any damping.
    """
    rate, damping = par.valve_natural_frequency, par.valve_damping
    decay = exp(-damping * rate * _SUBSTEP)
    square = 1.0 - damping * damping
    angle = rate * _SUBSTEP * sqrt(abs(square))
    cosine, sine = decay, decay * _SUBSTEP
    if square > 0.0:
        cosine *= cos(angle)
        sine *= sin(angle) / angle
    elif square < 0.0:
        cosine *= cosh(angle)
        sine *= sinh(angle) / angle
    return (
        cosine + damping * rate * sine,
        sine,
        -rate * rate * sine,
        cosine - damping * rate * sine,
    )


@inlined
def _smooth_root(drop):
    """Return the signed root of a pressure drop (Pa^0.5, `rig.plant.signed_root`) and its slope.

    The slope is in Pa^-0.5. Within 10 kPa of zero a cubic replaces the root, with the same value
    and slope at 10 kPa, so that the slope stays finite.
    """
    near = abs(drop) < _ROOT_WIDTH
    size = sqrt(select(near, _ROOT_WIDTH, abs(drop)))
    root, slope = copysign(size, drop), 0.5 / size
    if anywhere(near):
        ratio = drop / _ROOT_WIDTH
        scale = 0.25 / sqrt(_ROOT_WIDTH)
        root = select(near, scale * drop * (5.0 - ratio * ratio), root)
        slope = select(near, scale * (5.0 - 3.0 * ratio * ratio), slope)
    return root, slope


@inlined
def _real_edges(opening, p1, p2, supply, e1, slope_e1, e2, slope_e2, par):
    """Return flows and slopes of a valve with laps or unlike ports (docs/model.md).

    Args:
        opening: opening of the valve, null bias included, m.
        p1: pressure of chamber 1, Pa.
        p2: pressure of chamber 2, Pa.
        supply: supply pressure, Pa.
        e1: smoothed root of the drop from chamber 1 to the return.
        slope_e1: slope of that root.
        e2: smoothed root of the drop from chamber 2 to the return.
        slope_e2: slope of that root.
        par: the `Parameters` that are assumed.

    Returns:
        Four values for the flow into chamber 1, then four for that out of chamber 2: derivative of
        the flow by the opening and by the chamber's pressure, both divided by the conductance; the
        flow (m^3/s); its derivative by the chamber's pressure.
    """
    conductance = valve_conductance(par)
    second = 1.0 - par.valve_flow_asymmetry
    lap = lapped(opening, par)
    moves = select(abs(opening) >= par.valve_deadband, 1.0, 0.0)
    forth = max(par.valve_underlap_leakage + lap, 0.0)
    reverse = max(par.valve_underlap_leakage - lap, 0.0)
    # Within the deadband the flow does not change with the opening. Without laps both edges start
    # to open at null; one of them is chosen.
    opens = select((forth > 0.0) | ((forth == 0.0) & (reverse == 0.0)), moves, 0.0)
    closes = select(reverse > 0.0, moves, 0.0)
    fed_1, slope_fed_1 = _smooth_root(supply - p1)
    fed_2, slope_fed_2 = _smooth_root(supply - p2)
    root_1 = opens * fed_1 + closes * e1
    root_2 = second * (opens * e2 + closes * fed_2)
    slope_1 = -forth * slope_fed_1 - reverse * slope_e1
    slope_2 = second * (forth * slope_e2 + reverse * slope_fed_2)
    flow_1 = conductance * (forth * fed_1 - reverse * e1)
    flow_2 = conductance * second * (forth * e2 - reverse * fed_2)
    return (
        root_1, slope_1, flow_1, conductance * slope_1,
        root_2, slope_2, flow_2, conductance * slope_2,
    )  # fmt: skip


@inlined
def _softening(pressure, par):
    """Return the share of the bulk modulus that entrained air leaves, and its relative slope.

    The share (0 to 1) is that of `rig.plant.dynamics.aeration_softening`; the slope is its
    derivative by the pressure, divided by the share, in 1/Pa.
    """
    air = par.entrained_air
    if air == 0.0:
        nothing = 0.0 * pressure
        return 1.0 + nothing, nothing
    absolute = max(pressure, 0.0) + ATMOSPHERE
    bubbles = air * ATMOSPHERE
    liquid = (1.0 - air) * absolute
    above, below = liquid + bubbles, absolute * liquid + par.bulk_modulus * bubbles
    slope = 1.0 / absolute + (1.0 - air) / above - 2.0 * liquid / below
    return absolute * above / below, select(pressure > 0.0, slope, 0.0)


@njit(cache=True, error_model="numpy", forceinline=True)
def predict_product(x, command, supply, par, jacobian):
    """Advance the state (11,) by one tick, in place, and fill the Jacobian's first rows (6, 11).

    The spool follows eq. 2.5 exactly. The pressures follow eq. 2.3 with the flows of eqs. 2.1, 2.2
    and 5.2 and with air in the oil. The model's added terms for flows, openings and spool are
    computed from the state before the tick; of their slopes the Jacobian has only that of the flow
    through an added leak. Added forces belong to the load state. Rows 6 to 10 of the Jacobian are
    those of the identity and are not stored.

    Args:
        x: state in the order of `STATES`, updated.
        command: command in V, constant over the tick.
        supply: supply pressure, Pa.
        par: the `Parameters` that are assumed.
        jacobian: (6, 11), overwritten.
    """
    h = _SUBSTEP
    valve = _valve_step(par)
    steady = par.valve_gain * command
    area = par.piston_area
    back = settled_return(x[0] + x[10], x[1], x[2], par)
    conductance = valve_conductance(par)
    load, k1, k2, k12, bias = x[6], x[7], x[8], x[9], x[10]
    spool, p1, p2, position, velocity, spool_velocity = x[0], x[1], x[2], x[3], x[4], x[5]
    inflow_1, inflow_2 = 0.0, 0.0
    terms = par.term_1_kind != 0.0
    if terms:
        sums = added(velocity, position, spool, p1, p2, command, par)
        steady += sums.spool
        k12 += sums.leak
        inflow_1, inflow_2 = added_inflows(sums, 0.0, p1, p2, supply, back, par)

    for i in range(DYNAMIC):
        for j in range(STATE_COUNT):
            jacobian[i, j] = 0.0
    for i in range(1, 5):
        jacobian[i, i] = 1.0
    # Rows of spool and spool velocity have entries in their own two columns only.
    spool_0, spool_5, rate_0, rate_5 = 1.0, 0.0, 0.0, 1.0

    mass = total_mass(par)
    kick = 0.5 * h / mass
    velocity += kick * (area * (p1 - p2) - load)
    jacobian[4, 1] = kick * area
    jacobian[4, 2] = -kick * area
    jacobian[4, 6] = -kick
    for substep in range(_SUBSTEPS):
        deviation = spool - steady
        opening = 0.5 * spool + bias
        opening_0, opening_5 = 0.5 * spool_0, 0.5 * spool_5
        reached = steady + valve[0] * deviation + valve[1] * spool_velocity
        spool_velocity = valve[2] * deviation + valve[3] * spool_velocity
        if par.valve_rate_limit < UNLIMITED:
            # The Jacobian ignores the limit: a spool at its limit is measured, or hardly known.
            reach = h * par.valve_rate_limit
            reached = min(max(reached, spool - reach), spool + reach)
            limit = par.valve_rate_limit
            spool_velocity = min(max(spool_velocity, -limit), limit)
        spool = reached
        spool_0, rate_0 = (
            valve[0] * spool_0 + valve[1] * rate_0,
            valve[2] * spool_0 + valve[3] * rate_0,
        )
        spool_5, rate_5 = (
            valve[0] * spool_5 + valve[1] * rate_5,
            valve[2] * spool_5 + valve[3] * rate_5,
        )
        opening += 0.5 * spool
        opening_0 += 0.5 * spool_0
        opening_5 += 0.5 * spool_5

        v1, v2 = chamber_volumes(position + 0.5 * h * velocity, par)
        position += h * velocity
        soft_1, slope_soft_1 = _softening(p1, par)
        soft_2, slope_soft_2 = _softening(p2, par)
        c1 = h * par.bulk_modulus * soft_1 / v1
        c2 = h * par.bulk_modulus * soft_2 / v2
        e1, slope_e1 = _smooth_root(p1 - back)
        e2, slope_e2 = _smooth_root(p2 - back)
        e12, slope_e12 = _smooth_root(p1 - p2)
        extending = opening >= 0.0
        if is_real_valve(par):
            r1, slope_1, flow_1, curve_1, r2, slope_2, flow_2, curve_2 = _real_edges(
                opening, p1, p2, supply, e1, slope_e1, e2, slope_e2, par
            )
        else:
            fed, slope_fed = _smooth_root(supply - select(extending, p1, p2))
            r1, slope_1 = select(extending, fed, e1), select(extending, -slope_fed, slope_e1)
            r2, slope_2 = select(extending, e2, fed), select(extending, slope_e2, -slope_fed)
            flow = conductance * opening
            flow_1, flow_2 = flow * r1, flow * r2
            curve_1, curve_2 = flow * slope_1, flow * slope_2
        d1 = c1 * (flow_1 - area * velocity - k1 * e1 - k12 * e12)
        d2 = c2 * (area * velocity - flow_2 - k2 * e2 + k12 * e12)
        if terms:
            d1, d2 = d1 + c1 * inflow_1, d2 + c2 * inflow_2

        a11 = 1.0 + c1 * (curve_1 - k1 * slope_e1 - k12 * slope_e12) + d1 * slope_soft_1
        a12 = c1 * k12 * slope_e12
        a22 = 1.0 - c2 * (curve_2 + k2 * slope_e2 + k12 * slope_e12) + d2 * slope_soft_2
        a21 = c2 * k12 * slope_e12
        # The volumes change with the position, which the velocity moves by half a step.
        x1 = -d1 * area / v1
        x2 = d2 * area / v2
        u1 = 0.5 * h * x1 - c1 * area
        u2 = 0.5 * h * x2 + c2 * area
        for j in range(STATE_COUNT):
            j1, j2, jx, jv = jacobian[1, j], jacobian[2, j], jacobian[3, j], jacobian[4, j]
            jacobian[1, j] = a11 * j1 + a12 * j2 + x1 * jx + u1 * jv
            jacobian[2, j] = a21 * j1 + a22 * j2 + x2 * jx + u2 * jv
            jacobian[3, j] = jx + h * jv
        g1 = c1 * conductance * r1
        g2 = c2 * conductance * r2
        jacobian[1, 0] += g1 * opening_0
        jacobian[1, 5] += g1 * opening_5
        jacobian[1, 7] -= c1 * e1
        jacobian[1, 9] -= c1 * e12
        jacobian[1, 10] += g1
        jacobian[2, 0] -= g2 * opening_0
        jacobian[2, 5] -= g2 * opening_5
        jacobian[2, 8] -= c2 * e2
        jacobian[2, 9] += c2 * e12
        jacobian[2, 10] -= g2
        p1 += d1
        p2 += d2

        # Two successive half steps of the velocity are one whole step; the last one stays half.
        kick = (h if substep < _SUBSTEPS - 1 else 0.5 * h) / mass
        velocity += kick * (area * (p1 - p2) - load)
        for j in range(STATE_COUNT):
            jacobian[4, j] += kick * area * (jacobian[1, j] - jacobian[2, j])
        jacobian[4, 6] -= kick
    jacobian[0, 0], jacobian[0, 5] = spool_0, spool_5
    jacobian[5, 0], jacobian[5, 5] = rate_0, rate_5
    x[0], x[1], x[2], x[3], x[4], x[5] = spool, p1, p2, position, velocity, spool_velocity
