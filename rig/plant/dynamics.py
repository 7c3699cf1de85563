"""The plant's differential equations, in compiled scalar code (docs/model.md).

A chamber pressure below zero stands for a vapour cavity of volume -p V / beta, while the oil itself
is at zero pressure. No oil is thus lost or made when a chamber cavitates. All pressures are gauge
pressures, relative to that at the tank's surface.
"""

from math import copysign, exp, sin, sqrt
from typing import Any, Final, NamedTuple

import numpy as np

from rig.jit import njit
from rig.lanes import anywhere, select

from .added_terms import added
from .compiled import inlined, inner
from .parameters import KARNOPP, Parameters


class PlantState(NamedTuple):
    """True state of the rig, SI; the plant keeps it as a float64 array in this order."""

    spool: float
    spool_velocity: float
    pressure_1: float
    pressure_2: float
    position: float
    velocity: float
    friction_state: float
    """Bristle deflection in m; with Karnopp friction the direction of sliding, or 0 if stuck."""
    supply_pressure: float
    return_pressure: float


STATE_COUNT: Final = len(PlantState._fields)

# Velocity, in widths of the Gaussian bristle damping, at which it is below one part in 10^15.
_DAMPING_CUTOFF: Final = 6.0

ATMOSPHERE: Final = 101325.0
"""Absolute pressure in Pa at the tank's surface, to which all pressures are relative (ISO 2533)."""

LEVEL_FLOOR: Final = 1.0
"""Least friction level in N. Bristles need a level to relax to; this one is below the resolution of
any sensor."""


def rest_state(parameters: Parameters, position: float) -> np.ndarray:
    """Return the state (9,) of a ram at rest at `position` (m), with the spool at 0 m.

    Both chambers are at the mean of supply and return pressure. A ripple is added to the supply
    pressure as it is at time 0.
    """
    supply, back = parameters.supply_pressure, parameters.return_pressure
    chamber = 0.5 * (supply + back)
    rippled = supply + parameters.supply_ripple * sin(parameters.supply_ripple_phase)
    return np.array([0.0, 0.0, chamber, chamber, position, 0.0, 0.0, rippled, back])


@inlined
def _excess(value):
    """Return the value where it is positive, else zero in the same unit."""
    return select(value > 0.0, value, 0.0 * value)


@njit(cache=True, error_model="numpy", forceinline=True)
def signed_root(drop):
    """Return sgn(drop) sqrt(|drop|) in Pa^0.5: the orifice law for flow in both directions.

    The whole project uses this law, with three exceptions. The product filter and the controller
    each round it off near zero in their own way, and the thesis filters have a least drop.
    """
    return copysign(sqrt(abs(drop)), drop)


def signed_roots(drops: Any) -> Any:
    """Return `signed_root` in Pa^0.5 of a number or an array in Pa, for plain Python code."""
    return np.sign(drops) * np.sqrt(np.abs(drops))


@njit(cache=True, error_model="numpy", forceinline=True)
def valve_conductance(par):
    """Return C_d w sqrt(2/rho) in m^2/(s Pa^0.5): flow per opening and root of drop (eq. 2.1)."""
    return par.discharge_coefficient * par.area_gradient * sqrt(2.0 / par.density)


@njit(cache=True, error_model="numpy", forceinline=True)
def valve_drops(opening, p1, p2, supply, back):
    """Return the drops in Pa over the open edges at ports 1 and 2 (eqs. 2.1 and 2.2).

    With an opening of 0 or more, chamber 1 is connected to the supply and chamber 2 to the return;
    with a negative opening it is the other way round.
    """
    extending = opening >= 0.0
    drop_1 = select(extending, supply - p1, p1 - back)
    drop_2 = select(extending, p2 - back, supply - p2)
    return drop_1, drop_2


@njit(cache=True, error_model="numpy", forceinline=True)
def valve_flows(opening, p1, p2, supply, back, conductance):
    """Return (q1 into chamber 1, q2 out of chamber 2) in m^3/s (eqs. 2.1 and 2.2).

    The edges are ideal, without laps, and the ports alike. The conductance is `valve_conductance`.
    """
    drop_1, drop_2 = valve_drops(opening, p1, p2, supply, back)
    flow = conductance * opening
    return flow * signed_root(drop_1), flow * signed_root(drop_2)


