"""Which answer is chosen: effects of the catalogue, disturbances alone, or both."""

from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.gap.plant.additions import Addition
from estimator.gap.plant.interface import Effect, Knob, Likeness
from estimator.gap.prediction.fit import Fitted
from estimator.gap.search.discovery import DiscoveredModel, Discovery
from estimator.gap.search.findings import MATERIAL, Found, Named
from estimator.gap.verdict.choosing import Choice, choose

BLOCKS, READINGS = 40, 4000
FLOOR = 1.0


def fit(excess: float, **values: float) -> Fitted:
    """Return a fit whose cost is so many variances a reading above the floor."""
    cost = (FLOOR + excess) * READINGS / BLOCKS
    return Fitted({"drag": 1.0, "weight": 0.0, **values}, np.full(BLOCKS, cost))


def effect(name: str, own: tuple[tuple[str, str], ...], like: Any = ()) -> Effect:
    knob = Knob("value", name, 0.1, -10.0, 10.0)
    return Effect(name, "", "force", (knob,), own=own, like=like)


def discovery(of: str) -> Discovery:
    addition = Addition("force", of, "", "table", (0.0, 1.0), (2.0, 3.0))
    empty: Mapping[str, float] = {}
    return Discovery(None, addition, (0.1, 0.1), (), 1.0, empty, empty, (0.0, 1.0))  # type: ignore[arg-type]


class Discovers:
    """Stands for `Discovering`: it finds what it is told to, with effects and without."""

    nuisances = ()

    def __init__(self, effects: list[Effect], alone: Any, beside: Any, solo: Any = None) -> None:
        nominal = {"drag": 1.0, "weight": 0.0}
        self.plant = SimpleNamespace(
            effects={e.name: e for e in effects}, nominal=nominal, varying=()
        )
        self._alone, self._beside, self._solo = alone, beside, solo or {}
        self.runs = 0
        self.only: Any = None

    def run(
        self, fitted: Any, variables: Any, floor: float, most: int = 3, only: Any = None,
        begun: Any = None,
    ) -> Any:  # fmt: skip
        self.runs += 1
        self.only = only
        left, of = self._beside if variables else self._alone
        found = [discovery(name) for name in of]
        return DiscoveredModel(fit(left), None, variables, found, tuple(d.addition for d in found))  # type: ignore[arg-type]

    def filtered(self, values: Any) -> Any:
        return values

    def with_effect(self, filtered: Any, effect: Effect) -> Any:
        return fit(self._solo[effect.name]), (effect.name,)


def found(left: float, *names: str, **values: float) -> Found:
    """Return a finding: 10 variances a reading to explain, of which the effects leave `left`."""
    named = [Named(name, 100.0, 1.0, 25.0, 10.0) for name in names]
    refitted = fit(10.0)
    made = Found(refitted, refitted, fit(left, **values), None, names, named)  # type: ignore[arg-type]
    made.floor, made.samples = FLOOR, READINGS
    return made


def chosen(discovers: Discovers, finding: Found) -> tuple[Choice, list[str]]:
    choice = choose(discovers, finding, MATERIAL)  # type: ignore[arg-type]
    return choice, [each.effect for each in finding.named] if choice.named else []


DRAG = effect("drag", (("force", "velocity"),))
WEIGHT = effect("weight", (("force", ""), ("force", "position")))


def test_effects_that_leave_nothing_are_the_answer_and_nothing_is_looked_for() -> None:
    discovers = Discovers([DRAG], (0.0, ["position"]), (0.0, []))
    choice, names = chosen(discovers, found(0.005, "drag"))
    assert names == ["drag"]
    assert not choice.discovered
    assert discovers.runs == 0


def test_one_disturbance_that_leaves_nothing_wins_over_effects_that_leave_something() -> None:
    """Three kinds of friction explain 98 %, one curve against the position explains it all."""
    discovers = Discovers([DRAG, WEIGHT], (0.01, ["pressure"]), (0.2, []))
    choice, names = chosen(discovers, found(0.2, "drag", "weight"))
    assert not names
    assert [each.addition.of for each in choice.discovered] == ["pressure"]


def test_one_effect_that_explains_most_keeps_its_name_and_is_corrected_by_its_own_curve() -> None:
    discovers = Discovers([DRAG], (0.01, ["velocity"]), (0.01, ["velocity"]))
    choice, names = chosen(discovers, found(0.5, "drag"))
    assert names == ["drag"]
    assert list(choice.corrections) == ["drag"]
    assert not choice.discovered


