"""What was fitted is written only if it predicts no worse than the model as given."""

import json
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st

from estimator.gap.plant.interface import Plant
from estimator.gap.plant.records import record_of
from estimator.gap.prediction.fit import Fitter
from estimator.gap.prediction.held_out import channel_gaps, mean_gap
from estimator.gap.prediction.predictor import Predictor
from estimator.gap.prediction.results import GapResult, NamedEffect
from estimator.gap.prediction.variables import nuisance_variable
from estimator.gap.verdict.keeping import (
    TRIFLE,
    Growth,
    Worse,
    changed_since,
    ends_in_words,
    growth,
    take_back,
    why_worse,
)
from estimator.gap.verdict.workflow import find_gap
from rig.recording import Recording
from rig.runner.experiments.gap_results import answer
from tests.estimator.gap.courses import rig
from tests.estimator.gap.wheel import ran, wheel
from tools.hidden_effects.menu import with_effects
from tools.hidden_effects.motions import drawn
from tools.hidden_effects.recordings import COLUMNS, record
from tools.hidden_effects.rig_values import TABLE


def grown(found: GapResult, plant: Plant, recordings: list[Recording]) -> Growth:
    """How much worse the model written predicts recordings than the one given."""
    records = [record_of(recording, plant) for recording in recordings]
    with ThreadPoolExecutor(1) as pool:
        return growth(Fitter(Predictor(plant), records, pool), plant.nominal, found.values)


hidden_wheels = st.fixed_dictionaries(
    {
        "gain": st.floats(3.5, 4.5),
        "drag": st.floats(5.0, 11.0),
        "offset": st.sampled_from([0.0, 0.0, 1.0]),
        "squared": st.sampled_from([0.0, 3.0, 12.0]),
        "lag_s": st.sampled_from([0.0, 6e-3, 30e-3]),
        "late": st.sampled_from([0, 0, 8]),
    }
)


DRAGGED_ALONG = {
    "gain": 4.4992, "drag": 8.9142, "offset": 1.0, "squared": 0.0, "lag_s": 0.0, "late": 0
}  # fmt: skip
"""What takes the refit where slow motion is predicted worse than by the model as given."""


@settings(max_examples=1, deadline=None)
@example(hidden=DRAGGED_ALONG, rate=0.5, seed=2)
@given(hidden=hidden_wheels, rate=st.sampled_from([0.5, 1.0, 2.0]), seed=st.integers(0, 999))
def test_whatever_a_rig_hides_the_model_written_predicts_no_worse_than_the_one_given(
    hidden: dict[str, float], rate: float, seed: int
) -> None:
    plant = wheel()
    fitted, held = ran(seed, 5.0, **hidden), ran(seed + 1, 3.0, rate=rate, **hidden)  # type: ignore[arg-type]
    found = find_gap([fitted], [held], plant)
    assert found.gap_after <= found.gap_before + (TRIFLE if found.effects else 0.0)
    assert not grown(found, plant, [fitted]).matters
    assert not grown(found, plant, [held]).matters
    if found.as_given:
        assert found.values == plant.nominal
        assert found.gap_after == found.gap_before


def hidden_lag(motion: str, number: int) -> Recording:
    """Record a rig whose pressures are read with a lag of 6 ms; its code is not the model's."""
    values = with_effects(TABLE, {"pressure_lag": {"value": 6e-3}})
    asked = drawn(motion, np.random.default_rng([3, number]), 6000)
    table = record(values, asked, np.random.default_rng([3, number, 1])).table
    columns = {name: np.ascontiguousarray(table[:, i]) for i, name in enumerate(COLUMNS)}
    return Recording(columns, source=f"{motion} {number}")


@pytest.fixture(scope="module")
def lagging() -> GapResult:
    """What is found on that rig by a catalogue that has nothing like it, with no discovery."""
    identify = [hidden_lag("sines", 0), hidden_lag("ramps", 1)]
    return find_gap(identify, [hidden_lag("steps", 2)], replace(rig(()), layout=None))


@pytest.mark.long
def test_a_refit_that_predicts_worse_is_told_and_the_model_written_as_given(
    lagging: GapResult,
) -> None:
    assert lagging.verdict == "unknown_effect"
    assert lagging.as_given
    assert lagging.values == rig(()).nominal
    assert lagging.gap_after == lagging.gap_before > 20.0
    told = answer(lagging)
    assert told["written"] == "as given"
    assert not any(each["kept"] for each in told["refitted"].values())
    (said,) = [reason for reason in lagging.reasons if "is written as given" in reason]
    assert "recordings held out would be predicted worse than by the model as given" in said
    json.dumps(told, allow_nan=False)