@inlined
def lapped(opening, par):
    """Return the opening in m that is left with an overlap d: y -> sgn(y) max(0, |y| - d)."""
    return copysign(_excess(abs(opening) - par.valve_deadband), opening)


@inlined
def edge_flows(opening, p1, p2, supply, back, par):
    """Return the flows in m^3/s past the valve's four edges (Merritt 1967, ch. 5).

    They are: supply to chamber 1, chamber 1 to return, supply to chamber 2, chamber 2 to return.
    Near the null of an underlapped valve all edges are open, and oil flows from supply to return.
    The opening in m is the one that `lapped` leaves.
    """
    conductance = valve_conductance(par)
    forth = conductance * _excess(par.valve_underlap_leakage + opening)
    back_edge = conductance * _excess(par.valve_underlap_leakage - opening)
    second = 1.0 - par.valve_flow_asymmetry
    return (
        forth * signed_root(supply - p1),
        back_edge * signed_root(p1 - back),
        second * back_edge * signed_root(supply - p2),
        second * forth * signed_root(p2 - back),
    )


@inlined
def is_real_valve(par):
    """Return whether the valve has an overlap or underlap, or ports that differ."""
    laps = (par.valve_deadband != 0.0) | (par.valve_underlap_leakage != 0.0)
    return laps | (par.valve_flow_asymmetry != 0.0)


@inlined
def port_flows(opening, p1, p2, supply, back, par):
    """Return (q1 into chamber 1, q2 out of chamber 2) in m^3/s, laps and asymmetry included.

    The opening in m is the spool's position plus the null bias, before an overlap is taken off.
    """
    if anywhere(is_real_valve(par)):
        edges = edge_flows(lapped(opening, par), p1, p2, supply, back, par)
        return edges[0] - edges[1], edges[3] - edges[2]
    return valve_flows(opening, p1, p2, supply, back, valve_conductance(par))


@njit(cache=True, error_model="numpy", forceinline=True)
def leak_flows(p1, p2, back, par, fault):
    """Return the leaks (from chamber 1, from chamber 2, from 1 to 2) in m^3/s (eqs. 5.1, 5.2).

    The model's own coefficients and those of the injected fault are added, as two parallel paths.
    """
    k1 = par.external_leakage_1 + fault[0]
    k2 = par.external_leakage_2 + fault[1]
    k12 = par.internal_leakage + fault[2]
    l1 = par.external_leakage_1_linear + fault[3]
    l2 = par.external_leakage_2_linear + fault[4]
    l12 = par.internal_leakage_linear + fault[5]
    q1 = q2 = q12 = 0.0
    # Each root is computed only if it is needed: roots are slow, and few rigs have several leaks.
    if anywhere(k1 != 0.0):
        q1 = k1 * signed_root(p1 - back)
    if anywhere(k2 != 0.0):
        q2 = k2 * signed_root(p2 - back)
    if anywhere(k12 != 0.0):
        q12 = k12 * signed_root(p1 - p2)
    if anywhere((l1 != 0.0) | (l2 != 0.0) | (l12 != 0.0)):
        q1 += l1 * (p1 - back)
        q2 += l2 * (p2 - back)
        q12 += l12 * (p1 - p2)
    return q1, q2, q12


@inlined
def open_leaks(state, par, fault):
    """Return the leaks (from chamber 1, from chamber 2, from 1 to 2) of a true state in m^3/s.

    The state has the order of `PlantState`. The pressure in a cavity counts as 0 Pa.
    """
    return leak_flows(max(state[2], 0.0), max(state[3], 0.0), state[8], par, fault)


