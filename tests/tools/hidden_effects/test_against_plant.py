"""The plant's effects and those of the rig that shares no code with it mean the same."""

from collections.abc import Mapping

import numpy as np
import pytest
from numba import njit
from numpy.typing import NDArray

from rig.plant import CATALOGUE, Model
from rig.plant.simulation import simulate
from rig.plant.transducer_effects import (
    follow,
    reading_means,
    seen_position,
    seen_pressures,
    transducers,
)
from tests.tools.hidden_effects.test_physics import ran
from tools.hidden_effects import physics
from tools.hidden_effects.menu import with_effects
from tools.hidden_effects.rig_values import TABLE

Array = NDArray[np.float64]
# Through full speed both ways, without the creeping in which any two simulations part.
TIME = np.arange(250) * physics.TICK
COMMAND = np.rint(1e6 * (8.0 * np.sin(2.0 * np.pi * 4.0 * TIME) + 1.5)) * 1e-6
STATES = ("spool", "pressure_1", "pressure_2", "position", "velocity")
OURS = (physics.SPOOL, physics.P1, physics.P2, physics.POSITION, physics.SPEED)
SCALES = np.array([1e-6, 3e4, 3e4, 1e-5, 1e-2])

EFFECTS: Mapping[str, Mapping[str, float]] = {
    "spool_null_bias": {"value": 2e-5},
    "valve_deadband": {"value": 2e-5},
    "valve_underlap_leakage": {"value": 2e-5},
    "valve_flow_asymmetry": {"value": 0.2},
    "valve_hysteresis": {"value": 1e-5},
    "valve_bandwidth": {"value": 300.0},
    "valve_rate_limit": {"value": 5e-3},
    "command_delay": {"value": 4.3e-3},
    "entrained_air": {"value": 0.03},
    "bulk_modulus": {"value": 4e8},
    "supply_pressure": {"value": 1e7},
    "supply_droop": {"value": 1e13},
    "supply_ripple": {"amplitude": 5e5, "frequency": 40.0, "phase": 1.0},
    "return_back_pressure": {"value": 1e13},
    "friction_asymmetry": {"value": 300.0},
    "stiction_level": {"value": 3500.0},
    "coulomb_level": {"value": 1800.0},
    "stribeck_velocity": {"value": 0.1},
    "viscous_friction": {"value": 1000.0},
    "presliding_compliance": {"value": 2e6},
    "internal_leakage": {"value": 8e-9},
    "external_leakage_1": {"value": 5e-9},
    "external_leakage_2": {"value": 5e-9},
    "spring_load": {"stiffness": 5e4, "contact": 0.31},
    "constant_force": {"value": 1500.0},
    "payload_mass": {"value": 100.0},
    "end_stop": {"stiffness": 5e6, "high": 0.315},
}
"""Effects of the rig itself, large enough that another meaning would show."""


def both(effects: Mapping[str, Mapping[str, float]]) -> tuple[Array, Array]:
    """Return the motion of the plant and of the independent rig, (n, 5) in units of `SCALES`."""
    model = Model()
    for name, parameters in effects.items():
        model = model.with_effect(name, **parameters)
    plant = simulate(model, COMMAND, substeps=16)
    _, own = ran(with_effects(TABLE, effects), COMMAND)
    return np.stack([plant[name] for name in STATES], axis=1) / SCALES, own[:, OURS] / SCALES


@pytest.fixture(scope="module")
def healthy() -> Array:
    plant, own = both({})
    assert np.sqrt(np.mean((plant - own) ** 2, axis=0)).max() < 1e-3
    return own


@pytest.mark.parametrize("name", EFFECTS)
def test_an_effect_means_the_same(name: str, healthy: Array) -> None:
    plant, own = both({name: EFFECTS[name]})
    shown = np.sqrt(np.mean((own - healthy) ** 2, axis=0))
    apart = np.sqrt(np.mean((plant - own) ** 2, axis=0))
    assert shown.max() > 1.0
    # Air has another formula here, without the share of the volume that bubbles take.
    assert np.all(apart < (0.1 if name == "entrained_air" else 0.02)), (apart, shown)


TRANSDUCERS: Mapping[str, Mapping[str, float]] = {
    "pressure_1_bias": {"value": 3e5},
    "pressure_2_bias": {"value": -3e5},
    "pressure_1_gain": {"value": 0.9},
    "pressure_2_gain": {"value": 1.1},
    "pressure_lag": {"value": 0.01},
    "position_gain": {"value": 0.95},
    "position_delay": {"value": 7.4e-3},
    "position_backlash": {"value": 1e-3},
}


@njit(error_model="numpy")
def _read(parameters, states, seen):  # type: ignore[no-untyped-def]
    """Return what the plant's transducers make of states (n, 9): position, both pressures."""
    found = np.empty((states.shape[0], 3))
    for tick in range(states.shape[0]):
        state = states[tick]
        if tick > 0:
            follow(seen, state, parameters)
        p1, p2 = seen_pressures(seen, state[2], state[3], parameters)
        position = seen_position(seen, state[4], parameters)
        means = reading_means(position, p1, p2, state[0], state[7], parameters)
        found[tick] = (means.position, means.pressure_1, means.pressure_2)
    return found


def test_every_effect_of_the_catalogue_is_compared() -> None:
    assert set(EFFECTS) | set(TRANSDUCERS) == set(CATALOGUE)


@pytest.mark.parametrize("name", TRANSDUCERS)
def test_a_transducer_with_an_effect_reads_the_same(name: str) -> None:
    readings, truth = ran(with_effects(TABLE, {name: TRANSDUCERS[name]}), COMMAND)
    parameters = Model().with_effect(name, **TRANSDUCERS[name]).parameters
    order = [*OURS[:1], physics.SPOOL_SPEED, *OURS[1:], physics.BEND, physics.SUPPLY, physics.TANK]
    states = truth[:, order]
    plant = _read(parameters, np.ascontiguousarray(states), transducers(parameters, states[0]))
    bare = truth[:, [physics.POSITION, physics.P1, physics.P2]]
    scales = np.array([physics.COUNT, 3e4, 3e4])
    assert (np.abs(readings[:, 1:4] - bare).max(axis=0) / scales).max() > 5.0
    # Our encoder counts, the plant's position is the one before that; and the plant sees its state
    # once a millisecond here.
    apart = np.abs(readings[:, 1:4] - plant).max(axis=0) / scales
    assert apart[0] < 1.0
    assert apart[1:].max() < 0.2
