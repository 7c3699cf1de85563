"""Entrained air softens the oil, most at low pressure, and neither makes nor loses any."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from rig.plant import NO_FAULT, NOMINAL, Model, Parameters
from rig.plant.dynamics import (
    ATMOSPHERE,
    PlantState,
    aeration_compliance,
    aeration_softening,
    chamber_volumes,
    rates,
)
from rig.plant.integrator import SUBSTEPS
from rig.plant.sensors import DATA_SHEET
from rig.plant.simulation import simulate

Array = NDArray[np.float64]

PRESSURES = st.floats(0.0, 2e7)
FRACTIONS = st.floats(1e-5, 0.1)
AERATED = NOMINAL._replace(entrained_air=0.005)
CONVERGED = 16 * SUBSTEPS
ONE = np.array(1.0)

VISIBLE = DATA_SHEET.pressure_noise / NOMINAL.bulk_modulus
"""Part of a chamber's oil that compresses it by what the pressures' noise hides."""


def compliance(pressure: float, rig: Parameters) -> float:
    """Return 1/beta_e in 1/Pa."""
    return 1.0 / (rig.bulk_modulus * aeration_softening(pressure, rig))


def mixture(pressure: Array, volume: Array, rig: Parameters) -> Array:
    """Return what a chamber holds in m^3 at the tank's pressure: V exp(integral of dp/beta_e)."""
    air, liquid = rig.entrained_air * ATMOSPHERE, 1.0 - rig.entrained_air

    def logarithm(absolute: Array) -> Array:
        both = np.log(liquid * absolute + air)
        return np.log(absolute) - both + (absolute - air / liquid * both) / rig.bulk_modulus

    pressed = logarithm(np.maximum(pressure, 0.0) + ATMOSPHERE)
    cavity = np.minimum(pressure, 0.0) * compliance(0.0, rig)
    return volume * (1.0 + cavity) * np.exp(pressed - logarithm(np.array(ATMOSPHERE)))


def struck(position: float, velocity: float, p1: float, p2: float) -> Array:
    """Return the state of a ram struck while the valve is at null."""
    return np.array([0.0, 0.0, p1, p2, position, velocity, 0.0, 13.8e6, 0.0])


@given(FRACTIONS, PRESSURES, st.floats(1.0, 1e7))
def test_air_softens_the_less_the_higher_the_pressure(
    air: float, pressure: float, more: float
) -> None:
    rig = NOMINAL._replace(entrained_air=air)
    soft = aeration_softening(pressure, rig)
    assert 0.0 < soft < 1.0
    assert soft < aeration_softening(pressure + more, rig)


@given(PRESSURES, FRACTIONS, st.floats(1.01, 2.0))
def test_more_air_is_softer(pressure: float, air: float, more: float) -> None:
    little = NOMINAL._replace(entrained_air=air)
    assert aeration_softening(pressure, little._replace(entrained_air=air * more)) < (
        aeration_softening(pressure, little)
    )


@given(FRACTIONS)
def test_at_the_tanks_pressure_bubbles_have_the_stiffness_of_a_gas(air: float) -> None:
    rig = NOMINAL._replace(entrained_air=air)
    expected = (1.0 - air) / rig.bulk_modulus + air / ATMOSPHERE
    assert compliance(0.0, rig) == pytest.approx(expected, rel=1e-12)
    assert compliance(-1e6, rig) == compliance(0.0, rig)


@given(PRESSURES)
def test_the_first_order_in_the_fraction_is_what_a_trace_of_air_adds(pressure: float) -> None:
    trace = 1e-8
    added = compliance(pressure, NOMINAL._replace(entrained_air=trace)) - 1.0 / NOMINAL.bulk_modulus
    assert added / trace == pytest.approx(
        aeration_compliance(pressure, NOMINAL), rel=1e-4, abs=1e-7 / NOMINAL.bulk_modulus
    )


