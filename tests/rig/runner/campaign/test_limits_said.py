"""What a run says of limits that were not judged, and how a limit ends a test that is to trip."""

import json
from pathlib import Path

import pytest

from rig.recording import read_recording
from rig.report.campaign.tables import limit_rows
from rig.runner.outcomes import Status
from tests.rig.runner.campaign.test_limits_of_tests import CAMPAIGN, run


def test_a_test_that_is_to_trip_on_a_fault_is_run_again_after_a_limit_stopped_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    on_fault = CAMPAIGN.replace("    settle: 1 s\n", "    settle: 1 s\n    on_fault: trip\n", 1)
    monkeypatch.setattr("tests.rig.runner.campaign.test_limits_of_tests.CAMPAIGN", on_fault)
    first = run(tmp_path, "{channel: following_error_m, high: 40 mm, action: hold}").tests[0]
    assert (first.status, first.on_fault) == (Status.TRIPPED, "trip")
    assert not first.is_finished


def test_a_limit_that_was_not_judged_is_in_recording_results_and_history(tmp_path: Path) -> None:
    outcome = run(tmp_path, "{figure: loop_wakeup_p99, high: 1 ms, over: 1 s, action: warn}")
    said = (
        "the limit of loop_wakeup_p99 was not judged: the loop of a simulated rig runs by no clock"
    )
    first = outcome.tests[0]
    assert [str(each) for each in first.limits_not_judged] == [said]
    rows = read_recording(tmp_path / "out" / str(first.recording))
    assert [each.text for each in rows.events if each.kind == "limit"] == [said]
    assert any(said in each.what for each in outcome.history)
    results = json.loads((tmp_path / "out/results.json").read_text())
    assert results["tests"][0]["limits_not_judged"][0]["watched"] == "loop_wakeup_p99"
    (row,) = limit_rows(first, rows.metadata)
    assert (row.first, row.not_judged) == ("", "the loop of a simulated rig runs by no clock")
