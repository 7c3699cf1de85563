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
    "friction_asymmetry": ({"value": 300.0}, "position", -1.0),
    "entrained_air": ({"value": 0.02}, "pressure_1", 0.0),
    "internal_leakage": ({"value": 2e-8, "linear": 1e-12}, "velocity", 0.0),
    "external_leakage_1": ({"value": 2e-8, "linear": 1e-12}, "pressure_1", -1.0),
    "external_leakage_2": ({"value": 2e-8, "linear": 1e-12}, "pressure_2", -1.0),
    "spring_load": ({"stiffness": 2e4, "contact": 0.3}, "position", -1.0),
    "supply_pressure": ({"value": 1.2e7}, "supply_pressure", -1.0),
    "supply_droop": ({"value": 5e12}, "supply_pressure", -1.0),
    "return_back_pressure": ({"value": 5e12}, "return_pressure", +1.0),
}
EACH_EFFECT = pytest.mark.parametrize("name", CATALOGUE)


def run(model: Model) -> dict[str, Array]:
    return simulate(model, COMMAND, position=0.3)


def test_every_effect_of_the_catalogue_is_tried() -> None:
    assert ACTING.keys() == CATALOGUE.keys()


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


@EACH_EFFECT
def test_an_effect_switched_on_acts(name: str) -> None:
    values, state, direction = ACTING[name]
    model = Model().with_effect(name, **values)
    assert model.effects == (name,)
    change = run(model)[state] - run(Model())[state]
    assert np.abs(change).max() > 0.0
    if direction:
        assert direction * change.mean() > 0.0


@EACH_EFFECT
def test_each_parameter_of_an_effect_acts_by_itself(name: str) -> None:
    plain = run(Model())
    values, state, _ = ACTING[name]
    for key, value in values.items():
        if key == "contact":  # of a spring: where it stands matters once it has a stiffness
            continue
        assert (run(Model().with_effect(name, **{key: value}))[state] != plain[state]).any()


@EACH_EFFECT
def test_an_effects_parameters_are_the_rigs_with_defaults_within_their_range(name: str) -> None:
    known = quantities()
    for parameter in CATALOGUE[name].parameters:
        quantity = known[parameter.field]
        assert quantity.lower <= getattr(NOMINAL, parameter.field) <= quantity.upper
        assert quantity.source


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