@inlined
def line_rates(opening, p1, p2, q1, q2, leak_1, leak_2, ps, pe, par, fault):
    """Return the rates of supply and return pressure, (dp_s/dt, dp_e/dt), in Pa/s.

    With a first-order lag the pressures follow those of pump and tank, less the droop of the supply
    and plus the back pressure of the return line, which both grow with the square of the flow
    (Merritt 1967, ch. 3). A supply leak flows from the supply to the return line (figure 2.3). The
    flows are in m^3/s: q1 into chamber 1, q2 out of chamber 2, and leaks from chambers to return.
    """
    dps = par.supply_pressure - ps
    dpe = par.return_pressure - pe
    restriction = par.return_back_pressure + fault[7]
    if anywhere((par.supply_droop != 0.0) | (restriction != 0.0)):
        extending = opening >= 0.0
        drawn = select(extending, q1, -q2)
        returned = select(extending, q2, -q1)
        if anywhere(par.valve_underlap_leakage != 0.0):
            fed_1, drained_1, fed_2, drained_2 = edge_flows(
                lapped(opening, par), p1, p2, ps, pe, par
            )
            drawn, returned = fed_1 + fed_2, drained_1 + drained_2
        returned += leak_1 + leak_2
        supply_leakage = par.supply_leakage + fault[6]
        if anywhere(supply_leakage != 0.0):
            supply_leak = supply_leakage * signed_root(ps - pe)
            drawn += supply_leak
            returned += supply_leak
        dps -= par.supply_droop * drawn * abs(drawn)
        dpe += restriction * returned * abs(returned)
    rate = 1.0 / par.line_time_constant
    return dps * rate, dpe * rate


@njit(cache=True, error_model="numpy", forceinline=True)
def chamber_volumes(position, par):
    """Return the volumes (V1, V2) in m^3 of chambers and lines at a ram position (eq. 2.4)."""
    v1 = par.line_volume_1 + par.piston_area * (position - par.stroke_min)
    v2 = par.line_volume_2 + par.piston_area * (par.stroke_max - position)
    return v1, v2


@inlined
def _aeration(pressure, par):
    """Return the numerator and the denominator of `aeration_softening`, both in Pa^2."""
    air = par.entrained_air
    absolute = max(pressure, 0.0) + ATMOSPHERE
    liquid = (1.0 - air) * absolute
    bubbles = air * ATMOSPHERE
    return absolute * (liquid + bubbles), absolute * liquid + par.bulk_modulus * bubbles


@njit(cache=True, error_model="numpy", forceinline=True)
def aeration_softening(pressure, par):
    """Return beta_e / beta, the part of the oil's bulk modulus that is left with entrained air.

    Bubbles follow the pressure isothermally (Merritt 1967, ch. 2). A pressure below zero counts as
    zero.
    """
    numerator, denominator = _aeration(pressure, par)
    return numerator / denominator


@njit(cache=True, error_model="numpy", forceinline=True)
def aeration_compliance(pressure, par):
    """Return d(1/beta_e)/da in 1/Pa at a = 0, with a the volume fraction of entrained air.

    This is the linear term of the compliance that `aeration_softening` gives for a little air.
    """
    ratio = ATMOSPHERE / (max(pressure, 0.0) + ATMOSPHERE)
    return ratio * (ratio / ATMOSPHERE - 1.0 / par.bulk_modulus)


@inlined
def pressure_rates(p1, p2, x, v, inflow_1, inflow_2, par):
    """Return (dp1/dt, dp2/dt) in Pa/s for net inflows in m^3/s (eq. 2.3).

    For a cavity (p < 0) the volume of oil is conserved: d(p V / beta_e)/dt = inflow - dV/dt.
    """
    v1, v2 = chamber_volumes(x, par)
    swept_1 = swept_2 = par.piston_area * v
    if anywhere(par.entrained_air != 0.0):
        # Both chambers share one division, which is slow.
        soft_1, hard_1 = _aeration(p1, par)
        soft_2, hard_2 = _aeration(p2, par)
        stiffness = par.bulk_modulus / (v1 * hard_1 * v2 * hard_2)
        stiffness_1 = stiffness * v2 * hard_2 * soft_1
        stiffness_2 = stiffness * v1 * hard_1 * soft_2
    else:
        stiffness = par.bulk_modulus / (v1 * v2)
        stiffness_1, stiffness_2 = stiffness * v2, stiffness * v1
    if anywhere((p1 < 0.0) | (p2 < 0.0)):
        swept_1 *= 1.0 - _excess(-p1) / (stiffness_1 * v1)
        swept_2 *= 1.0 - _excess(-p2) / (stiffness_2 * v2)
    return stiffness_1 * (inflow_1 - swept_1), stiffness_2 * (inflow_2 + swept_2)


@inlined
def stops(par):
    """Return the ram's (lowest, highest) position in m: stops inside the stroke, or stroke ends."""
    return max(par.stroke_min, par.stop_low), min(par.stroke_max, par.stop_high)