@pytest.mark.long
def test_refits_that_came_to_the_ends_of_their_tolerances_are_a_warning(
    lagging: GapResult,
) -> None:
    ends = {each.key for each in lagging.refitted if each.at_an_end}
    assert ends == {"bulk_modulus", "viscous"}
    (said,) = [reason for reason in lagging.reasons if "tolerance" in reason]
    assert said.startswith("bulk_modulus and viscous were refitted to the ends of their tolerances")
    assert "something else is wrong" in said


def test_nothing_is_said_of_a_refit_within_its_tolerance() -> None:
    plant = wheel()
    variables = [nuisance_variable(each) for each in plant.nuisances]
    inside = {**plant.nominal, "gain": 4.39, "drag": 5.61}
    assert ends_in_words(variables, inside) == []
    (said,) = ends_in_words(variables, {**inside, "gain": 4.4})
    assert said.startswith("gain was refitted to an end of its tolerance")
    held = [variable.held(inside) for variable in variables]
    assert ends_in_words(held, inside) == []


LOWERED, LEVEL, CHANCE, CERTAIN = (
    Growth(-1.0, 0.1), Growth(0.05, 0.2), Growth(0.5, 0.4), Growth(0.5, 0.2)
)  # fmt: skip


@pytest.mark.parametrize(
    ("held_out", "left", "fitted_to", "refit", "names"),
    [
        (LOWERED, 2.0, LOWERED, "kept", "kept"),
        (LEVEL, 3.0, LEVEL, "kept", "kept"),
        (LEVEL, 3.05, LOWERED, "as given", "kept"),
        (CHANCE, 3.5, LOWERED, "as given", "as given, still named"),
        (CERTAIN, 3.5, LOWERED, "as given", "as given"),
        (LOWERED, 2.0, CHANCE, "kept", "kept"),
        (LOWERED, 2.0, CERTAIN, "as given", "as given"),
    ],
)
def test_a_refit_must_not_raise_the_gap_and_names_fall_if_they_do_so_beyond_chance(
    held_out: Growth, left: float, fitted_to: Growth, refit: str, names: str
) -> None:
    plant = wheel()
    for named, expected in ((False, refit), (True, names)):
        worse = why_worse(held_out, (3.0, left), fitted_to, named=named)
        result = GapResult("adequate", [], values={**plant.nominal, "gain": 4.2})
        if named:
            result.verdict, result.names = "missing_effect", ("offset",)
            result.effects = [NamedEffect("offset", "", "force", (), 1e3, 25.0, 9.0)]
        if worse is not None:
            take_back(result, plant, "this", worse)
        assert result.as_given is (expected != "kept")
        assert (result.values == plant.nominal) is result.as_given
        assert bool(result.effects) is (named and expected != "as given")
        assert (result.verdict == "unknown_effect") is (named and expected == "as given")


def test_a_model_that_predicts_nothing_finite_is_worse_than_one_that_does() -> None:
    plant = wheel()
    records = [record_of(ran(1, 3.0), plant)]
    fine, broken = plant.nominal, {**plant.nominal, "drag": -1e6}
    with ThreadPoolExecutor(1) as pool, np.errstate(all="ignore"):
        fitter = Fitter(Predictor(plant), records, pool)
        assert growth(fitter, fine, broken).mean == np.inf
        assert not growth(fitter, broken, fine).matters
        same = growth(fitter, fine, fine)
    assert (same.mean, same.error) == (0.0, 0.0)
    said = why_worse(Growth(np.inf, 0.0), (np.nan, np.nan), named=True)
    assert said == Worse("the recordings held out could not be predicted at all", True)


def told(**held_out: float) -> list[str]:
    """Return what is told of a model that is right in all but what the wheel held out is."""
    plant = wheel()
    predictor, records = Predictor(plant), [record_of(ran(5, 6.0, **held_out), plant)]  # type: ignore[arg-type]
    with ThreadPoolExecutor(1) as pool:
        left = mean_gap(channel_gaps(predictor, records, plant.nominal, plant.nominal, pool))[1]
        return changed_since(Fitter(predictor, records, pool), plant.nominal, (10.0 * left, left))


def test_a_drag_that_changed_since_is_told_by_how_much() -> None:
    (said,) = told(drag=9.2)
    assert "drag 15.3% more" in said
    assert "the machine was not quite the same there" in said


def test_of_a_rig_that_is_the_same_nothing_is_told() -> None:
    assert told() == []


def test_of_what_no_nuisance_takes_away_nothing_is_told() -> None:
    assert told(offset=1.0, late=2) == []
