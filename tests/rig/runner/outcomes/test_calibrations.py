"""Results, report and recordings of a campaign name the calibrations by which it was measured."""

import json
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, date, datetime
from pathlib import Path

import numpy as np
import pytest

from estimator.leaks.replaying import replay
from faults.campaign import Campaign, CampaignTest
from rig.configuration.rigs.rig import Rig
from rig.io.transducer_calibration import CalibrationPoint, TransducerCalibration
from rig.plant import Model
from rig.recording import Recording, read_recording
from rig.runner import run_campaign
from rig.runner.campaign import simulated_bench
from rig.runner.outcomes.calibrations import (
    CalibrationUsed,
    calibrations_recorded,
    calibrations_used,
)
from rig.runner.outcomes.observer import Observer

MakeTest = Callable[..., CampaignTest]
MakeCampaign = Callable[..., Campaign]

LONG_AGO = TransducerCalibration(
    "pressure_1_Pa",
    "PT-1",
    date(2001, 3, 2),
    date(2002, 3, 2),
    (CalibrationPoint(0.0, 3e5), CalibrationPoint(2e7, 2.03e7)),
)


@pytest.fixture
def calibrated(rig: Rig) -> Rig:
    """Return a rig whose transducer of chamber 1 errs, with its calibration."""
    truth = Model().with_effect("pressure_1_bias", value=3e5)
    return replace(rig, plant=truth, calibrations=(LONG_AGO,), uncalibrated=("pressure_2_Pa",))


class Listening(Observer):
    """Keeps what the rig tells."""

    def __init__(self) -> None:
        self.heard: list[str] = []

    def rig_tells(self, line: str) -> None:
        self.heard.append(line)


def test_a_campaign_warns_first_names_its_calibrations_and_replays_as_recorded(
    tmp_path: Path,
    calibrated: Rig,
    make_test: MakeTest,
    make_campaign: MakeCampaign,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    # What the run's own filter estimated is to be in every sample.
    monkeypatch.setattr(simulated_bench, "division_of", lambda channels: None)
    observer = Listening()
    outcome = run_campaign(
        make_campaign(make_test(duration_s=3.0)), calibrated, tmp_path, observer=observer
    )
    (warning,) = (line for line in observer.heard if line.startswith("warning: "))
    assert "calibration of pressure_1_Pa (transducer PT-1) expired on 2002-03-02" in warning

    kept = json.loads((tmp_path / "results.json").read_text())
    (used,) = kept["calibrations"]
    assert used["doubt"] == "expired on 2002-03-02"
    assert (used["channel"], used["transducer"]) == ("pressure_1_Pa", "PT-1")
    assert (used["date"], used["valid_until"]) == ("2001-03-02", "2002-03-02")
    assert used["largest_correction"] == -3e5
    assert kept["uncalibrated"] == ["pressure_2_Pa"]

    recording = read_recording(tmp_path / str(outcome.tests[0].recording))
    (applied,) = recording.metadata["calibrations"]
    assert applied["points"][0] == {"reference": 0.0, "indicated": 3e5}
    assert recording.metadata["uncalibrated"] == ["pressure_2_Pa"]
    error = recording["pressure_1_Pa"] - recording["true_pressure_1_Pa"]
    assert abs(error.mean()) < 3e3
    again = replay(recording, Model(), filter_name="product").run
    np.testing.assert_array_equal(recording["est_pressure_1_Pa"], again.state("pressure_1_Pa"))


def test_a_calibration_that_ends_during_a_campaign_is_in_doubt(calibrated: Rig) -> None:
    held, later = date(2002, 3, 1), date(2002, 3, 3)
    assert calibrations_used(calibrated, [held])[0].doubt == ""
    assert calibrations_used(calibrated, [held, later])[0].doubt == "expired on 2002-03-02"


def test_a_rig_without_calibrations_leaves_no_trace_of_them(rig: Rig) -> None:
    assert calibrations_used(rig, [date(2026, 1, 1)]) == ()


def test_recordings_name_their_calibrations_again_each_once_and_doubt_the_expired() -> None:
    applied = {
        "channel": "pressure_1_Pa", "transducer": "PT-1", "date": "2026-03-02",
        "valid_until": "2027-03-02", "largest_correction": -2e4, "unit": "Pa",
    }  # fmt: skip

    def recorded(day: date, named: object) -> Recording:
        start_ns = int(datetime(day.year, day.month, day.day, 12, tzinfo=UTC).timestamp()) * 10**9
        metadata = {"calibrations": named, "uncalibrated": ["load_N"], "start_ns": start_ns}
        return Recording({"time_s": np.zeros(1)}, metadata)

    held, late = recorded(date(2026, 6, 1), [applied]), recorded(date(2027, 6, 1), [applied])
    used = CalibrationUsed("pressure_1_Pa", "PT-1", "2026-03-02", "2027-03-02", -2e4, "Pa")
    assert calibrations_recorded([held, held]) == ((used,), ("load_N",))
    ((doubtful,), _) = calibrations_recorded([held, late])
    assert doubtful.doubt == "recorded on 2027-06-01, outside its validity"
    for foreign in ({"a": 1}, [3], [{"channel": "x"}], "none", None):
        assert calibrations_recorded([recorded(date(2026, 6, 1), foreign)])[0] == ()