@njit(cache=True, error_model="numpy", forceinline=True)
def total_mass(par):
    """Return the moving mass in kg, ram and payload together (eq. 2.6)."""
    return par.moving_mass + par.payload_mass


@inlined
def spring_force(position, par):
    """Return the spring's force in N against extension, as the load cell measures it (chapter 6).

    It is 0 before the contact. A ram that is pressed into a stroke end counts as being at the end.
    """
    within = min(max(position, par.stroke_min), par.stroke_max)
    return par.spring_stiffness * _excess(within - par.spring_contact)


@njit(cache=True, error_model="numpy", forceinline=True)
def environment_force(position, velocity, par):
    """Return the force in N that spring, constant force and stops exert against extension.

    Position and velocity are in m and m/s (chapter 6). A stop acts beyond its position as a stiff
    spring with losses (Hunt and Crossley 1975).
    """
    force = par.spring_stiffness * _excess(position - par.spring_contact) + par.constant_force
    low, high = stops(par)
    above = position - high
    below = low - position
    if anywhere((above > 0.0) | (below > 0.0)):
        damping = par.stop_damping * velocity
        force += par.stop_stiffness * _excess(above) * max(0.0, 1.0 + damping)
        force -= par.stop_stiffness * _excess(below) * max(0.0, 1.0 - damping)
    return force


@njit(cache=True, error_model="numpy", forceinline=True)
def slip_friction(speed, direction, par):
    """Return the friction level g in N at a speed (m/s), without its viscous part (eq. 2.8).

    The direction is positive when extending, negative when retracting; it matters for the
    asymmetry. The level is at least `LEVEL_FLOOR`.
    """
    level = par.coulomb + (par.stiction - par.coulomb) * exp(-speed * (1.0 / par.stribeck_velocity))
    asymmetry = par.friction_asymmetry
    level += select(
        direction > 0.0, asymmetry, select(direction < 0.0, -asymmetry, 0.0 * asymmetry)
    )
    return max(level, LEVEL_FLOOR)


@njit(cache=True, error_model="numpy", forceinline=True)
def friction(velocity, friction_state, par):
    """Return the rate dz/dt of the friction state in m/s, and the friction in N against the motion.

    Friction is that of bristles (Canudas de Wit et al. 1995), or Karnopp's while sliding (eq. 2.8).
    Karnopp's state, the direction of sliding, has rate 0, as it changes between steps only.
    """
    direction = friction_state if par.friction_law == KARNOPP else velocity
    level = slip_friction(abs(velocity), direction, par)
    return friction_at(level, velocity, friction_state, par)


@inlined
def friction_at(level, velocity, friction_state, par):
    """Return (dz/dt in m/s, friction in N against the motion) for a given friction level in N.

    Bristles and Karnopp friction are as in `friction`, which works the level out by itself.
    """
    karnopp = par.friction_law == KARNOPP
    speed = abs(velocity)
    force = par.viscous * velocity
    if karnopp:
        return 0.0 * velocity, force + friction_state * level
    bristle_velocity = velocity - par.bristle_stiffness * speed * friction_state / level
    force += par.bristle_stiffness * friction_state
    ratio = velocity * (1.0 / par.bristle_damping_velocity)
    damped = abs(ratio) < _DAMPING_CUTOFF
    if anywhere(damped):
        bell = select(damped, exp(-ratio * ratio), 0.0)
        force += par.bristle_damping * bell * bristle_velocity
    return bristle_velocity, force


@inlined
def spool_rates(spool, velocity, command, par):
    """Return the spool's velocity in m/s and acceleration in m/s^2 (eq. 2.5).

    The velocity is limited to the greatest speed that the pilot stage's flow allows, and at that
    speed the acceleration in the same direction is 0.
    """
    wn = par.valve_natural_frequency
    pull = wn * wn * (par.valve_gain * command - spool) - 2.0 * par.valve_damping * wn * velocity
    limit = par.valve_rate_limit
    if anywhere(abs(velocity) >= limit):
        faster = ((velocity >= limit) & (pull > 0.0)) | ((velocity <= -limit) & (pull < 0.0))
        pull = select(faster, 0.0 * pull, pull)
        velocity = min(max(velocity, -limit), limit)
    return velocity, pull


@inner
def slip_level(velocity, x, spool, p1, p2, command, par):
    """Return the friction level in N of bristles: `slip_friction` and the added friction."""
    level = slip_friction(abs(velocity), velocity, par)
    terms = added(velocity, x, spool, p1, p2, command, par)
    return max(level + terms.friction, LEVEL_FLOOR)