@given(
    PRESSURES, PRESSURES, st.floats(-3e-4, 3e-4), st.floats(0.0, 0.6), st.floats(-0.6, 0.6),
    FRACTIONS,
)  # fmt: skip
def test_only_the_bulk_modulus_is_another(
    p1: float, p2: float, spool: float, x: float, v: float, air: float
) -> None:
    state = PlantState(spool, 0.0, p1, p2, x, v, 0.0, 13.8e6, 0.0)
    rig = NOMINAL._replace(entrained_air=air)
    plain = rates(*state, 0.0, NOMINAL, NO_FAULT)
    aerated = rates(*state, 0.0, rig, NO_FAULT)
    assert aerated[2] == pytest.approx(plain[2] * aeration_softening(p1, rig), rel=1e-12)
    assert aerated[3] == pytest.approx(plain[3] * aeration_softening(p2, rig), rel=1e-12)
    assert aerated[:2] + aerated[4:] == plain[:2] + plain[4:]


@pytest.mark.parametrize(
    ("substeps", "tolerance"), [(SUBSTEPS, VISIBLE), (CONVERGED, 0.01 * VISIBLE)]
)
@given(
    st.floats(0.01, 0.6), st.floats(-0.6, 0.6), st.floats(-1e5, 13.8e6), st.floats(-1e5, 13.8e6),
    st.floats(1e-4, 0.02),
)  # fmt: skip
def test_a_shut_chamber_keeps_its_oil_and_its_air(
    substeps: int,
    tolerance: float,
    position: float,
    velocity: float,
    p1: float,
    p2: float,
    air: float,
) -> None:
    rig = NOMINAL._replace(entrained_air=air)
    start = struck(position, velocity, p1, p2)
    run = simulate(Model(parameters=rig), np.zeros(60), initial=start, substeps=substeps)
    volumes = np.array([chamber_volumes(x, rig) for x in run["position"]]).T
    for pressure, volume in zip((run["pressure_1"], run["pressure_2"]), volumes, strict=True):
        kept = mixture(pressure, volume, rig)
        assert np.ptp(kept) < tolerance * kept[0]


@given(st.floats(0.05, 0.55), st.floats(-0.1, 0.1), st.floats(1e5, 13.8e6))
def test_without_friction_the_ram_swings_on_aerated_oil_without_gaining_energy(
    position: float, velocity: float, start: float
) -> None:
    rig = AERATED._replace(stiction=0.0, coulomb=0.0, viscous=0.0, bristle_damping=0.0)
    initial = struck(position, velocity, start, start)
    run = simulate(Model(parameters=rig), np.zeros(60), initial=initial, substeps=CONVERGED)
    stored: Array = 0.5 * rig.moving_mass * run["velocity"] ** 2
    volumes = np.array([chamber_volumes(x, rig) for x in run["position"]]).T
    fraction = np.linspace(0.0, 1.0, 2001)[:, None]
    for pressure, volume in zip((run["pressure_1"], run["pressure_2"]), volumes, strict=True):
        p = np.maximum(pressure, 0.0)
        # What the chamber grows by as it is let down to no pressure, times the pressure then.
        grown = volume * (mixture(p, ONE, rig) / mixture(fraction * p, ONE, rig) - 1.0)
        stored = stored + p * np.trapezoid(grown, fraction, axis=0)
    assert np.diff(stored).max() <= 1e-3 * max(0.5 * rig.moving_mass * velocity**2, 1e-4)


def test_the_default_step_resolves_aerated_oil_to_a_tenth_of_the_pressures_noise() -> None:
    time = np.arange(3000) * 1e-3
    command = 3.0 * np.sin(2.0 * np.pi * time + 0.1)
    model = Model(parameters=AERATED)
    run = np.stack(list(simulate(model, command).values()), axis=1)
    parted = []
    for start in range(100, 2950, 97):
        piece = command[start : start + 50]
        coarse, fine = (
            simulate(model, piece, initial=run[start], substeps=substeps)["pressure_1"]
            for substeps in (SUBSTEPS, CONVERGED)
        )
        parted.append(np.abs(coarse - fine).max())
    assert np.quantile(parted, 0.9) < 0.1 * DATA_SHEET.pressure_noise
