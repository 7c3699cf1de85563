"""A page has a table of the calibrations that were used, if there are any."""

from collections.abc import Callable
from pathlib import Path

from rig.report import render
from rig.report.calibrations import CalibrationRow, calibration_rows
from rig.runner.outcomes.calibrations import CalibrationUsed
from rig.runner.outcomes.outcome import CampaignOutcome

EXPIRED = "expired on 2025-03-02"
USED = (
    CalibrationUsed("pressure_1_Pa", "<PT-1>", "2026-03-02", "2027-03-02", -2e4, "Pa"),
    CalibrationUsed(
        "load_N", "L-1", "2024-03-02", "2025-03-02", 35.0, "N", "expired on 2025-03-02"
    ),
)


def test_each_calibration_has_a_row_and_so_has_each_channel_without() -> None:
    rows = calibration_rows(USED, ["spool_m"])
    assert rows == (
        CalibrationRow("pressure_1_Pa", "<PT-1>", "2026-03-02", "2027-03-02", "-20 kPa", "holds"),
        CalibrationRow("load_N", "L-1", "2024-03-02", "2025-03-02", "35 N", EXPIRED, True),
        CalibrationRow("spool_m", "", "", "", "", "no calibration"),
    )

    assert calibration_rows((), ["spool_m"]) == ()


def test_the_page_shows_them_and_says_nothing_where_there_are_none(
    campaign: Callable[..., CampaignOutcome], tmp_path: Path
) -> None:
    page = render(campaign(calibrations=USED), tmp_path)
    assert "<h2>Calibrations</h2>" in page
    assert "&lt;PT-1&gt;" in page
    assert 'class="wrong">expired on 2025-03-02' in page
    assert "<h2>Calibrations</h2>" not in render(campaign(), tmp_path)