@inlined
def added_inflows(terms, leak, p1, p2, supply, back, par):
    """Return the flows (into chamber 1, into chamber 2) in m^3/s that are due to added terms.

    An opening of the edges lets oil from the supply into each chamber and from each chamber into
    the return (Merritt 1967, ch. 5). Droop and back pressure of the lines do not follow it.

    Args:
        terms: what the terms add up to (`Added`).
        leak: opening from chamber 1 to chamber 2, m^3/(s Pa^0.5): `terms.leak`, or 0 for a caller
            that has it elsewhere.
        p1: pressure of chamber 1, Pa.
        p2: pressure of chamber 2, Pa.
        supply: supply pressure, Pa.
        back: return pressure, Pa.
        par: `Parameters`.
    """
    across = leak * signed_root(p1 - p2)
    ajar = valve_conductance(par) * terms.edges
    through_1 = ajar * (signed_root(supply - p1) - signed_root(p1 - back))
    through_2 = ajar * (signed_root(supply - p2) - signed_root(p2 - back))
    second = 1.0 - par.valve_flow_asymmetry
    return terms.flow_1 - across + through_1, terms.flow_2 + across + second * through_2


@inner
def _with_terms(s, w, p1, p2, x, v, z, ps, pe, command, inflow_1, inflow_2, par):
    """Return (dx_sp/dt, dw/dt, dp_1/dt, dp_2/dt, dv/dt, dz/dt) with the model's added terms.

    The arguments are states as in `rates`, the command in V, and the net inflows in m^3/s without
    the terms.
    """
    oil_1, oil_2 = max(p1, 0.0), max(p2, 0.0)
    terms = added(v, x, s, oil_1, oil_2, command, par)
    direction = z if par.friction_law == KARNOPP else v
    level = max(slip_friction(abs(v), direction, par) + terms.friction, LEVEL_FLOOR)
    dz, drag = friction_at(level, v, z, par)
    added_1, added_2 = added_inflows(terms, terms.leak, oil_1, oil_2, ps, pe, par)
    dp1, dp2 = pressure_rates(p1, p2, x, v, inflow_1 + added_1, inflow_2 + added_2, par)
    force = par.piston_area * (oil_1 - oil_2) - environment_force(x, v, par)
    force -= terms.force
    ds, dw = spool_rates(s, w, command + terms.spool / par.valve_gain, par)
    return ds, dw, dp1, dp2, (force - drag) * (1.0 / total_mass(par)), dz


@njit(cache=True, error_model="numpy", forceinline=True)
def rates(s, w, p1, p2, x, v, z, ps, pe, command, par, fault):
    """Return the time derivatives of all nine states, SI, in the order of `PlantState`.

    The arguments are the nine states in the same order, the valve command (V), `Parameters` and the
    eight fault coefficients of `FaultInput`.
    """
    dz, drag = friction(v, z, par)
    oil_1 = max(p1, 0.0)
    oil_2 = max(p2, 0.0)
    opening = s + par.spool_null_bias
    q1, q2 = port_flows(opening, oil_1, oil_2, ps, pe, par)
    leak_1, leak_2, leak_12 = leak_flows(oil_1, oil_2, pe, par, fault)
    dp1, dp2 = pressure_rates(p1, p2, x, v, q1 - leak_12 - leak_1, leak_12 - leak_2 - q2, par)
    force = par.piston_area * (oil_1 - oil_2) - environment_force(x, v, par)
    dv = (force - drag) * (1.0 / total_mass(par))
    ds, dw = spool_rates(s, w, command, par)
    if anywhere(par.term_1_kind != 0.0):
        ds, dw, dp1, dp2, dv, dz = _with_terms(
            s, w, p1, p2, x, v, z, ps, pe, command,
            q1 - leak_12 - leak_1, leak_12 - leak_2 - q2, par,
        )  # fmt: skip
    if par.friction_law == KARNOPP:
        dv = select(z != 0.0, dv, 0.0 * dv)
    dps, dpe = line_rates(opening, oil_1, oil_2, q1, q2, leak_1, leak_2, ps, pe, par, fault)
    return ds, dw, dp1, dp2, v, dv, dz, dps, dpe
