"""What a search names on rigs that are the model but for what is hidden in them."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from estimator.gap.plant.interface import Array, Trace
from estimator.gap.plant.records import Record, made_of, record_of
from estimator.gap.prediction.fit import Filtered, Fitted, Fitter
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.variables import Values
from estimator.gap.search.findings import Found, Named, Screened
from estimator.gap.search.refits import Refits
from estimator.gap.search.rivals import Rivals
from estimator.gap.search.screening import Screening
from estimator.gap.search.search import Search
from estimator.gap.servo.effects import EFFECTS, NOT_TOLD_APART
from estimator.gap.servo.proposals import propose_end_stop
from estimator.gap.verdict.intervals import form_error
from rig.plant import CATALOGUE
from tests.estimator.gap.courses import fitter, recorded, rig
from tools.worked_gap_example.trials import (
    CASES,
    hiding,
    recorded as steps_of_hidden_rig,
    recording_of,
)

RIVALS = (
    "spool_null_bias", "valve_flow_asymmetry", "command_delay", "internal_leakage",
    "return_back_pressure", "pressure_1_bias", "coulomb_level",
)  # fmt: skip


def search(effects: Collection[str], hidden: dict[str, float]) -> Found:
    """Search for effects of a choice in two records of a rig with hidden values."""
    plant = rig(effects)
    values = {**plant.nominal, **hidden}
    records = [recorded(plant, values, seed=seed) for seed in (0, 1)]
    with fitter(plant, *records) as of_records:
        return Search(of_records).run()


def named(found: Found) -> list[str]:
    return [effect.effect for effect in found.named]


def test_a_rig_that_is_the_model_lacks_nothing() -> None:
    assert named(search(RIVALS, {})) == []


@pytest.mark.parametrize(
    ("parameter", "value"),
    [
        ("command_delay", 3.4e-3),
        pytest.param("spool_null_bias", 6e-6, marks=pytest.mark.long),
        pytest.param("pressure_1_bias", -2.5e5, marks=pytest.mark.long),
    ],
)
def test_what_is_hidden_is_named_and_sized(parameter: str, value: float) -> None:
    found = search(RIVALS, {parameter: value})
    assert named(found) == [parameter]
    assert found.fitted.values[parameter] == pytest.approx(value, rel=0.03)
    assert found.fitted.cost < 0.9 * found.refitted.cost


def test_an_effect_far_from_the_model_given_is_tried_from_far_values_of_its_own() -> None:
    plant = rig(("presliding_compliance",))
    soft = {**plant.nominal, "bristle_stiffness": 1.5e6}
    with fitter(plant, recorded(plant, soft, seed=0)) as of_records:
        filtered = of_records.filtered(plant.nominal)
        (candidate,) = Screening(plant).screen(filtered, plant.nominal, ())
        most = filtered.costs(plant.nominal).sum() - of_records.filtered(soft).costs(soft).sum()
    assert candidate.start["value"] == pytest.approx(2e6)
    assert candidate.gain > 0.5 * most


@pytest.mark.long
def test_two_effects_at_once_are_both_named() -> None:
    hidden = {"internal_leakage": 5e-9, "command_delay": 3e-3}
    found = search(("internal_leakage", "command_delay", "spool_null_bias"), hidden)
    assert sorted(named(found)) == ["command_delay", "internal_leakage"]
    assert found.fitted.values["internal_leakage"] == pytest.approx(5e-9, rel=0.05)


@pytest.mark.long
def test_a_large_effect_is_named_that_gains_only_with_gains_of_its_own() -> None:
    # Rests between long steps: to a filter that shuts the valve there, open edges explain nothing.
    made = steps_of_hidden_rig(hiding(CASES[0], 1), "steps", [1, 2, 1], 30.0)
    recording = recording_of(replace(made, table=made.table[:9000]))
    plant = rig([CASES[0].effect])
    with fitter(plant, record_of(recording, plant)) as of_record:
        found = Search(of_record).run()
    assert named(found) == [CASES[0].effect]
    assert found.fitted.values[CASES[0].effect] == pytest.approx(CASES[0].value, rel=0.02)
    assert found.fitted.cost < 0.2 * found.refitted.cost


def test_a_nuisance_within_its_tolerance_is_refitted_and_never_named() -> None:
    hidden = {"bulk_modulus": 0.9 * 6.89e8, "viscous": 400.0, "supply_pressure": 1.41e7}
    found = search((*RIVALS, "bulk_modulus", "viscous_friction", "supply_pressure"), hidden)
    assert named(found) == []
    for parameter, value in hidden.items():
        assert found.fitted.values[parameter] == pytest.approx(value, rel=0.04)


@pytest.mark.long
def test_a_nuisance_beyond_its_tolerance_is_an_effect_of_that_name() -> None:
    found = search((*RIVALS, "supply_pressure"), {"supply_pressure": 1.1e7})
    assert named(found) == ["supply_pressure"]
    assert found.fitted.values["supply_pressure"] == pytest.approx(1.1e7, rel=0.01)


@pytest.mark.long
def test_forces_that_are_the_same_while_moving_are_named_with_each_other() -> None:
    found = search(("friction_asymmetry", "constant_force"), {"friction_asymmetry": 200.0})
    (effect,) = found.named
    also = {alternative.effect for alternative in effect.alternatives}
    assert {effect.effect, *also} == {"friction_asymmetry", "constant_force"}
    assert max(alternative.share for alternative in effect.alternatives) > 0.5


@pytest.mark.long
def test_a_pumps_ripple_is_found_by_its_line() -> None:
    hidden = {
        "supply_ripple": 3e5, "supply_ripple_frequency": 47.3, "supply_ripple_phase": 1.2,
    }  # fmt: skip
    found = search((*RIVALS, "supply_ripple"), hidden)
    assert named(found) == ["supply_ripple"]
    for parameter, value in hidden.items():
        assert found.fitted.values[parameter] == pytest.approx(value, rel=0.1)


def stopped(values: dict[str, float]) -> Record:
    """Return a record of a rig that now and then is pressed against a stop inside its stroke."""
    plant = rig(())
    time = np.arange(6000) * 1e-3
    course = 0.3 + np.where(np.sin(3.0 * time) > 0.0, -0.07, 0.03)
    readings = np.column_stack([course, *np.full((2, len(time)), 6.9e6), np.zeros(len(time))])
    asked = made_of("course", np.zeros((len(time), 1)), readings, plant)
    gentle = replace(plant, steering=((0, 0, 40.0),))
    return Predictor(gentle).twin(asked, {**plant.nominal, **values}, 0)


def test_a_stop_inside_the_stroke_is_found_where_the_force_begins_to_grow() -> None:
    plant = rig(())
    record = stopped({"stop_low": 0.26, "stop_stiffness": 7e6})
    predictor = Predictor(plant)
    gains = predictor.filter(record, plant.nominal)
    innovations, states = predictor.innovations(record, gains, plant.nominal)
    starts = propose_end_stop(
        [Trace(record.inputs, states, innovations, record.readings)], plant.nominal
    )
    low = [start for start in starts if "low" in start]
    assert low
    assert min(abs(start["low"] - 0.26) for start in low) < 3e-4
    assert min(start["stiffness"] for start in low) < 7e6 < max(s["stiffness"] for s in low)


def test_every_effect_of_the_catalogue_can_be_searched_for() -> None:
    assert set(EFFECTS) == set(CATALOGUE)
    for name, effect in EFFECTS.items():
        assert effect.equation == CATALOGUE[name].equation
        bounds = {knob.name: (knob.lower, knob.upper) for knob in CATALOGUE[name].parameters}
        for knob in effect.knobs:
            lower, upper = bounds[knob.key]
            assert lower <= knob.lower < knob.upper <= upper
            assert not knob.logarithmic or knob.lower > 0.0


def test_reasons_are_given_for_pairs_of_the_catalogue_only() -> None:
    for pair, why in NOT_TOLD_APART.items():
        assert len(pair) == 2
        assert pair <= set(CATALOGUE)
        assert why


def test_a_plant_that_a_value_breaks_is_no_candidate_and_no_crash() -> None:
    plant = rig(("spool_null_bias",))
    record = recorded(plant, plant.nominal, seconds=2.0)
    with fitter(plant, record) as of_record:
        filtered = of_record.filtered(plant.nominal)
        broken = {**plant.nominal, "piston_area": float("nan")}
        assert np.all(filtered.costs(broken) >= 1e299)
        variables = Refits(of_record).nuisances
        assert filtered.fit(broken, variables).cost >= 1e299


@pytest.mark.parametrize(
    ("value", "before", "error"),
    [(2e-3, 0.0, 1e-5), (960.0, 760.0, 1.0), (0.0, 4.0, 0.02), (0.02, 1e3, 1e-4)],
    ids=["from nothing", "a shift", "to nothing", "a limit"],
)
def test_the_form_of_an_effect_is_known_to_half_a_per_cent_of_its_size(
    value: float, before: float, error: float
) -> None:
    assert form_error(value, before) == pytest.approx(error)


def test_what_was_like_an_effect_is_tried_in_the_place_of_the_one_that_replaced_it() -> None:
    class Growing(Search):
        """Screens one effect, and hardly anything on top of the other that replaced it."""

        stages = 0

        def _grow(self, found: Found, seen: Any, names: Any = None, most: int = 4) -> None:
            self.stages += 1
            gain = 7000.0 if self.stages == 1 else 40.0
            found.named = [Named("pressure_2_bias", gain, 1.0, 0.0, 9.0)]
            screened = Screened("pressure_1_bias", {}, gain, 1.0)
            seen.setdefault(screened.effect, []).append(screened)

    class Exchanging(Rivals):
        """Exchanges one effect for another once."""

        times = 0
        tried: Sequence[Screened] = ()

        def exchange(self, found: Found, seen: Mapping[str, Sequence[Screened]]) -> bool:
            self.times += 1
            self.tried = seen["pressure_1_bias"]
            return self.times == 1

    plant = rig(["pressure_1_bias", "pressure_2_bias"])
    with fitter(plant, recorded(plant, plant.nominal, seconds=2.0)) as of_record:
        search = Growing(of_record)
        search.rivals = rivals = Exchanging(search.refits, Screening(plant))
        search.run()
    assert (search.stages, rivals.times) == (3, 2)
    assert max(candidate.gain for candidate in rivals.tried) == 7000.0


@pytest.mark.parametrize("gained", [8e3, 4e5], ids=["astray", "not astray"])
def test_a_model_that_the_gains_found_lead_astray_is_refitted_with_its_own(gained: float) -> None:
    with_it, without_it = {"value": 1.0}, {"value": 0.0}

    class Course:
        """What a fitter tells of a ram near break-away: without the effect it is let go."""

        predictor = SimpleNamespace(plant=rig(()))

        def filtered(self, values: Mapping[str, float]) -> "WithGains":
            return WithGains(values)

    class WithGains:
        """That course with the gains of some values."""

        def __init__(self, values: Mapping[str, float]) -> None:
            self.values = values

        def at(self, values: Mapping[str, float]) -> "WithGains":
            return WithGains(values)

        def costs(self, values: Mapping[str, float]) -> Array:
            if values == with_it:
                return np.array([9e4])
            return np.array([9e4 + (gained if self.values == without_it else 1e6)])

        def fit(self, values: Mapping[str, float], *_: object) -> Fitted:
            return Fitted(dict(values), self.costs(values))

    refits = Refits(cast("Fitter", Course()))
    rivals = Rivals(refits, Screening(refits.plant))
    filtered = refits.fitter.filtered(with_it)
    present = Fitted(with_it, filtered.costs(with_it))
    found = Found(present, present, present, filtered, (), [])
    lost = rivals.lost(found, (), Fitted(without_it, filtered.costs(without_it)))
    if gained > 1e5:
        assert lost is None
    else:
        assert lost is not None
        own, gains_of = lost
        assert own.cost == 9e4 + gained
        assert gains_of.values == without_it


@pytest.mark.parametrize(
    ("scale", "first"), [(1.0, "valve_deadband"), (100.0, "spool_null_bias")], ids=["near", "far"]
)
def test_effects_that_all_leave_the_model_far_off_are_compared_with_gains_of_their_own(
    scale: float, first: str
) -> None:
    """Those of a model that is far off favour what is wrong as well as what is right."""
    with_gains_given = {"valve_deadband": 0.90, "spool_null_bias": 0.93, "constant_force": 2.0}
    with_own = {"valve_deadband": 1.1, "spool_null_bias": 0.4, "constant_force": 0.1}
    readings = 1000

    class Weighing(Refits):
        """Knows what is left a reading with each effect."""

        def with_effect(
            self, filtered: Filtered, values: Values, variables: object, candidate: Screened
        ) -> Fitted:
            return self._left(with_gains_given[candidate.effect])

        def with_own_gains(
            self, filtered: Filtered, values: Values, variables: object, candidate: Screened
        ) -> Fitted:
            return self._left(with_own[candidate.effect])

        def _left(self, share: float) -> Fitted:
            return Fitted({}, np.full(10, share * scale * readings / 10))

    class Searching(Search):
        """Takes nothing for chance."""

        def _chance(self, found: Found, effects: Sequence[str]) -> dict[str, float]:
            return {}

    told = SimpleNamespace(predictor=SimpleNamespace(plant=rig(with_own)))
    search = Searching(cast("Fitter", told))
    search.refits = Weighing(search.fitter)
    before = Fitted({}, np.full(10, 2.5 * scale * readings / 10))
    screened = [Screened(name, {}, 0.5 * scale * readings, 1.0) for name in with_own]
    filtered: Any = SimpleNamespace(samples=readings)
    filtered.at = lambda _: filtered
    found = Found(before, before, before, filtered, (), [])
    added = search._next(found, screened)
    assert added is not None
    assert added[0].name == first
