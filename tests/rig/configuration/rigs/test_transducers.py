"""Transducer files: a calibration as its certificate has it, or what is wrong with it."""

from datetime import date
from pathlib import Path

import pytest

from rig.configuration import ConfigError, check
from rig.configuration.reading.document import Sources
from rig.configuration.rigs.transducers import read_transducer
from rig.io.transducer_calibration import CalibrationPoint, TransducerCalibration

FILE = """channel: pressure_1_Pa
transducer: PT-1
date: 2026-03-02
valid_until: 2027-03-02
laboratory: a test house
certificate: 4711
uncertainty: 10 kPa
points:
  - {reference: 20 MPa, indicated: 20.1 MPa}
  - {reference: 0 MPa, indicated: 0.2 bar}
"""


def read(folder: Path, text: str) -> TransducerCalibration:
    path = folder / "transducer.yaml"
    path.write_text(text)
    sources = Sources()
    root = sources.read_yaml(path)
    return sources.finished(read_transducer(root) if root is not None else None)


def problems_of(folder: Path, text: str) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        read(folder, text)
    return [str(problem).partition("transducer.yaml:")[2] for problem in caught.value.problems]


def test_a_file_gives_a_calibration_in_si_with_rising_points(tmp_path: Path) -> None:
    assert read(tmp_path, FILE) == TransducerCalibration(
        "pressure_1_Pa",
        "PT-1",
        date(2026, 3, 2),
        date(2027, 3, 2),
        (CalibrationPoint(0.0, 2e4), CalibrationPoint(2e7, 2.01e7)),
        "a test house",
        "4711",
        1e4,
    )


@pytest.mark.parametrize(
    ("period", "until"),
    [
        ("30 days", date(2024, 3, 30)),
        ("12 months", date(2025, 2, 28)),
        ("1 month", date(2024, 3, 29)),
        ("4 years", date(2028, 2, 29)),
    ],
)
def test_a_period_counts_by_the_calendar(tmp_path: Path, period: str, until: date) -> None:
    text = FILE.replace("date: 2026-03-02", "date: 2024-02-29")
    text = text.replace("valid_until: 2027-03-02", f"valid_for: {period}")
    assert read(tmp_path, text).valid_until == until


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("pressure_1_Pa", "pressure_3_Pa", "1:1 channel: pressure_3_Pa is no channel of a transd"),
        ("pressure_1_Pa", "command_V", "1:1 channel: command_V is no channel of a transducer"),
        ("transducer: PT-1\n", "", "1:1 file: lacks the key transducer"),
        ("until: 2027", "until: 2025", "4:1 valid_until: 2025-03-02 is before the day of the cal"),
        ("valid_until: 2027-03-02\n", "", "1:1 calibration: does not say how long it holds; add"),
        ("laboratory", "valid_for: 1 year\nlaboratory", "5:1 valid_for: 1 year is given beside"),
        (
            "valid_until: 2027-03-02",
            "valid_for: 2 decades",
            "4:1 valid_for: 2 decades is no period",
        ),
        (
            "valid_until: 2027-03-02",
            "valid_for: 9999 years",
            "4:1 valid_for: 9999 years ends after",
        ),
        ("10 kPa", "10 mm", "7:1 uncertainty: 10 mm is not a pressure"),
        ("10 kPa", "-10 kPa", "7:1 uncertainty: -10 kPa is below"),
        ("0.2 bar", "0.2", "10:24 indicated: 0.2 has no unit"),
        (", indicated: 0.2 bar", "", "10:5 points[1]: lacks the key indicated"),
        (
            "  - {reference: 0 MPa, indicated: 0.2 bar}\n",
            "",
            "8:1 points: 1 are too few for a line",
        ),
        ("reference: 0 MPa", "reference: 20 MPa", "10:6 reference: 20 MPa is given twice"),
        ("20.1 MPa", "201 MPa", "9:25 indicated: 201 MPa is 181 MPa from the reference, more than"),
        ("laboratory", "colour", "5:1 colour: is not a known key"),
        (
            "laboratory",
            "needles",
            "5:1 needles: is not a known key; a file of `rig calibrate valve",
        ),
    ],
)
def test_a_mistake_is_told_with_line_value_and_remedy(
    tmp_path: Path, old: str, new: str, problem: str
) -> None:
    assert any(each.startswith(problem) for each in problems_of(tmp_path, FILE.replace(old, new)))


def test_a_point_that_its_neighbours_do_not_confirm_is_refused(tmp_path: Path) -> None:
    text = FILE + "  - {reference: 1 MPa, indicated: 1.3 MPa}\n"
    (problem,) = problems_of(tmp_path, text)
    assert problem.startswith("11:24 indicated: 1.3 MPa changes the correction by more than 25 %")


def test_a_check_describes_a_file_and_warns_on_the_day_that_is_given(tmp_path: Path) -> None:
    path = tmp_path / "p1.yaml"
    path.write_text(FILE)
    report = check(path, day=date(2026, 6, 1))
    assert report.kind == "transducer"
    assert "2 points from 0 Pa to 20 MPa, largest correction -100 kPa" in str(report)
    assert not report.warnings
    assert "expires in 1 day:" in str(check(path, day=date(2027, 3, 1)))
    assert "expired on 2027-03-02" in str(check(path, day=date(2027, 3, 3)))


@pytest.mark.parametrize(
    ("good", "bad", "said"),
    [
        ("valid_until: 2027-03-02", "valid_for: 12 moons", "4:1 valid_for: 12 moons is no period"),
        ("date: 2026-03-02", "date: 2026-02-30", "3:1 date: 2026-02-30 cannot be read"),
        (
            "valid_until: 2027-03-02",
            "valid_until: 2027-02-30",
            "4:1 valid_until: 2027-02-30 cannot",
        ),
    ],
)
def test_a_wrong_time_is_one_problem_and_not_said_to_be_lacking_too(
    tmp_path: Path, good: str, bad: str, said: str
) -> None:
    (problem,) = problems_of(tmp_path, FILE.replace(good, bad))
    assert problem.startswith(said)
    assert "quote it" not in problem
