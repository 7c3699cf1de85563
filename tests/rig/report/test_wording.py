from collections.abc import Callable
from dataclasses import replace

import pytest

from estimator.leaks.detection import Decision
from faults.verdict import Verdict
from rig.plant.parameters import LITRE_PER_MINUTE
from rig.report.wording import (
    acted,
    detection_summary,
    found_flow,
    found_names,
    headline,
    injected_size,
    label,
    latency,
    leaks_found,
    story,
    when,
)
from rig.runner.outcomes.outcome import CampaignOutcome, InjectedFault, Status, TestOutcome

CampaignOf = Callable[..., CampaignOutcome]

FOUND = Decision(
    "external_leakage_1", 8.1, 0.3 * LITRE_PER_MINUTE, 0.01 * LITRE_PER_MINUTE, 1.9e-9, 20.0, 6.0
)
INJECTED = InjectedFault("external_leakage_1", 8.0, None, 1.9e-9, False, 0.29 * LITRE_PER_MINUTE)
PASSED = TestOutcome(
    "leak", "external_leakage_1", Status.PASSED, 1, 20.0, (INJECTED,), FOUND, 9.5, recorded_s=20.0
)
HEALTHY = TestOutcome(
    "healthy", "healthy", Status.PASSED, 1, 20.0, (), Decision("healthy"), recorded_s=20.0
)
BOTH = Decision(
    "multiple",
    8.0,
    0.5 * LITRE_PER_MINUTE,
    0.02 * LITRE_PER_MINUTE,
    details={"internal_leakage_coefficient": 1e-9, "external_leakage_2_coefficient": 2e-9},
)


@pytest.mark.parametrize("verdict", list(Verdict))
def test_every_verdict_has_words_of_its_own(verdict: Verdict) -> None:
    assert "_" not in label(verdict)
    assert sum(label(verdict) == label(other) for other in Verdict) == 1


def test_a_found_flow_comes_with_its_interval_and_unit() -> None:
    assert found_flow(FOUND) == "0.30 (0.28 to 0.32) L/min"
    assert found_flow(replace(FOUND, leak_m3_per_s=0.05 * LITRE_PER_MINUTE)) == (
        "0.050 (0.030 to 0.070) L/min"
    )
    assert found_flow(Decision("healthy")) == ""


def test_of_several_faults_all_are_named_and_the_flow_is_said_to_be_that_of_all() -> None:
    assert found_names(BOTH) == "internal leak and external leak 2"
    assert leaks_found(BOTH)[0] == "internal_leakage"
    assert found_flow(BOTH).endswith("L/min together")


@pytest.mark.parametrize(
    ("fault", "size"),
    [
        (INJECTED, "0.29 L/min"),
        (replace(INJECTED, mean_flow_m3_per_s=None), "0.299 L/min at 6.9 MPa"),
        (replace(INJECTED, mean_flow_m3_per_s=None, linear=True), "787 L/min at 6.9 MPa (linear)"),
        (InjectedFault("return_blockage", 8.0, None, 2e13, False, None), "2e+13 Pa/(m³/s)²"),
    ],
)
def test_an_injected_fault_s_size_always_has_its_unit(fault: InjectedFault, size: str) -> None:
    assert injected_size(fault) == size


def test_a_test_s_story_says_what_was_injected_what_was_found_and_how_late() -> None:
    reported = story(PASSED)
    assert "At 8.0 s a leak from chamber 1 to the return line was opened (0.29 L/min" in reported
    assert "called it 1.50 s later: external leak 1, 0.30 (0.28 to 0.32) L/min." in reported


def test_a_failed_test_s_story_says_what_was_expected() -> None:
    missed = replace(PASSED, status=Status.FAILED, decision=Decision("healthy"), detected_at_s=None)
    assert "found nothing wrong. Expected was: external leak 1." in story(missed)


def test_a_false_alarm_s_story_says_when_it_came() -> None:
    alarm = replace(HEALTHY, status=Status.FAILED, decision=FOUND, detected_at_s=9.5)
    assert "No fault was injected. The detector raised an alarm at 9.50 s" in story(alarm)


