"""A disturbance in symbols becomes a part of the rig's model, refitted; what cannot be is told."""

import numpy as np
import pytest

from estimator.gap.plant.interface import Plant
from estimator.gap.plant.terms import Term
from estimator.gap.prediction.variables import Values
from estimator.gap.search.disturbances import places_of
from estimator.gap.search.findings import Found
from estimator.gap.search.refits import Refits
from estimator.gap.servo.terms import hold_terms
from estimator.gap.verdict.unknown import Unknown, _Forward
from estimator.gap.verdict.with_term import terms_in_words, with_term
from rig.plant.added_terms import AddedTerm, fields_of
from tests.estimator.gap.courses import fitter, recorded, rig

FORCE = "force balance"


def unknown(plant: Plant, place: str, terms: tuple[Term, ...], *coefficients: float) -> Unknown:
    (found,) = (each for each in places_of(plant) if each.name == place)
    sizes = np.array(coefficients)
    return Unknown(found, terms, sizes, 0.1 * np.abs(sizes), 1e3, 0.9)


def test_terms_in_the_model_read_as_they_were_found() -> None:
    plant = rig(())
    terms = (
        Term("position", "wave", "", (0.042,)),
        Term("velocity", "x |x|"),
        Term("position", "bump", "direction", (0.3, 0.02)),
    )
    found = unknown(plant, FORCE, terms, 120.0, -90.0, 9e3, 400.0)
    held = hold_terms(FORCE, terms, found.coefficients, plant.nominal)
    assert held.refused == ()
    assert len(held.knobs) == 3 + 1 + 3
    assert terms_in_words(plant, held.values) == found.text(plant)


@pytest.mark.parametrize(
    ("place", "term", "why"),
    [
        ("flow, chamber 1", Term("", "1", "time"), "time since the recording began"),
        ("reading of position_m", Term("position", "wave", "", (0.02,)), "an error of the reading"),
        ("parameter viscous", Term("position", "x"), "do not enter the parameter viscous"),
    ],
)
def test_what_a_simulation_cannot_know_is_told_and_not_left_out_in_silence(
    place: str, term: Term, why: str
) -> None:
    plant = rig(())
    held = hold_terms(place, (term,), np.ones(term.columns), plant.nominal)
    assert held.values == {}
    ((number, reason),) = held.refused
    assert number == 0
    assert why in reason


def test_a_drag_in_symbols_is_refitted_in_the_model_and_explains_the_recording() -> None:
    plant = rig(())
    true = AddedTerm(FORCE, "velocity", "x |x|", False, 9e3)
    record = recorded(plant, {**plant.nominal, **fields_of((true,))})
    with fitter(plant, record) as of_record:
        refits = Refits(of_record)
        refitted, filtered = refits.settled(plant.nominal, refits.nuisances)
        found = Found(
            refitted, refitted, refitted, filtered, refits.nuisances, [], 1.0, filtered.samples
        )
        guess = unknown(plant, FORCE, (Term("velocity", "x |x|"),), 5e3)
        added, said = with_term(refits, found, guess)
    assert said == []
    assert added is not None
    (size,) = added.estimates
    assert size.unit == "N/(m/s)^2"
    assert size.value == pytest.approx(9e3, rel=0.1)
    assert added.explained > 0.9


def test_a_filter_whose_model_has_the_hidden_table_of_force_follows_the_rig() -> None:
    plant = rig(())
    knots = ((-0.2, -400.0), (-0.1, -60.0), (0.0, 0.0), (0.05, 150.0), (0.2, 250.0))
    table = AddedTerm(FORCE, "velocity", "table", False, 1.0, knots=knots)
    informed = {**plant.nominal, **fields_of((table,))}

    def cost(truth: Values, assumed: Values) -> float:
        with fitter(plant, recorded(plant, truth)) as of_record:
            return float(of_record.filtered(assumed).costs(assumed).sum())

    usual = cost(plant.nominal, plant.nominal)
    assert cost(informed, informed) < 1.1 * usual
    assert cost(informed, plant.nominal) > 1.5 * usual


def test_a_fitted_parameter_without_effect_does_not_keep_terms_from_being_chosen() -> None:
    rng = np.random.default_rng(0)
    innovations = rng.standard_normal((8, 50))
    columns = [np.zeros((8, 50)), rng.standard_normal((8, 50)), innovations + 1.0]
    forward = _Forward(np.stack(columns, axis=2), innovations, 2)
    left = float(np.square(innovations).sum())
    assert forward.choose([0, 1]) == 0.0
    assert forward.certain == 0.0
    assert 0.1 * left < forward.choose([2]) <= left
    assert forward.certain > 4.0


def test_one_block_makes_nothing_certain() -> None:
    forward = _Forward(np.ones((1, 50, 1)), np.full((1, 50), 2.0), 0)
    assert forward.choose([0]) == pytest.approx(200.0)
    assert forward.certain == 0.0