@pytest.mark.parametrize(
    ("left", "alone", "of", "named"),
    [
        (2.7, 1.5, "velocity", True),  # 73 % and 85 %: most of what is known is the formula
        (2.7, 1.5, "position", False),
        (3.5, 2.5, "velocity", False),  # the curve itself explains 75 % only
        (
            4.0,
            1.5,
            "velocity",
            False,
        ),  # the formula explains 60 %, two thirds of what the curve does
    ],
)
def test_an_effect_that_is_most_of_its_own_curve_keeps_its_name_whatever_neither_explains(
    left: float, alone: float, of: str, named: bool
) -> None:
    discovers = Discovers([DRAG], (alone, [of]), (0.95 * alone, [of]))
    choice, names = chosen(discovers, found(left, "drag"))
    assert names == (["drag"] if named else [])
    assert list(choice.corrections) == names


@pytest.mark.parametrize(("beside", "curves"), [(0.6, 1), (0.05, 3)])
def test_a_curve_that_runs_as_the_named_effect_does_spares_what_its_formula_needs_beside_it(
    beside: float, curves: int
) -> None:
    likeness = Likeness("force", "velocity", lambda at, values: float(values[0]))
    known = effect("drag", (("force", "velocity"),), (likeness,))
    needs = (beside, ["velocity", "position", "pressure"])
    finding = found(1.5, "drag")
    choice, names = chosen(Discovers([known], (0.8, ["velocity"]), needs), finding)
    assert names == ["drag"]
    assert len(choice.model.discoveries) == curves
    assert len(choice.discovered) == curves - 1
    assert (finding.named[0].read is not None) == (curves == 1)


def test_effects_that_share_a_curve_become_one_effect_with_a_correction() -> None:
    other = effect("weight", (("force", "velocity"),))
    discovers = Discovers(
        [DRAG, other], (9.0, []), (0.05, ["velocity"]), {"drag": 1.0, "weight": 6.0}
    )
    choice, names = chosen(discovers, found(0.05, "drag", "weight"))
    assert names == ["drag"]
    assert list(choice.corrections) == ["drag"]


def test_the_correction_may_go_with_whatever_the_effects_parameter_changes_with() -> None:
    other = effect("weight", (("force", "velocity"),))
    discovers = Discovers(
        [DRAG, other], (9.0, []), (0.05, ["pressure"]), {"drag": 1.0, "weight": 6.0}
    )
    discovers.plant.varying = (
        SimpleNamespace(name="force", parameters=("drag",), of=("pressure",)),
    )
    choice, names = chosen(discovers, found(0.05, "drag", "weight"))
    assert discovers.only == {("force", "velocity"), ("force", "pressure")}
    assert names == ["drag"]
    assert list(choice.corrections) == ["drag"]


def test_two_effects_of_which_none_explains_most_alone_stay_two() -> None:
    other = effect("weight", (("force", "velocity"),))
    discovers = Discovers(
        [DRAG, other], (9.0, []), (0.05, ["velocity"]), {"drag": 4.0, "weight": 6.0}
    )
    _, names = chosen(discovers, found(0.005, "drag", "weight"))
    assert names == ["drag", "weight"]


@pytest.mark.parametrize(("alone", "named"), [(1.0, False), (9.0, True)])
def test_a_size_at_an_end_is_given_up_if_disturbances_alone_explain_about_as_much(
    alone: float, named: bool
) -> None:
    discovers = Discovers([DRAG], (alone, ["position"]), (0.9, ["position"]))
    choice, names = chosen(discovers, found(1.0, "drag", drag=10.0))
    assert bool(names) == named
    assert choice.discovered


def test_a_curve_that_runs_as_an_effect_does_is_that_effect() -> None:
    """The effect's formula may explain nothing."""
    likeness = Likeness("force", "position", lambda at, values: float(values[0]))
    known = effect("weight", (("force", ""),), (likeness,))
    finding = found(10.0)
    choice, names = chosen(Discovers([known], (0.01, ["position"]), (9.0, [])), finding)
    assert names == ["weight"]
    assert list(choice.corrections) == ["weight"]
    assert finding.named[0].read == pytest.approx((2.0, 0.1 * 2.0 / 3.0))
