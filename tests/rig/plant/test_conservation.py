"""Nothing comes from nothing: no energy at rest, no oil in a chamber but through an orifice."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numba import njit
from numpy.typing import NDArray

from rig.plant import BRISTLE, KARNOPP, NO_FAULT, NOMINAL, Model, Parameters
from rig.plant.dynamics import (
    PlantState,
    chamber_volumes,
    leak_flows,
    rates,
    valve_conductance,
    valve_flows,
)
from rig.plant.integrator import SUBSTEPS, TICK, advance
from rig.plant.simulation import simulate

Array = NDArray[np.float64]

SHUT = np.zeros(60)
PIECES = 16

JITTER = 1e-5
"""J. Energy of the ram at 1.4 mm/s: what a reversal within a step may cost or give."""

LAWS = st.sampled_from([BRISTLE, KARNOPP])
POSITIONS = st.floats(0.01, 0.6)
VELOCITIES = st.floats(-0.6, 0.6)
PRESSURES = st.floats(-1e6, 13.8e6)


def disturbed(position: float, velocity: float, p1: float, p2: float, law: float) -> Array:
    """Return the state of a ram struck while the valve is at null."""
    z = np.sign(velocity) if law == KARNOPP else 0.0
    return np.array([0.0, 0.0, p1, p2, position, velocity, z, 13.8e6, 0.0])


def oil(pressure: Array, volume: Array, parameters: Parameters) -> Array:
    """Return the oil in a chamber in m^3, unpressurised: all of the volume but a cavity."""
    strain = pressure / parameters.bulk_modulus
    return volume * np.where(strain > 0.0, np.exp(strain), 1.0 + strain)


def chamber_oil(run: dict[str, Array], parameters: Parameters) -> tuple[Array, Array]:
    v1, v2 = np.array([chamber_volumes(x, parameters) for x in run["position"]]).T
    return oil(run["pressure_1"], v1, parameters), oil(run["pressure_2"], v2, parameters)


def energy(run: dict[str, Array], parameters: Parameters) -> Array:
    """Return the energy in J of ram, compressed oil, bristles, spring and stroke ends."""
    par, x = parameters, run["position"]
    total = 0.5 * par.moving_mass * run["velocity"] ** 2
    v1, v2 = np.array([chamber_volumes(position, par) for position in x]).T
    for pressure, volume in ((run["pressure_1"], v1), (run["pressure_2"], v2)):
        p = np.maximum(pressure, 0.0)
        # Work that the oil can do before it is free of pressure: the integral of p dV.
        total += volume * (par.bulk_modulus * np.expm1(p / par.bulk_modulus) - p)
    if par.friction_law == BRISTLE:
        total += 0.5 * par.bristle_stiffness * run["friction_state"] ** 2
    total += 0.5 * par.spring_stiffness * np.maximum(x - par.spring_contact, 0.0) ** 2
    past_end = np.maximum(x - par.stroke_max, 0.0) + np.maximum(par.stroke_min - x, 0.0)
    return total + 0.5 * par.stop_stiffness * past_end**2


@given(POSITIONS, VELOCITIES, PRESSURES, PRESSURES, LAWS, st.sampled_from([0.0, 2e4, 6e5]))
def test_a_struck_ram_never_gains_energy(
    position: float, velocity: float, p1: float, p2: float, law: float, stiffness: float
) -> None:
    rig = NOMINAL._replace(friction_law=law, spring_stiffness=stiffness, spring_contact=0.45)
    run = simulate(Model(parameters=rig), SHUT, initial=disturbed(position, velocity, p1, p2, law))
    stored = energy(run, rig)
    assert (np.diff(stored) <= 1e-5 * stored[0] + JITTER).all()


@given(POSITIONS, st.floats(-0.1, 0.1), st.floats(2e6, 13.8e6), LAWS)
def test_without_friction_the_ram_swings_on_its_oil_without_gaining_energy(
    position: float, velocity: float, pressure: float, law: float
) -> None:
    rig = NOMINAL._replace(
        stiction=0.0, coulomb=0.0, viscous=0.0, bristle_damping=0.0, friction_law=law
    )
    start = disturbed(position, velocity, pressure, pressure, law)
    stored = energy(simulate(Model(parameters=rig), SHUT, initial=start), rig)
    kinetic = 0.5 * rig.moving_mass * velocity**2
    assert (np.diff(stored) <= 1e-4 * kinetic + 1e-8).all()


@pytest.mark.parametrize(("substeps", "tolerance"), [(SUBSTEPS, 3e-6), (16 * SUBSTEPS, 3e-8)])
@given(POSITIONS, VELOCITIES, PRESSURES, PRESSURES, LAWS)
def test_a_shut_chamber_keeps_its_oil_cavitating_or_not(
    substeps: int,
    tolerance: float,
    position: float,
    velocity: float,
    p1: float,
    p2: float,
    law: float,
) -> None:
    rig = NOMINAL._replace(friction_law=law)
    start = disturbed(position, velocity, p1, p2, law)
    run = simulate(Model(parameters=rig), SHUT, initial=start, substeps=substeps)
    for kept in chamber_oil(run, rig):
        assert np.ptp(kept) < tolerance * kept[0]


@given(
    st.tuples(
        st.floats(-3e-4, 3e-4),
        st.just(0.0),
        st.floats(-5e7, 2e7),
        st.floats(-5e7, 2e7),
        POSITIONS,
        VELOCITIES,
        st.just(0.0),
        st.floats(5e6, 2e7),
        st.floats(0.0, 2e6),
    )
)
def test_a_chambers_oil_changes_by_what_flows_through_its_orifices(
    state: tuple[float, ...],
) -> None:
    rig = NOMINAL._replace(external_leakage_1=4e-9, internal_leakage=3e-9)
    s, _, p1, p2, x, v, _, ps, pe = state
    change = rates(*PlantState(*state), 0.0, rig, NO_FAULT)
    q1, q2 = valve_flows(s, max(p1, 0.0), max(p2, 0.0), ps, pe, valve_conductance(rig))
    out_1, out_2, across = leak_flows(max(p1, 0.0), max(p2, 0.0), pe, rig, NO_FAULT)
    v1, v2 = chamber_volumes(x, rig)
    for pressure, slope, volume, growth, inflow in (
        (p1, change[2], v1, rig.piston_area * v, q1 - out_1 - across),
        (p2, change[3], v2, -rig.piston_area * v, across - out_2 - q2),
    ):
        # d/dt of `oil`: V exp(p / beta) under pressure, V (1 + p / beta) with a cavity.
        strain = pressure / rig.bulk_modulus
        full = np.exp(strain) if strain > 0.0 else 1.0
        filled = full if strain > 0.0 else 1.0 + strain
        gained = growth * filled + volume * full * slope / rig.bulk_modulus
        assert gained == pytest.approx(full * inflow, rel=1e-9, abs=1e-15)


@njit(cache=True, error_model="numpy")
def finely(state, command, par, fault, steps, states):  # type: ignore[no-untyped-def]
    """Run tick by tick in so many steps; keep the state each sixteenth of a millisecond."""
    for k in range(command.size):
        for piece in range(PIECES):
            states[k * PIECES + piece] = state
            advance(state, command[k], par, fault, TICK / PIECES, steps)


@pytest.mark.parametrize("law", [BRISTLE, KARNOPP], ids=["bristle", "karnopp"])
def test_over_a_run_into_a_stroke_end_and_through_cavitation_the_oil_accounts_balance(
    law: float,
) -> None:
    rig = NOMINAL._replace(friction_law=law, external_leakage_1=4e-9, internal_leakage=3e-9)
    time = np.arange(300) * TICK
    command = 10.0 * np.sign(np.sin(10.0 * np.pi * time + 0.3))
    states = np.empty((command.size * PIECES, len(PlantState._fields)))
    start = disturbed(0.57, 0.0, 6.9e6, 6.9e6, law)
    finely(start, command, rig, np.zeros(len(NO_FAULT)), 1, states)
    run = dict(zip(PlantState._fields, states.T, strict=True))
    assert run["position"].max() > rig.stroke_max
    assert min(run["pressure_1"].min(), run["pressure_2"].min()) < -1e4

    p1, p2 = np.maximum(run["pressure_1"], 0.0), np.maximum(run["pressure_2"], 0.0)
    inflow = np.empty((2, states.shape[0]))
    conductance = valve_conductance(rig)
    for i, (s, ps, pe) in enumerate(
        zip(run["spool"], run["supply_pressure"], run["return_pressure"], strict=True)
    ):
        q1, q2 = valve_flows(s, p1[i], p2[i], ps, pe, conductance)
        out_1, out_2, across = leak_flows(p1[i], p2[i], pe, rig, NO_FAULT)
        inflow[:, i] = q1 - out_1 - across, across - out_2 - q2
    inflow *= np.exp(np.stack([p1, p2]) / rig.bulk_modulus)
    step = TICK / PIECES
    for kept, flow in zip(chamber_oil(run, rig), inflow, strict=True):
        admitted = np.concatenate([[0.0], np.cumsum(0.5 * step * (flow[1:] + flow[:-1]))])
        assert np.ptp(kept) > 1e-5
        assert kept - kept[0] == pytest.approx(admitted, abs=2e-3 * np.ptp(kept))
