"""What becomes of a test whose figures pass limits as they become known, on the simulated rig."""

import json
from pathlib import Path

from rig.configuration import load_campaign
from rig.recording import read_recording
from rig.report.campaign.tables import limit_rows
from rig.runner.campaign import run_campaign
from rig.runner.outcomes import CampaignOutcome, Status

CAMPAIGN = """\
name: limited
rig: simulated
tests:
  - name: cycling
    cycles: 5
    settle: 1 s
    setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 1 Hz}
    limits:
      - LIMIT
  - name: next
    duration: 5 s
    setpoint: {type: constant, value: 0.3 m}
"""


def run(folder: Path, limit: str) -> CampaignOutcome:
    (folder / "c.yaml").write_text(CAMPAIGN.replace("LIMIT", limit))
    campaign, rig = load_campaign(folder / "c.yaml")
    return run_campaign(campaign, rig, folder / "out")


def test_a_cycle_beyond_its_limit_ends_test_and_campaign_as_it_ends(tmp_path: Path) -> None:
    outcome = run(
        tmp_path, "{figure: rms_error, each: cycle, inner_high: 1 mm, high: 10 mm, action: hold}"
    )
    first, second = outcome.tests
    assert (first.status, second.status, outcome.exit_code) == (Status.TRIPPED, Status.NOT_RUN, 3)
    assert first.message.startswith("rms_error of the cycle from 0.000 s ")
    assert "above 10 mm at 0.999 s: hold" in first.message
    assert 1.0 <= first.recorded_s <= 1.05
    recording = read_recording(tmp_path / "out" / str(first.recording))
    assert [each.kind for each in recording.events].count("limit") == 2
    inner, outer = limit_rows(first, recording.metadata)
    assert (inner.watched, inner.times, outer.times) == ("rms_error of each cycle", 1, 1)
    assert outer.first.endswith("at 0.999 s, of the cycle from 0.000 s")


def test_a_figure_of_the_whole_test_trips_after_its_last_sample(tmp_path: Path) -> None:
    outcome = run(tmp_path, "{figure: residual_pressure_1, each: test, high: 1 Pa, action: trip}")
    first, second = outcome.tests
    assert (first.status, first.recorded_s) == (Status.TRIPPED, 5.0)
    assert second.status is Status.NOT_RUN
    report = json.loads((tmp_path / "out/trip-1.json").read_text())
    (note,) = report["notes"]
    assert note["who"] == "limit"
    assert "above 1 Pa at 4.999 s: trip" in note["what"]
