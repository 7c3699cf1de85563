"""What becomes of a test whose own limits are passed, on the simulated rig."""

import json
from pathlib import Path

import pytest

from rig.configuration import load_campaign
from rig.recording import read_recording
from rig.report.campaign.tables import limit_rows
from rig.runner.campaign import run_campaign
from rig.runner.outcomes import CampaignOutcome, Status

CAMPAIGN = """\
name: limited
rig: simulated
tests:
  - name: lagging
    duration: 5 s
    settle: 1 s
    setpoint: {type: sine, mean: 0.3 m, amplitude: 0.15 m, frequency: 0.5 Hz}
    figures:
      lag: {expression: "rms(setpoint_m - position_m)", unit: m}
    criteria: [{figure: peak_error, at_most: 20 mm}]
    limits:
      - LIMIT
  - name: next
    duration: 5 s
    setpoint: {type: constant, value: 0.3 m}
"""


def run(folder: Path, limit: str, pace: str = "fast") -> CampaignOutcome:
    (folder / "c.yaml").write_text(CAMPAIGN.replace("LIMIT", limit))
    campaign, rig = load_campaign(folder / "c.yaml")
    return run_campaign(campaign, rig, folder / "out", pace=pace)  # type: ignore[arg-type]


@pytest.mark.parametrize("action", ["hold", "ramp_down", "trip"])
def test_the_loop_acts_on_a_following_error_at_its_sample(tmp_path: Path, action: str) -> None:
    limit = f"{{channel: following_error_m, inner_high: 50 mm, high: 90 mm, action: {action}}}"
    outcome = run(tmp_path, limit)
    first, second = outcome.tests
    assert (first.status, second.status, outcome.exit_code) == (Status.TRIPPED, Status.NOT_RUN, 3)
    assert first.limits[-1].action == action
    assert first.message.startswith("following_error_m 90")
    assert "above 90 mm at 1." in first.message
    rows = read_recording(tmp_path / "out" / str(first.recording))
    assert rows.time_s[-1] == pytest.approx(first.limits[-1].at_s)
    assert any(event.kind == "limit" for event in rows.events)
    journal = (tmp_path / "out/journal.jsonl").read_text().splitlines()
    assert any("above 90 mm" in str(entry) for entry in journal)
    assert any("limit: lagging" in happening.what for happening in outcome.history)


@pytest.mark.parametrize("action", ["hold", "ramp_down", "trip"])
def test_the_runner_acts_on_a_figure_over_its_last_second(tmp_path: Path, action: str) -> None:
    outcome = run(tmp_path, f"{{figure: lag, high: 20 mm, over: 1 s, action: {action}}}")
    first = outcome.tests[0]
    assert (first.status, outcome.exit_code) == (Status.TRIPPED, 3)
    assert first.message.startswith("lag ")
    assert 1.0 <= first.recorded_s < 1.2


def test_a_warning_is_recorded_and_the_test_goes_on(tmp_path: Path) -> None:
    outcome = run(tmp_path, "{channel: following_error_m, high: 60 mm, action: warn}")
    first = outcome.tests[0]
    assert (first.status, first.recorded_s) == (Status.FAILED, 5.0)
    assert [each.action for each in first.limits] == ["warn"] * len(first.limits)
    assert first.missed[0].figure == "peak_error"
    record = json.loads((tmp_path / "out/results.json").read_text())["tests"][0]
    assert record["limits"][0]["watched"] == "following_error_m"
    assert record["criteria"][0]["met"] is False


def test_a_cycle_beyond_its_limit_ends_test_and_campaign_as_it_ends(tmp_path: Path) -> None:
    limit = "{figure: rms_error, each: cycle, inner_high: 1 mm, high: 10 mm, action: hold}"
    outcome = run(tmp_path, limit)
    first, second = outcome.tests
    assert (first.status, second.status, outcome.exit_code) == (Status.TRIPPED, Status.NOT_RUN, 3)
    assert first.message.startswith("rms_error of the cycle from 0.000 s ")
    assert "above 10 mm at 1.999 s: hold" in first.message
    assert 2.0 <= first.recorded_s <= 2.05
    recording = read_recording(tmp_path / "out" / str(first.recording))
    assert [each.kind for each in recording.events].count("limit") == 2
    inner, outer = limit_rows(first, recording.metadata)
    assert (inner.watched, inner.times, outer.times) == ("rms_error of each cycle", 1, 1)
    assert outer.first.endswith("at 1.999 s, of the cycle from 0.000 s")


def test_a_figure_of_the_whole_test_trips_after_its_last_sample(tmp_path: Path) -> None:
    outcome = run(tmp_path, "{figure: residual_pressure_1, each: test, high: 1 Pa, action: trip}")
    first, second = outcome.tests
    assert (first.status, first.recorded_s) == (Status.TRIPPED, 5.0)
    assert second.status is Status.NOT_RUN
    report = json.loads((tmp_path / "out/trip-1.json").read_text())
    (note,) = report["notes"]
    assert note["who"] == "limit"
    assert "above 1 Pa at 4.999 s: trip" in note["what"]


def test_a_test_that_is_to_trip_on_a_fault_is_run_again_after_a_limit_stopped_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    on_fault = CAMPAIGN.replace("    settle: 1 s\n", "    settle: 1 s\n    on_fault: trip\n", 1)
    monkeypatch.setattr(f"{__name__}.CAMPAIGN", on_fault)
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
