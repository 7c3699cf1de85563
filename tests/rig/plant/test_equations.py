"""The rates satisfy the thesis's equations as corrected, each in the form it is printed in."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rig.plant import BRISTLE, KARNOPP, NO_FAULT, NOMINAL, Parameters
from rig.plant.dynamics import PlantState, leak_flows, rates

SPOOLS = st.one_of(st.floats(-3e-4, -1e-7), st.floats(1e-7, 3e-4))


@st.composite
def states(draw: st.DrawFn) -> PlantState:
    """Draw a state of a ram between its stroke ends whose chambers hold pressure."""
    return PlantState(
        spool=draw(SPOOLS),
        spool_velocity=draw(st.floats(-0.2, 0.2)),
        pressure_1=draw(st.floats(1e3, 1.3e7)),
        pressure_2=draw(st.floats(1e3, 1.3e7)),
        position=draw(st.floats(0.0, 0.6069)),
        velocity=draw(st.floats(-0.9, 0.9).filter(lambda v: abs(v) > 1e-6)),
        friction_state=draw(st.floats(-1e-4, 1e-4)),
        supply_pressure=13.8e6,
        return_pressure=0.0,
    )


@st.composite
def rigs(draw: st.DrawFn) -> Parameters:
    return NOMINAL._replace(
        external_leakage_1=draw(st.floats(0.0, 1e-8)),
        external_leakage_2=draw(st.floats(0.0, 1e-8)),
        internal_leakage=draw(st.floats(0.0, 1e-8)),
        spring_stiffness=draw(st.sampled_from([0.0, 2e4, 6e5])),
        moving_mass=draw(st.floats(5.0, 50.0)),
        bulk_modulus=draw(st.floats(3e8, 2e9)),
    )


def rate_of(state: PlantState, command: float, rig: Parameters) -> PlantState:
    return PlantState(*rates(*state, command, rig, NO_FAULT))


def valve_flow(rig: Parameters, spool: float, drop: float) -> float:
    """Return C_d w x sqrt((2/rho) drop), against the drop if that is negative (eqs. 2.1, 2.2)."""
    root = np.sign(drop) * np.sqrt(2.0 / rig.density * abs(drop))
    return float(rig.discharge_coefficient * rig.area_gradient * spool * root)


@given(states(), rigs(), st.floats(-10.0, 10.0))
def test_continuity_holds_in_both_chambers(
    state: PlantState, rig: Parameters, command: float
) -> None:
    """Eqs. 2.1 to 2.4, the second line of 2.3 balanced: an external leak lowers p2."""
    x_sp, p1, p2 = state.spool, state.pressure_1, state.pressure_2
    if x_sp > 0.0:
        q1 = valve_flow(rig, x_sp, state.supply_pressure - p1)
        q2 = valve_flow(rig, x_sp, p2 - state.return_pressure)
    else:
        q1 = valve_flow(rig, x_sp, p1 - state.return_pressure)
        q2 = valve_flow(rig, x_sp, state.supply_pressure - p2)
    q_el1, q_el2, q_il = leak_flows(p1, p2, state.return_pressure, rig, NO_FAULT)
    rate = rate_of(state, command, rig)
    volume_1 = rig.line_volume_1 + rig.piston_area * (state.position - rig.stroke_min)
    volume_2 = rig.line_volume_2 + rig.piston_area * (rig.stroke_max - state.position)
    swept = rig.piston_area * rate.position
    beta = rig.bulk_modulus
    assert q1 == pytest.approx(
        swept + volume_1 / beta * rate.pressure_1 + q_il + q_el1, rel=1e-9, abs=1e-14
    )
    assert q2 == pytest.approx(
        swept - volume_2 / beta * rate.pressure_2 + q_il - q_el2, rel=1e-9, abs=1e-14
    )


@given(states(), rigs(), st.floats(-10.0, 10.0))
def test_the_spool_follows_the_command_as_a_second_order_system(
    state: PlantState, rig: Parameters, command: float
) -> None:
    """Eq. 2.5."""
    gain, frequency = rig.valve_gain, rig.valve_natural_frequency
    rate = rate_of(state, command, rig)
    assert rate.spool == state.spool_velocity
    assert command == pytest.approx(
        rate.spool_velocity / (gain * frequency**2)
        + 2.0 * rig.valve_damping / (gain * frequency) * rate.spool
        + state.spool / gain,
        abs=1e-9,
    )


@given(states(), rigs(), st.sampled_from([BRISTLE, KARNOPP]))
def test_the_force_of_the_pistons_moves_the_ram_against_friction_and_spring(
    state: PlantState, rig: Parameters, law: float
) -> None:
    """Eqs. 2.6, 2.8 and 6.8; with bristles friction after Canudas de Wit et al. 1995."""
    v, speed = state.velocity, abs(state.velocity)
    level = rig.stiction - (rig.stiction - rig.coulomb) * (1.0 - np.exp(-speed / 0.04))
    if law == KARNOPP:
        state = state._replace(friction_state=float(np.sign(v)))
        resisting, bending = level * np.sign(v), 0.0
    else:
        bending = v - 2e7 * speed * state.friction_state / level
        resisting = 2e7 * state.friction_state
        resisting += 2e4 * np.exp(-((v / 0.01) ** 2)) * bending
    rate = rate_of(state, 0.0, rig._replace(friction_law=law))
    spring = rig.spring_stiffness * max(0.0, state.position - rig.spring_contact)
    pushing = (state.pressure_1 - state.pressure_2) * rig.piston_area
    assert rate.position == v
    assert rate.friction_state == pytest.approx(bending, rel=1e-9, abs=1e-12)
    assert pushing == pytest.approx(
        rig.moving_mass * rate.velocity + resisting + rig.viscous * v + spring, abs=1e-6
    )


@given(states(), rigs())
def test_a_stuck_karnopp_ram_has_no_acceleration(state: PlantState, rig: Parameters) -> None:
    stuck = state._replace(velocity=0.0, friction_state=0.0)
    rate = rate_of(stuck, 0.0, rig._replace(friction_law=KARNOPP))
    assert rate.velocity == 0.0
    assert rate.position == 0.0