def test_a_ram_that_hardly_moved_is_said_to_be_why_nothing_was_found() -> None:
    details = {"travel_m": 5e-5, "travel_needed_m": 3.4e-3}
    still = replace(HEALTHY, decision=Decision("inconclusive", details=details))
    assert "moved by 0.05 mm, and a leak shows from 3.4 mm on" in story(still)
    assert "would not have shown a leak" in story(
        replace(HEALTHY, decision=Decision("inconclusive"))
    )


def test_an_alarm_before_the_injection_is_not_given_a_negative_latency() -> None:
    assert latency(PASSED) == "1.50 s"
    assert latency(replace(PASSED, detected_at_s=5.0)) == "before the injection"
    assert latency(HEALTHY) == ""


def test_the_headline_counts_what_came_out_as_expected(campaign: CampaignOf) -> None:
    assert headline(campaign(PASSED, HEALTHY)) == "All 2 tests came out as expected."
    failed = replace(PASSED, status=Status.FAILED)
    assert headline(campaign(PASSED, failed, failed)) == "1 of 3 tests came out as expected."
    assert headline(campaign(PASSED)) == "The test passed."
    assert headline(campaign()) == "The campaign has no tests."


def test_the_summary_says_how_late_how_far_off_and_how_quiet(campaign: CampaignOf) -> None:
    slow = replace(PASSED, detected_at_s=10.0)
    reported = detection_summary(campaign(PASSED, slow, HEALTHY))
    assert "All 2 faults were named right, 1.5 to 2.0 s after they began." in reported
    assert "differ by 0.01 L/min at most" in reported
    assert "No false alarm in one healthy test, 20 s." in reported


def test_the_summary_owns_up_to_missed_faults_and_false_alarms(campaign: CampaignOf) -> None:
    missed = replace(PASSED, status=Status.FAILED, decision=Decision("healthy"), detected_at_s=None)
    alarm = replace(HEALTHY, status=Status.FAILED, decision=FOUND, detected_at_s=9.5)
    reported = detection_summary(campaign(PASSED, missed, alarm, HEALTHY))
    assert "1 of 2 faults were named right, 1.5 s after they began." in reported
    assert "Of 2 healthy tests, 40 s, 1 had a false alarm." in reported


def test_a_fault_that_is_only_expected_makes_no_healthy_test_with_a_false_alarm(
    campaign: CampaignOf,
) -> None:
    drift = replace(
        PASSED, expect="encoder_drift", injected=(), decision=Decision("encoder_drift"),
        detected_at_s=34.0,
    )  # fmt: skip
    reported = detection_summary(campaign(drift))
    assert reported.startswith("The fault was named right")
    assert "alarm" not in reported


def test_a_campaign_that_judged_nothing_has_no_summary(campaign: CampaignOf) -> None:
    never = replace(PASSED, status=Status.NOT_RUN, decision=None, injected=())
    assert detection_summary(campaign(never)) == ""


@pytest.mark.parametrize(
    ("started", "text"),
    [
        ("2026-11-01T06:05:00+00:00", "1 November 2026, 06:05 UTC"),
        ("2026-11-21T06:05:00+02:00", "21 November 2026, 04:05 UTC"),
        ("2026-11-21T06:05:00", "21 November 2026, 06:05"),
        ("yesterday", "yesterday"),
    ],
)
def test_the_start_is_reported_in_words_and_in_utc(started: str, text: str) -> None:
    assert when(started) == text


def test_a_fault_that_outlasts_its_test_is_said_to_act_until_the_test_ended() -> None:
    fault = replace(INJECTED, until_s=55.0)
    ended = replace(PASSED, injected=(fault,), duration_s=90.0, recorded_s=52.0)
    assert "on average, until the test ended at 52.0 s)" in story(ended)
    assert "55.0 s" not in story(ended)
    assert acted(fault, 52.0) == "from 8.0 s to the end at 52.0 s"


def test_a_fault_that_ended_in_its_test_or_in_an_older_run_keeps_its_end() -> None:
    fault = replace(INJECTED, until_s=55.0)
    assert [acted(fault, recorded_s) for recorded_s in (55.0, 60.0, 0.0)] == ["8.0 s to 55.0 s"] * 3
