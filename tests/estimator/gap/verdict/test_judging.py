"""Each rule of the verdict decides where it is meant to, and nowhere else."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.gap.plant.additions import Addition
from estimator.gap.prediction.results import Curve
from estimator.gap.verdict import judging
from estimator.gap.verdict.judging import RULES, Evidence, Rule, judge
from estimator.gap.verdict.unsettled import Unsettled

TWO = ("pressure_1_Pa", "pressure_2_Pa")


def found(before: float, after: float, names: int) -> Any:
    """Return what a search found, by the excess before and with all that is claimed."""

    def fitted(excess: float) -> SimpleNamespace:
        return SimpleNamespace(cost=1000.0 * (1.0 + excess))

    effect = SimpleNamespace(effect="constant_force", per_reading=1.0, gain=9.0, bar=1.0, z=9.0)
    return SimpleNamespace(
        given=fitted(before), refitted=fitted(before), fitted=fitted(after), samples=1000,
        floor=1.0,
        explained=1.0 - after / before, named=names * [effect],
    )  # fmt: skip


HINGE: Any = SimpleNamespace(
    addition=Addition("flow, chamber 1", "pressure 1", "", "hinge", (5e6,), (-1e-12,))
)


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
        found=of, discovered=(), rest=[curve(share) for share in shares],
        located=max(shares, default=0.0), resting=[], unsettled=[], held_out=0.0,
    )  # fmt: skip
    return replace(none, **others)


NAMED, NOTHING = found(5.0, 0.02, 1), found(0.005, 0.005, 0)
DECIDED_BY: dict[Rule, Evidence] = {
    judging.another_rig: evidence(found(5.0, 5.0, 0), resting=TWO),
    judging.too_much_at_once: evidence(found(80.0, 80.0, 0)),
    judging.missing_effect: evidence(NAMED),
    judging.discovered: evidence(found(5.0, 0.005, 0), discovered=[HINGE]),
    judging.left_to_a_curve: evidence(found(5.0, 0.6, 0), [0.2]),
    judging.goes_with_the_motion: evidence(NOTHING, unsettled=[stirred(0.0, 2.0, 3.0)]),
    judging.not_shown: evidence(NOTHING, held_out=5.0),
}
"""Evidence on which one rule alone decides."""


def test_every_rule_is_tried() -> None:
    assert tuple(DECIDED_BY) == tuple(RULES)


@pytest.mark.parametrize("rule", DECIDED_BY, ids=lambda rule: rule.__name__)
def test_what_speaks_by_one_rule_alone_is_told_by_no_other(
    rule: Rule, monkeypatch: pytest.MonkeyPatch
) -> None:
    told = rule(DECIDED_BY[rule])
    assert told
    assert judge(DECIDED_BY[rule]) == (RULES[rule], told)
    others = {each: verdict for each, verdict in RULES.items() if each is not rule}
    monkeypatch.setattr(judging, "RULES", others)
    assert judge(DECIDED_BY[rule]).verdict == "adequate"


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
    for excess in (float("inf"), float("nan")):
        assert judge(evidence(found(5.0, excess, 1))).verdict == "inconclusive"


@pytest.mark.parametrize(
    ("names", "discovered", "share", "verdict"),
    [
        (1, [], 0.0, "missing_effect"),
        (1, [], 0.9, "missing_effect"),
        (1, [HINGE], 0.0, "missing_effect"),
        (0, [HINGE], 0.9, "unknown_effect"),
        (0, [], 0.5, "unknown_effect"),
        (0, [], 0.0, "adequate"),
    ],
    ids=["named", "named, much left", "named and more", "discovered", "a curve", "nothing"],
)
def test_what_stays_unexplained_lowers_the_claim_and_does_not_erase_it(
    names: int, discovered: list[Any], share: float, verdict: str
) -> None:
    left = evidence(found(5.0, 0.6, names), [share], discovered=discovered)
    assert judge(left).verdict == verdict


def test_the_part_that_nothing_explains_is_told_with_its_size() -> None:
    (_, rest) = judge(evidence(found(5.0, 0.9, 1), discovered=[HINGE])).reasons
    assert rest.startswith("82.0% of the excess is explained by constant_force and a disturbance")
    assert "the rest by nothing known: 0.9 noise variances a reading" in rest
    (whole,) = judge(evidence(found(5.0, 0.005, 1))).reasons
    assert "constant_force" in whole


@pytest.mark.parametrize(
    ("high", "low", "before", "verdict"),
    [
        (2.0, 0.0, 3.0, "unknown_effect"),
        (2.0, 0.0, 100.0, "adequate"),
        (2.0, 1.99, 3.0, "adequate"),
        (0.1, 0.0, 0.1, "adequate"),
    ],
    ids=["stirred", "a trifle of what was", "noise", "next to nothing"],
)
def test_errors_that_grow_with_the_motion_are_no_noise(
    high: float, low: float, before: float, verdict: str
) -> None:
    assert judge(evidence(NOTHING, unsettled=[stirred(low, high, before)])).verdict == verdict
    # They are told beside a name, which they do not erase.
    named = judge(evidence(found(5.0, 0.6, 1), unsettled=[stirred(low, high, before)]))
    assert named.verdict == "missing_effect"
    assert any("goes with the rate" in said for said in named.reasons) == (
        verdict == "unknown_effect"
    )


def test_recordings_held_out_that_no_finding_explains_support_no_verdict() -> None:
    for held_out, verdict in ((5.0, "inconclusive"), (0.05, "adequate")):
        assert judge(evidence(NOTHING, [0.9], held_out=held_out)).verdict == verdict
