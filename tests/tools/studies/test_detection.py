"""The studies count what was there, what was found, how soon and how surely."""

import numpy as np
import pytest

from rig.plant import LEAKS
from tools.detection_limits import study, tables
from tools.detection_limits.bound import Bound
from tools.detection_limits.errors import Errors
from tools.detection_limits.study import (
    named_after,
    operating_curve,
    peak,
    power_curve,
    smallest_named,
)
from tools.pages.marked_tables import filled
from tools.studies.confusion import confusion, covered, plans, sizing
from tools.studies.leak_trials import Judgement, Plan, Trial

QUIET = (0.0,) * 160


def told(
    flow: float,
    held: tuple[tuple[float, str], ...],
    *,
    fault: str | None = "internal_leakage",
    ratios: tuple[float, ...] = QUIET,
    found: float | None = None,
) -> Trial:
    """Return a trial of 80 s, onset at 20 s, of which every judge said the same."""
    judgement = Judgement(held, ratios, found, None if found is None else 0.01)
    judges = ("product", "product, often", "thesis-6")
    plan = Plan(round(1e6 * flow), fault, flow, 20.0, 80.0, judges=judges)
    return Trial(plan, False, flow, dict.fromkeys(judges, judgement))


NAMED = ((0.5, "inconclusive"), (8.0, "healthy"), (22.5, "internal_leakage"))
UNSEEN = NAMED[:2]
EARLY = ((0.5, "inconclusive"), (19.0, "internal_leakage"))
WRONG = (*UNSEEN, (23.0, "external_leakage_1"))


def test_a_leak_counts_as_named_from_its_own_name_and_not_after_an_earlier_alarm() -> None:
    assert named_after(told(0.1, NAMED), "product") == 2.5
    for held in (UNSEEN, EARLY, WRONG):
        assert named_after(told(0.1, held), "product") == float("inf")


def test_the_peak_is_that_of_the_window_after_the_onset() -> None:
    ratios = np.zeros(160)
    ratios[[39, 40, 59, 60]] = 9.0, 2.0, 3.0, 8.0  # at 20.0, 20.5, 30.0 and 30.5 s
    assert peak(told(0.1, NAMED, ratios=tuple(ratios)), "product", 10.0) == 3.0


def test_the_power_curve_finds_the_leak_that_is_named_in_95_of_100() -> None:
    rng = np.random.default_rng(1)
    flows = np.exp(rng.uniform(np.log(0.005), np.log(0.5), 4000))
    chance = 1.0 / (1.0 + (0.05 / flows) ** 6)
    named = rng.random(flows.size) < chance
    fitted = power_curve(flows, named)
    assert fitted.smallest(0.5) == pytest.approx(0.05, rel=0.05)
    assert fitted.smallest(0.95) == pytest.approx(0.05 * 19.0 ** (1.0 / 6.0), rel=0.1)
    assert fitted.at(np.array([0.05]))[0] == pytest.approx(0.5, abs=0.05)


def test_the_smallest_leak_named_lies_between_those_missed_and_those_named() -> None:
    leaks = [told(flow, NAMED if flow > 0.05 else UNSEEN) for flow in np.geomspace(0.01, 0.4, 200)]
    best, low, high = smallest_named(leaks, "product", 10.0)
    assert 0.049 < low <= best <= high < 0.06


def test_a_detector_that_names_nothing_has_no_smallest_leak() -> None:
    leaks = [told(flow, UNSEEN) for flow in np.geomspace(0.01, 0.4, 50)]
    assert smallest_named(leaks, "product", 10.0)[0] == float("inf")


def test_an_operating_curve_of_no_difference_is_the_diagonal_and_of_a_clear_one_its_corner() -> (
    None
):
    rng = np.random.default_rng(2)

    def spread(level: float) -> list[Trial]:
        return [told(0.1, NAMED, ratios=tuple(level + rng.random(160))) for _ in range(200)]

    false, true = operating_curve(spread(1.0), spread(1.0), "product", 10.0)
    assert np.abs(false - true).max() < 0.2
    false, true = operating_curve(spread(1.0), spread(3.0), "product", 10.0)
    assert true[false == 0.0].max() == 1.0


def test_the_confusion_matrix_has_every_trial_once() -> None:
    trials = [
        told(0.1, NAMED),
        told(0.2, UNSEEN),
        told(0.0, UNSEEN, fault=None),
        told(0.0, (*UNSEEN, (30.0, "unknown_fault")), fault="return_blockage"),
    ]
    lines = confusion(trials).splitlines()
    assert lines[2] == "| internal leakage | 2 | 1 |  |  | 1 |  |  |  |  |  |"
    assert lines[3].startswith("| healthy | 1 | 1 |")
    assert lines[4].startswith("| return blockage, supply pressure measured | 1 |")
    assert lines[4].endswith("| 1 |  |")


def test_sizes_are_judged_against_the_true_flow() -> None:
    near, far = told(0.1, NAMED, found=0.11), told(0.2, NAMED, found=0.25)
    assert covered(near)
    assert not covered(far)
    last = sizing([near, far, told(0.05, UNSEEN)]).splitlines()[-1]
    assert last.startswith("| all | 3 | 2 | 0 | 2.5 / 2.5 s | +0.0300 | 0.0361 |")
    assert last.endswith("| 1 of 2 |")


def test_at_least_as_many_leaks_are_planned_as_asked_for_and_no_plan_twice() -> None:
    made = list(plans(30))
    assert len({plan.key for plan in made}) == len(made)
    assert sum(plan.fault in LEAKS for plan in made) == 30
    assert {plan.supply_sensor for plan in made if plan.fault == "supply_leakage"} == {True, False}
    assert len({plan.key for plan in study.plans(20)}) == 40


def test_the_tables_say_what_was_found(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "_RESAMPLES", 10)
    leaks = [told(flow, NAMED if flow > 0.05 else UNSEEN) for flow in np.geomspace(0.01, 0.4, 200)]
    healthy = [told(0.0, UNSEEN, fault=None)]
    bound = {"a motion": Bound(np.array([10.0, 60.0]), np.full((3, 2), 1e-10))}
    assert "0 of 1 in 0.0 h" in tables.power(healthy, leaks)
    assert "internal, unloaded | 0.05" in tables.smallest(leaks, bound, bound)
    assert "| 0.06 to 0.1 |" in tables.outcomes(leaks)
    errors = Errors(np.array([10.0, 60.0]), np.array([[0.01, np.nan], [-0.01, 0.02]]))
    assert "| rms error (L/min) | 0.0100 ± 0.0098 |" in tables.error_check(
        errors, bound["a motion"]
    )


def test_a_table_goes_to_its_place_and_others_stay() -> None:
    page = "<!-- table of a -->\nold\n<!-- end -->\n<!-- table of b -->\nkept\n<!-- end -->"
    assert filled(page, {"a": "new"}) == page.replace("old", "new")
    with pytest.raises(ValueError, match="no place for c"):
        filled(page, {"c": "new"})
