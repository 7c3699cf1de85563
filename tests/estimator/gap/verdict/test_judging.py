"""Each rule of the verdict decides where it is meant to, and nowhere else."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.gap.prediction.results import Curve
from estimator.gap.prediction.variables import Variable
from estimator.gap.search.findings import MOST_EFFECTS
from estimator.gap.verdict import judging
from estimator.gap.verdict.judging import RULES, Evidence, Rule, judge
from estimator.gap.verdict.unsettled import Unsettled

TWO = ("pressure_1_Pa", "pressure_2_Pa")


def found(before: float, after: float, names: int, size: float = 200.0) -> Any:
    """Return what a search found, by the excess before and with what was named."""

    def fitted(excess: float) -> SimpleNamespace:
        return SimpleNamespace(cost=1000.0 * (1.0 + excess), values={"constant_force": size})

    effect = SimpleNamespace(effect="constant_force", per_reading=1.0, gain=9.0, bar=1.0, z=9.0)
    return SimpleNamespace(
        given=SimpleNamespace(values={"constant_force": 0.0}),
        refitted=fitted(before), fitted=fitted(after), samples=1000, floor=1.0,
        explained=1.0 - after / before, named=names * [effect],
        variables=(Variable("constant_force", "value", "constant_force", 1.0, -5e3, 5e3),),
    )  # fmt: skip


def curve(share: float) -> Curve:
    none = np.zeros(1)
    return Curve(
        "force balance", "position", none, none, none, "N", "m", ("N", 1.0), ("m", 1.0), 1e3, share
    )  # fmt: skip


def stirred(low: float, high: float, before: float) -> Unsettled:
    squares = np.array([low, high])
    return Unsettled("spool_m", "rate of command_V", squares, squares, 0.0 * squares,
                     float(squares.mean()), "V/s", 1.0, before)  # fmt: skip


def evidence(of: Any, shares: Sequence[float] = (), **others: Any) -> Evidence:
    """Return evidence that speaks against nothing, but for what is given."""
    none = Evidence(
        found=of, rest=[curve(share) for share in shares], located=max(shares, default=0.0),
        resting=[], unsettled=[], held_out=0.0, held_out_before=float("nan"),
        ahead=(float("nan"), float("nan")), scatter=0.0, worse=None,
    )  # fmt: skip
    return replace(none, **others)


NAMED, NOTHING = found(5.0, 0.02, 1), found(0.005, 0.005, 0)
DECIDED_BY: dict[Rule, Evidence] = {
    judging.another_rig: evidence(found(5.0, 5.0, 0), resting=TWO),
    judging.too_much_at_once: evidence(found(80.0, 80.0, 0), [0.2]),
    judging.left_to_a_curve: evidence(found(5.0, 0.6, 1), [0.9]),
    judging.goes_with_the_motion: evidence(NAMED, unsettled=[stirred(0.0, 2.0, 3.0)]),
    judging.at_an_end: evidence(found(5.0, 0.6, 1, size=5e3)),
    judging.not_held_out: evidence(NAMED, held_out=3.0, held_out_before=5.0),
    judging.not_ahead: evidence(NAMED, ahead=(20.0, 12.0)),
    judging.worse_than_given: evidence(NAMED, worse="the gap has risen"),
    judging.missing_effect: evidence(NAMED),
    judging.not_shown: evidence(NOTHING, held_out=5.0),
}
"""Evidence that speaks against a model or its names by one rule alone."""


def test_every_rule_is_tried() -> None:
    assert tuple(DECIDED_BY) == RULES


@pytest.mark.parametrize("rule", DECIDED_BY, ids=lambda rule: rule.__name__)
def test_what_speaks_by_one_rule_alone_is_told_by_no_other(
    rule: Rule, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = rule(DECIDED_BY[rule])
    assert judge(DECIDED_BY[rule]) == told
    monkeypatch.setattr(judging, "RULES", tuple(each for each in RULES if each is not rule))
    without = judge(DECIDED_BY[rule])
    assert told is not None
    assert without.verdict in ("adequate", "missing_effect", "unknown_effect")
    assert without.verdict != told.verdict


def test_a_model_that_no_rule_speaks_against_is_adequate() -> None:
    assert judge(evidence(NOTHING)).verdict == "adequate"
    (noisy,) = judge(evidence(found(0.5, 0.5, 0))).reasons
    assert "sensors may be noisier than stated" in noisy


def test_one_channel_worse_than_resting_may_have_a_gap_of_its_own() -> None:
    of = found(5.0, 5.0, 0)
    assert judge(evidence(of, resting=TWO)).verdict == "inconclusive"
    assert judge(evidence(of, resting=TWO[:1])).verdict == "adequate"


def test_what_one_equation_lacks_is_of_this_rig_however_badly_it_is_predicted() -> None:
    badly = evidence(found(80.0, 80.0, 0), [0.1], resting=TWO, held_out=80.0)
    assert judge(badly).verdict == "inconclusive"
    assert judge(replace(badly, located=0.6)).verdict == "unknown_effect"


def test_a_cost_that_is_not_finite_tells_nothing() -> None:
    assert judge(evidence(found(5.0, float("inf"), 1))).verdict == "inconclusive"
    assert judge(evidence(found(5.0, float("nan"), 1), [0.9])).verdict == "inconclusive"


@pytest.mark.parametrize(
    ("before", "after", "names", "share", "verdict"),
    [
        (5.0, 0.02, 1, 0.9, "missing_effect"),
        (5.0, 0.6, 1, 0.1, "missing_effect"),
        (5.0, 0.6, 1, 0.9, "unknown_effect"),
        (5.0, 3.0, 1, 0.5, "unknown_effect"),
        (5.0, 5.0, 0, 0.5, "unknown_effect"),
        (0.005, 0.005, 0, 0.9, "adequate"),
    ],
)
def test_names_that_leave_much_to_a_free_curve_are_not_the_cause(
    before: float, after: float, names: int, share: float, verdict: str
) -> None:
    assert judge(evidence(found(before, after, names), [share])).verdict == verdict


@pytest.mark.parametrize(
    ("high", "low", "before", "names", "verdict"),
    [
        (2.0, 0.0, 3.0, 1, "unknown_effect"),
        (2.0, 0.0, 100.0, 1, "missing_effect"),
        (2.0, 0.0, 1.0, 0, "unknown_effect"),
        (2.0, 1.99, 3.0, 1, "missing_effect"),
        (0.1, 0.0, 0.1, 0, "adequate"),
    ],
)
def test_names_must_leave_no_more_than_noise_where_the_rig_is_stirred(
    high: float, low: float, before: float, names: int, verdict: str
) -> None:
    of = found(0.01, 0.001, names)
    assert judge(evidence(of, unsettled=[stirred(low, high, before)])).verdict == verdict


@pytest.mark.parametrize(
    ("held_out", "before", "verdict"),
    [
        (0.03, 60.0, "missing_effect"),
        (4.0, 60.0, "unknown_effect"),
        (0.001, 0.1, "unknown_effect"),
    ],
    ids=["borne out", "not closed", "not shown"],
)
def test_names_that_other_motions_bear_out_stand(
    held_out: float, before: float, verdict: str
) -> None:
    left = [stirred(0.0, 2.0, 3.0)]
    given = evidence(NAMED, unsettled=left, held_out=held_out, held_out_before=before)
    assert judge(given).verdict == verdict


@pytest.mark.parametrize(
    ("size", "after", "verdict"),
    [
        (5e3, 0.6, "unknown_effect"),
        (-5e3, 0.6, "unknown_effect"),
        (5e3, 0.005, "missing_effect"),
        (4e3, 0.6, "missing_effect"),
    ],
)
def test_the_most_that_is_plausible_is_no_finding_if_it_leaves_much(
    size: float, after: float, verdict: str
) -> None:
    given = evidence(found(5.0, after, 1, size))
    assert judge(given).verdict == verdict
    # What a motion held out that shows it bears out is the cause all the same.
    assert judge(replace(given, held_out=0.05, held_out_before=50.0)).verdict == "missing_effect"


def test_names_that_do_not_explain_the_recordings_held_out_are_not_claimed() -> None:
    for held_out, verdict in ((3.0, "unknown_effect"), (0.5, "missing_effect")):
        assert judge(evidence(NAMED, held_out=held_out, held_out_before=5.0)).verdict == verdict


@pytest.mark.parametrize(
    ("names", "ahead", "verdict"),
    [
        (1, (20.0, 1.0), "missing_effect"),
        (1, (20.0, 12.0), "unknown_effect"),
        (1, (3.0, 2.0), "missing_effect"),
        (MOST_EFFECTS, (1000.0, 20.0), "unknown_effect"),
        (MOST_EFFECTS, (1000.0, 2.0), "missing_effect"),
    ],
)
def test_names_that_leave_the_gap_over_the_horizon_open_are_not_claimed(
    names: int, ahead: tuple[float, float], verdict: str
) -> None:
    assert judge(evidence(found(5.0, 0.02, names), ahead=ahead)).verdict == verdict


def test_a_gap_that_twins_have_too_speaks_against_no_name() -> None:
    for scatter, verdict in ((1.0, "unknown_effect"), (3.0, "missing_effect")):
        assert judge(evidence(NAMED, ahead=(9.0, 8.0), scatter=scatter)).verdict == verdict


def test_names_that_make_the_model_worse_are_not_claimed_and_nothing_named_is_no_worse() -> None:
    worse = "the gap has risen"
    (said,) = judge(evidence(NAMED, worse=worse)).reasons
    assert said == f"constant_force would lower one-step errors, but {worse}; nothing is named"
    assert judge(evidence(NOTHING, worse=worse)).verdict == "adequate"


def test_recordings_held_out_that_no_finding_explains_support_no_verdict() -> None:
    for held_out, verdict in ((5.0, "inconclusive"), (0.05, "adequate")):
        assert judge(evidence(NOTHING, [0.9], held_out=held_out)).verdict == verdict
