"""Prediction model and Jacobian of the thesis filters, term by term (chapters 4 and 6).

The states are in the thesis's order: x0 = x_sp, x1 = p1, x2 = p2, x3 = x_a, x4 = v, x5 = v_sp, and
in the seven-state filter x6 = F_e. The model is a healthy rig without spring, leaks or stroke ends.
docs/model.md lists the corrections to the printed equations.

The code does not depend on float64. Comparisons use real parts only, so that the same lines run on
complex numbers (complex-step derivatives) and, if not compiled, on quantities with units.
"""

from typing import Final

import numpy as np

from rig.jit import njit
from rig.lanes import select
from rig.plant import TICK, Parameters, inlined

Vector = tuple[float, ...]

PRESSURE_DROP_FLOOR: Final = 1.0
"""Least pressure drop in Pa across an edge. An estimated pressure may leave [p_e, p_s], where the
thesis's square root has no value; the drop is then this floor, and its derivative is zero."""


@inlined
def orifice(pressure_drop: float, density: float) -> Vector:
    """Return the velocity c = sqrt((2/rho) dp) in m/s and dc/dp = 1/(rho c) in m/(s Pa) (eq. 4.19).

    A drop dp of `PRESSURE_DROP_FLOOR` or less counts as that floor, with derivative 0. This is the
    thesis's form on purpose and not `rig.plant.signed_root`: a negative drop gives no reverse flow,
    and rounding is that of the printed equation.
    """
    open_edge = pressure_drop.real > PRESSURE_DROP_FLOOR
    drop = select(open_edge, pressure_drop, PRESSURE_DROP_FLOOR)
    velocity = np.sqrt(2.0 / density * drop)
    slope = 1.0 / (density * velocity)
    return velocity, select(open_edge, slope, 0.0 * slope)


