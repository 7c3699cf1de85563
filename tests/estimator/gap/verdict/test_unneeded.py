"""Effects that the model that was chosen does not need are given up."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from estimator.gap.plant.interface import Effect, Knob
from estimator.gap.search.discovery import DiscoveredModel, Discovery
from estimator.gap.search.findings import Found, Named
from estimator.gap.verdict import unneeded
from estimator.gap.verdict.choosing import Choice
from estimator.gap.verdict.unneeded import without_unneeded
from tests.estimator.gap.verdict.test_choosing import FLOOR, READINGS, discovery, fit

GIVEN = {"drag": 1.0, "weight": 0.0}


class Search:
    """Stands for `Search`: it gives up what gains too little, and what it is told to."""

    def __init__(self, idle: str = "") -> None:
        knobs = {name: Knob("value", name, 0.1, -10.0, 10.0) for name in GIVEN}
        effects = {name: Effect(name, "", "force", (knob,)) for name, knob in knobs.items()}
        self.plant = SimpleNamespace(effects=effects, nominal=GIVEN)
        self._idle = idle

    def eliminate(self, found: Found) -> None:
        for named in [each for each in found.named if each.effect == self._idle]:
            self.give_up(found, named)

    def give_up(self, found: Found, named: Named) -> None:
        found.named.remove(named)
        found.variables = tuple(each for each in found.variables if each != named.effect)  # type: ignore[comparison-overlap]


def chosen(
    search: Search, monkeypatch: pytest.MonkeyPatch, weight: float, *beside: Discovery,
    gains: tuple[float, float] = (9000.0, 1000.0),
) -> tuple[list[str], Choice]:  # fmt: skip
    """Return what is named, and the choice, of a drag of 2 and a weight that is so many sure.

    The model with both leaves 400, and `gains` is what drag and weight explain, in cost.
    """
    variables: Any = tuple(GIVEN)
    filtered: Any = None
    model = DiscoveredModel(fit(0.1, drag=2.0, weight=weight), filtered, variables, list(beside))
    given = Choice(model, True, {"weight": beside[0]} if beside else {}, beside[1:])
    named = [
        Named(name, gain, gain / READINGS, 25.0, 10.0)
        for name, gain in zip(GIVEN, gains, strict=True)
    ]
    found = Found(fit(10.0), fit(10.0), model.fitted, filtered, variables, named, FLOOR, READINGS)
    errors = {"drag": 0.1, "weight": 1.0}
    monkeypatch.setattr(unneeded, "standard_errors", lambda search, found: errors)
    stands_for: Any = search
    discovering: Any = SimpleNamespace(settled=lambda model: model)
    choice = without_unneeded(stands_for, discovering, found, given)
    names = [each.effect for each in found.named]
    assert [str(each) for each in choice.model.variables] == names
    return names, choice


def test_an_effect_whose_interval_holds_the_value_given_is_given_up_and_one_beyond_it_is_not(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert chosen(Search(), monkeypatch, -1.5)[0] == ["drag"]
    assert chosen(Search(), monkeypatch, -2.5)[0] == ["drag", "weight"]


def test_what_corrected_an_effect_that_is_given_up_is_told_as_a_disturbance(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    curves = discovery("position"), discovery("velocity")
    names, choice = chosen(Search(), monkeypatch, 0.0, *curves)
    assert names == ["drag"]
    assert not choice.corrections
    assert choice.discovered == curves


def test_beside_what_was_discovered_each_effect_must_earn_its_place_anew(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert chosen(Search("weight"), monkeypatch, 9.0, discovery("position"))[0] == ["drag"]
    assert chosen(Search("weight"), monkeypatch, 9.0)[0] == ["drag", "weight"]


def test_an_effect_that_explains_less_than_the_model_leaves_is_given_up(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert chosen(Search(), monkeypatch, 9.0, gains=(9000.0, 410.0))[0] == ["drag", "weight"]
    assert chosen(Search(), monkeypatch, 9.0, gains=(9000.0, 390.0))[0] == ["drag"]
    # The one that explains most stays, whatever is left.
    assert chosen(Search(), monkeypatch, 9.0, gains=(300.0, 390.0))[0] == ["weight"]


def test_an_effect_explains_what_its_correction_does_as_well(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    correction = replace(discovery("position"), share=0.01)
    names, choice = chosen(Search(), monkeypatch, 9.0, correction, gains=(9000.0, 10.0))
    assert names == ["drag", "weight"]
    assert choice.corrections == {"weight": correction}
