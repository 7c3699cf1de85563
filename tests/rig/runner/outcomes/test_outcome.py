from dataclasses import replace

import pytest

from estimator.leaks.detection import Decision
from rig.runner.outcomes.outcome import CampaignOutcome, InjectedFault, Status, TestOutcome

LEAK = InjectedFault("external_leakage_2", 18.0, None, 4e-9, False, 1e-5)
FOUND = Decision("external_leakage_2", 18.5, 1.5e-5)
TEST = TestOutcome("t", "external_leakage_2", Status.PASSED, 1, 40.0, (LEAK,), FOUND, 20.0)


def outcome(*statuses: Status) -> CampaignOutcome:
    tests = tuple(replace(TEST, status=status) for status in statuses)
    return CampaignOutcome("c", "", "r", "m", "product", 1.0, "", tests)


@pytest.mark.parametrize(
    ("statuses", "code"),
    [
        ([], 0),
        ([Status.PASSED, Status.PASSED], 0),
        ([Status.PASSED, Status.FAILED], 1),
        ([Status.PASSED, Status.ERROR], 1),
        ([Status.FAILED, Status.ABORTED], 3),
        ([Status.PASSED, Status.NOT_RUN], 3),
    ],
)
def test_the_exit_code_tells_the_worst_that_happened(statuses: list[Status], code: int) -> None:
    assert outcome(*statuses).exit_code == code


def test_errors_are_found_less_injected() -> None:
    assert TEST.onset_error_s == pytest.approx(0.5)
    assert TEST.leak_error_m3_per_s == pytest.approx(5e-6)
    assert TEST.latency_s == pytest.approx(2.0)


@pytest.mark.parametrize(
    "changes",
    [
        {"decision": Decision("external_leakage_1", 18.5, 1.5e-5)},
        {"decision": None},
        {"injected": ()},
        {"expect": "healthy"},
    ],
)
def test_there_is_no_error_unless_the_expected_leak_was_found(changes: dict[str, object]) -> None:
    test = replace(TEST, **changes)  # type: ignore[arg-type]
    assert test.onset_error_s is None
    assert test.leak_error_m3_per_s is None


def test_counts_name_what_occurred_only() -> None:
    counted = outcome(Status.PASSED, Status.ERROR, Status.PASSED).counts
    assert counted == {Status.PASSED: 2, Status.ERROR: 1}
