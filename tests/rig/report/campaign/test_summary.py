from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from estimator.leaks.detection import Decision
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.report.campaign.page import Row, false_alarm_words, full_scale, row_of, smallest_rows
from rig.report.campaign.sections import sections_of
from rig.report.wording import latency
from rig.runner.outcomes.outcome import CampaignOutcome, InjectedFault, Status, TestOutcome

CampaignOf = Callable[..., CampaignOutcome]


def injecting(*litres_per_minute: float) -> TestOutcome:
    faults = tuple(
        InjectedFault(kind, 5.0, None, 1e-9, False, flow * LITRE_PER_MINUTE)
        for kind, flow in zip(
            ("external_leakage_1", "external_leakage_2"), litres_per_minute, strict=False
        )
    )
    return TestOutcome("leak", "healthy", Status.FAILED, 1, 20.0, faults, recorded_s=20.0)


def only_row(outcome: CampaignOutcome, folder: Path) -> Row:
    (section,) = sections_of(outcome, folder)
    return row_of(section, full_scale(outcome))


@given(flow=st.floats(1e-3, 1e3))
def test_the_small_charts_reach_from_zero_to_a_round_flow(
    campaign: CampaignOf, flow: float
) -> None:
    scale = full_scale(campaign(injecting(flow)))
    assert flow * (1.0 - 1e-12) <= scale < 2.6 * flow
    assert f"{scale:.0e}"[0] in "125"


def test_a_campaign_without_flows_has_a_chart_all_the_same(campaign: CampaignOf) -> None:
    assert full_scale(campaign()) == 1.0
    assert full_scale(campaign(injecting(0.0))) == 1.0


def test_the_chart_sets_what_was_found_beside_the_same_leak_as_injected(
    campaign: CampaignOf, tmp_path: Path
) -> None:
    found = Decision(
        "external_leakage_2", 5.0, 0.4 * LITRE_PER_MINUTE, 0.05 * LITRE_PER_MINUTE, 1e-9
    )
    test = replace(injecting(0.9, 0.5), decision=found)
    place = only_row(campaign(test), tmp_path).chart
    assert place == pytest.approx({"injected": 50.0, "found": 40.0, "lower": 30.2, "upper": 49.8})


def test_a_missed_leak_is_on_the_chart_alone(campaign: CampaignOf, tmp_path: Path) -> None:
    test = replace(injecting(0.5), decision=Decision("healthy"))
    row = only_row(campaign(test), tmp_path)
    assert row.chart["injected"] == pytest.approx(100.0)
    assert (row.chart["found"], row.chart["lower"]) == (None, None)
    assert (row.found, row.flow, latency(test)) == ("healthy", "", "")


def test_the_false_alarm_rate_is_reported_as_a_chance_for_this_campaign(
    campaign: CampaignOf,
) -> None:
    test = replace(injecting(0.5), decision=Decision("healthy"), recorded_s=86.4)
    reported = false_alarm_words(campaign(test, test))
    assert "at most once in a day" in reported
    assert "judged 173 s" in reported
    assert "1 in 500" in reported
    assert "at most 2 times in a day" in false_alarm_words(campaign(test, false_alarms_per_day=2.0))


def test_a_rate_that_makes_false_alarms_likely_is_not_reported_as_a_small_chance(
    campaign: CampaignOf,
) -> None:
    test = replace(injecting(0.5), decision=Decision("healthy"), recorded_s=3600.0)
    assert "1 in" not in false_alarm_words(campaign(test, false_alarms_per_day=100.0))


def test_the_thesis_detector_says_what_its_thresholds_are_learnt_from(
    campaign: CampaignOf,
) -> None:
    reported = false_alarm_words(campaign(injecting(0.5), filter="thesis-6"))
    assert "learnt from healthy running" in reported
    assert "upper bound" not in reported


def details(flow: float) -> dict[str, float]:
    leaks = ("external_leakage_1", "external_leakage_2", "internal_leakage")
    return {f"smallest_{leak}_m3_per_s": flow * LITRE_PER_MINUTE for leak in leaks}


@pytest.mark.parametrize(
    ("verdict", "flow", "shown"),
    [
        ("healthy", 0.0601, "0.061"),
        ("healthy", float("inf"), "none"),
        ("inconclusive", 0.06, "none"),
    ],
)
def test_what_would_have_been_found_is_never_claimed_better_than_it_is(
    campaign: CampaignOf, tmp_path: Path, verdict: str, flow: float, shown: str
) -> None:
    test = replace(injecting(), decision=Decision(verdict, details=details(flow)))
    rows = smallest_rows(sections_of(campaign(test), tmp_path))
    assert rows == [("leak", [shown] * 3, [])]


def test_a_detector_that_does_not_say_leaves_no_row(campaign: CampaignOf, tmp_path: Path) -> None:
    assert smallest_rows(sections_of(campaign(injecting(0.5)), tmp_path)) == []
