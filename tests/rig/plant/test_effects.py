"""Every effect of the catalogue is absent at its defaults, to the last bit, and acts when on."""

from typing import Final

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.plant import CATALOGUE, KARNOPP, NOMINAL, Model, Parameters, quantities
from rig.plant.simulation import simulate

Array = NDArray[np.float64]

TIME: Final = np.arange(1500) * 1e-3
COMMAND: Final = 4.0 * np.sin(2.0 * np.pi * TIME)

# Values at which the effect shows, and how: mean change of the state named, with its sign.
ACTING: Final[dict[str, tuple[dict[str, float], str, float]]] = {
    "spool_null_bias": ({"value": 5e-6}, "position", +1.0),
    "valve_deadband": ({"value": 1e-5}, "pressure_1", 0.0),
    "valve_underlap_leakage": ({"value": 1e-5}, "pressure_1", 0.0),
    "valve_flow_asymmetry": ({"value": 0.1}, "pressure_2", 0.0),
    "valve_hysteresis": ({"value": 1e-5}, "spool", 0.0),
    "valve_bandwidth": ({"value": 400.0}, "spool", 0.0),
    "valve_rate_limit": ({"value": 5e-4}, "spool", 0.0),
    "command_delay": ({"value": 0.0034}, "spool", 0.0),
    "entrained_air": ({"value": 0.02}, "pressure_1", 0.0),
    "bulk_modulus": ({"value": 5e8}, "pressure_1", 0.0),
    "supply_pressure": ({"value": 1.2e7}, "supply_pressure", -1.0),
    "supply_droop": ({"value": 5e12}, "supply_pressure", -1.0),
    "supply_ripple": ({"amplitude": 3e5, "frequency": 100.0, "phase": 1.0}, "supply_pressure", 0.0),
    "return_back_pressure": ({"value": 5e12}, "return_pressure", +1.0),
    "friction_asymmetry": ({"value": 300.0}, "position", -1.0),
    "stiction_level": ({"value": 3.2e3}, "velocity", 0.0),
    "coulomb_level": ({"value": 1.5e3}, "velocity", 0.0),
    "stribeck_velocity": ({"value": 0.02}, "velocity", 0.0),
    "viscous_friction": ({"value": 1e3}, "velocity", 0.0),
    "presliding_compliance": ({"value": 5e6}, "friction_state", 0.0),
    "internal_leakage": ({"value": 2e-8, "linear": 1e-12}, "velocity", 0.0),
    "external_leakage_1": ({"value": 2e-8, "linear": 1e-12}, "pressure_1", -1.0),
    "external_leakage_2": ({"value": 2e-8, "linear": 1e-12}, "pressure_2", -1.0),
    "spring_load": ({"stiffness": 2e4, "contact": 0.3}, "position", -1.0),
    "constant_force": ({"value": 2e3}, "position", -1.0),
    "payload_mass": ({"value": 200.0}, "velocity", 0.0),
    "end_stop": ({"stiffness": 2e6, "low": 0.31, "high": 0.32}, "position", 0.0),
}
OF_READINGS: Final = frozenset(
    effect for effect in CATALOGUE if effect.startswith(("pressure_", "position_"))
)
"""Effects of the transducers, which leave the true states as they are (`test_transducers.py`)."""
NEEDS: Final = {
    ("spring_load", "contact"): {"stiffness": 2e4},
    ("supply_ripple", "frequency"): {"amplitude": 3e5},
    ("supply_ripple", "phase"): {"amplitude": 3e5},
    ("end_stop", "stiffness"): {"high": 0.32},
}
"""What a parameter needs beside it to act: a spring its stiffness, a stop to be in the way."""
EFFECTS_OF_STATES: Final = pytest.mark.parametrize("name", ACTING)
EACH_EFFECT = pytest.mark.parametrize("name", CATALOGUE)


def run(model: Model) -> dict[str, Array]:
    return simulate(model, COMMAND, position=0.3)


def test_every_effect_of_the_catalogue_is_tried() -> None:
    assert ACTING.keys() | OF_READINGS == CATALOGUE.keys()
    assert len(CATALOGUE) == 35


@EACH_EFFECT
@pytest.mark.parametrize("law", [0.0, KARNOPP], ids=["bristle", "karnopp"])
def test_an_effect_at_its_defaults_changes_no_bit(name: str, law: float) -> None:
    model = Model(parameters=NOMINAL._replace(friction_law=law))
    neutral = {
        parameter.name: getattr(Parameters(), parameter.field)
        for parameter in CATALOGUE[name].parameters
    }
    plain, extended = run(model), run(model.with_effect(name, **neutral))
    assert all((plain[state] == extended[state]).all() for state in plain)


@EFFECTS_OF_STATES
def test_an_effect_switched_on_acts(name: str) -> None:
    values, state, direction = ACTING[name]
    model = Model().with_effect(name, **values)
    assert model.effects == (name,)
    change = run(model)[state] - run(Model())[state]
    assert np.abs(change).max() > 0.0
    if direction:
        assert direction * change.mean() > 0.0


@EFFECTS_OF_STATES
def test_each_parameter_of_an_effect_acts_by_itself(name: str) -> None:
    values, state, _ = ACTING[name]
    for key, value in values.items():
        needed = NEEDS.get((name, key), {})
        without, by_itself = Model().with_effect(name, **needed), {**needed, key: value}
        assert (run(Model().with_effect(name, **by_itself))[state] != run(without)[state]).any()


def test_a_coulomb_level_takes_the_stiction_along_and_a_stiction_level_nothing() -> None:
    shifted = Model().with_effect("coulomb_level", value=2.0 * NOMINAL.coulomb).parameters
    assert shifted == NOMINAL._replace(coulomb=2.0 * NOMINAL.coulomb, stiction=4.8e3)
    alone = Model().with_effect("stiction_level", value=3e3).parameters
    assert alone == NOMINAL._replace(stiction=3e3)


@EACH_EFFECT
def test_an_effects_parameters_are_the_rigs_with_defaults_within_their_range(name: str) -> None:
    known = quantities()
    for parameter in CATALOGUE[name].parameters:
        quantity = known[parameter.field]
        assert quantity.lower <= getattr(NOMINAL, parameter.field) <= quantity.upper
        assert quantity.source
        assert quantity.lower <= parameter.lower <= parameter.neutral <= parameter.upper
        assert parameter.upper <= quantity.upper


def test_every_default_lies_within_its_plausible_range() -> None:
    for name, quantity in quantities().items():
        assert quantity.lower <= getattr(NOMINAL, name) <= quantity.upper, name


def test_switching_an_effect_on_twice_lists_it_once() -> None:
    model = Model().with_effect("supply_droop", value=1e12)
    assert model.with_effect("supply_droop", value=2e12).effects == ("supply_droop",)
    assert model.with_effect("supply_droop", value=2e12).parameters.supply_droop == 2e12


def test_an_effect_or_parameter_that_the_catalogue_lacks_is_refused() -> None:
    with pytest.raises(KeyError):
        Model().with_effect("magnetism", value=1.0)
    with pytest.raises(KeyError):
        Model().with_effect("supply_droop", amount=1.0)