@njit(cache=True, error_model="numpy", forceinline=True)
def valve(spool: float, p1: float, p2: float, parameters: Parameters) -> Vector:
    """Return the jet velocities c1, c2 in m/s at ports 1 and 2, then dc1/dp1, dc2/dp2 in m/(s Pa).

    With a spool above 0 port 1 is fed by the supply and port 2 drains; otherwise it is reversed.
    """
    supply, drain = parameters.supply_pressure, parameters.return_pressure
    density = parameters.density
    extending = spool.real > 0.0
    jet_in, slope_in = orifice(supply - select(extending, p1, p2), density)
    jet_out, slope_out = orifice(select(extending, p2, p1) - drain, density)
    return (
        select(extending, jet_in, jet_out),
        select(extending, jet_out, jet_in),
        select(extending, -slope_in, slope_out),
        select(extending, slope_out, -slope_in),
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def stiffness(position: float, parameters: Parameters) -> Vector:
    """Return beta/V1 and beta/V2 in Pa/m^3 at a position in m (volumes of eq. 2.4)."""
    area, bulk_modulus = parameters.piston_area, parameters.bulk_modulus
    volume_1 = parameters.line_volume_1 + area * (position - parameters.stroke_min)
    volume_2 = parameters.line_volume_2 + area * (parameters.stroke_max - position)
    return bulk_modulus / volume_1, bulk_modulus / volume_2


@njit(cache=True, error_model="numpy", forceinline=True)
def friction(velocity: float, actuator_force: float, parameters: Parameters) -> Vector:
    """Return F_c in N (eqs. 2.16, 2.17, stiction acting both ways) and dF_c/dv in N s/m (eq. 4.20).

    The velocity is in m/s; `actuator_force` is the force of the pressures on the piston in N.
    While the ram sticks, the derivative is zero as in the printed A, although F_c then depends on
    the pressures.
    """
    speed = velocity if velocity.real >= 0.0 else -velocity
    if speed.real > parameters.stick_velocity:
        decay = np.exp(-speed / parameters.stribeck_velocity)
        excess = (parameters.stiction - parameters.coulomb) * decay
        level = parameters.coulomb + excess
        force = (level if velocity.real > 0.0 else -level) + parameters.viscous * velocity
        return force, parameters.viscous - excess / parameters.stribeck_velocity
    stuck = 0.0 * parameters.viscous
    if abs(actuator_force.real) < parameters.stiction:
        return actuator_force, stuck
    return (parameters.stiction if actuator_force.real > 0.0 else -parameters.stiction), stuck


@inlined
def linearised(
    state: Vector, resistance: float, u: float, parameters: Parameters
) -> tuple[Vector, Vector]:
    """Return the six physical states one tick later (eq. 2.15), and entries of the Jacobian A.

    The entries are those that both filters share (eqs. 4.19 and 6.20 without zeros and ones, row by
    row): a05, a10, a11, a13, a14, a20, a22, a23, a24, a34, a41, a42, a50, a55.

    Args:
        state: the six states before the tick, SI.
        resistance: force in N against extension: friction, or the load state.
        u: command, V.
        parameters: parameters of the rig.
    """
    T = TICK
    spool, p1, p2, position, velocity, spool_velocity = state
    jet_1, jet_2, slope_1, slope_2 = valve(spool, p1, p2, parameters)
    stiffness_1, stiffness_2 = stiffness(position, parameters)
    gradient = parameters.discharge_coefficient * parameters.area_gradient
    area, mass = parameters.piston_area, parameters.moving_mass
    frequency, damping = parameters.valve_natural_frequency, parameters.valve_damping
    net_flow_1 = gradient * spool * jet_1 - area * velocity
    net_flow_2 = area * velocity - gradient * spool * jet_2
    acceleration = (area * (p1 - p2) - resistance) / mass
    spool_acceleration = (
        frequency * frequency * (parameters.valve_gain * u - spool)
        - 2.0 * damping * frequency * spool_velocity
    )
    predicted = (
        spool + T * spool_velocity,
        p1 + T * stiffness_1 * net_flow_1,
        p2 + T * stiffness_2 * net_flow_2,
        position + T * velocity,
        velocity + T * acceleration,
        spool_velocity + T * spool_acceleration,
    )
    shrinkage = area / parameters.bulk_modulus
    entries = (
        T,
        T * stiffness_1 * gradient * jet_1,
        1.0 + T * stiffness_1 * gradient * spool * slope_1,
        -T * stiffness_1 * stiffness_1 * shrinkage * net_flow_1,
        -T * stiffness_1 * area,
        -T * stiffness_2 * gradient * jet_2,
        1.0 - T * stiffness_2 * gradient * spool * slope_2,
        T * stiffness_2 * stiffness_2 * shrinkage * net_flow_2,
        T * stiffness_2 * area,
        T,
        T * area / mass,
        -T * area / mass,
        -T * frequency * frequency,
        1.0 - T * 2.0 * damping * frequency,
    )
    return predicted, entries


@njit(cache=True, error_model="numpy", forceinline=True)
def linearised_6(state: Vector, u: float, parameters: Parameters) -> tuple[Vector, Vector]:
    """Return the six states one tick after `state`, and the Jacobian's entries at `COLUMNS[6]`.

    They follow from eqs. 2.15 to 2.17, with the command `u` in V; `COLUMNS` is in `covariance`.
    """
    force = parameters.piston_area * (state[1] - state[2])
    resistance, slope = friction(state[4], force, parameters)
    predicted, shared = linearised(state, resistance, u, parameters)
    a44 = 1.0 - TICK / parameters.moving_mass * slope
    return predicted, (*shared[:12], a44, *shared[12:])


@njit(cache=True, error_model="numpy", forceinline=True)
def linearised_7(state: Vector, u: float, parameters: Parameters) -> tuple[Vector, Vector]:
    """Return the seven states one tick after `state`, and the Jacobian's entries at `COLUMNS[7]`.

    They follow from eqs. 6.13 to 6.19, with the command `u` in V; `COLUMNS` is in `covariance`.
    """
    predicted, shared = linearised(state[:6], state[6], u, parameters)
    a46 = -TICK / parameters.moving_mass
    return (*predicted, state[6]), (*shared[:12], a46, *shared[12:])
