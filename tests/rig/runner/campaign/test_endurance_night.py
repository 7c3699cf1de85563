"""The shipped endurance night in short: it passes, counts right, stops at an error, goes on."""

from pathlib import Path

import pytest

from rig.configuration import check, load_campaign, shipped_config_dir
from rig.runner.campaign import StopFlag, run_campaign
from rig.runner.outcomes import CampaignOutcome, Observer, Status

NIGHT = shipped_config_dir() / "campaigns" / "endurance_night.yaml"
SHORTER = {
    "cycles: 200": "cycles: 10",
    "loop: 3": "loop: 1",
    "cycles: 20\n": "cycles: 9\n",
    "until: 75 s": "until: 34 s",
    "at: 20 s": "at: 10 s",
    "at: 40 s": "at: 18 s",
    "at: 60 s": "at: 26 s",
    "ramp: 5 s": "ramp: 2 s",
}


def night(folder: Path, **more: str) -> Path:
    text = NIGHT.read_text()
    for long, short in {**SHORTER, **more}.items():
        assert long in text
        text = text.replace(long, short)
    path = folder / "night.yaml"
    path.write_text(text)
    return path


def run(path: Path, **options: object) -> CampaignOutcome:
    campaign, rig = load_campaign(path)
    return run_campaign(campaign, rig, path.parent / "out", **options)  # type: ignore[arg-type]


class StopsIn(Observer):
    """Asks for a stop once the first test has come so far."""

    def __init__(self, stop: StopFlag, time_s: float) -> None:
        self._stop, self._time_s = stop, time_s

    def test_advances(self, time_s: float, decision: object) -> None:
        if time_s > self._time_s:
            self._stop.request("the test")


def test_the_night_as_shipped_checks_without_a_warning() -> None:
    report = check(NIGHT)
    assert not report.warnings
    assert "segment cycling at 0 s: sine, 400 s, 200 cycles" in str(report)
    assert "limit following_error_m: warn above 4.5 mm, ramp down above 5 mm" in str(report)
    assert "internal_leakage at 40 s until 60 s, changing over 5 s" in str(report)


def test_it_passes_counts_its_cycles_and_goes_on_after_a_stop(tmp_path: Path) -> None:
    path, stop = night(tmp_path), StopFlag()
    stopped = run(path, stop=stop, observer=StopsIn(stop, 8.0))
    assert [test.status for test in stopped.tests] == [Status.ABORTED, Status.NOT_RUN]
    outcome = run(path, resume=True)
    assert [test.status for test in outcome.tests] == [Status.PASSED, Status.PASSED]
    cycling, leaking = outcome.tests
    assert cycling.counted is not None
    # Ten cycles of the sine, and the steps: up, down, up, back.
    assert cycling.counted.cycles == pytest.approx(11.5, abs=0.5)
    assert cycling.counted.hours == pytest.approx(33.0 / 3600.0)
    assert len(cycling.attempts) == 1
    assert {result.figure: result.met for result in cycling.criteria} == {
        "rms_error in cycling": True,
        "settling in steps": True,
        "overshoot in steps": True,
        "push": True,
    }
    flows = [fault.mean_flow_m3_per_s or 0.0 for fault in leaking.injected]
    assert flows == sorted(flows)
    assert len(flows) == 3


def test_it_stops_at_its_error(tmp_path: Path) -> None:
    outcome = run(night(tmp_path, **{"position_gain: 150 V/m": "position_gain: 20 V/m"}))
    first = outcome.tests[0]
    assert (first.status, outcome.tests[1].status, outcome.exit_code) == (
        Status.TRIPPED,
        Status.NOT_RUN,
        3,
    )
    assert first.message.startswith("following_error_m ")
    assert "ramp_down" in first.message
