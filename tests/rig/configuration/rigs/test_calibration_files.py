"""Needles that a rig file takes from what `rig calibrate valves` wrote."""

from datetime import date
from pathlib import Path

import pytest

from faults.needle import NeedleCharacteristic
from faults.needle_calibration import CalibratedPoint, Estimate, NeedleCalibration
from rig.configuration import ConfigError, load_rig
from rig.configuration.rigs.calibration_file import dump_calibration

DAY = date(2026, 3, 2)
POINTS = (
    CalibratedPoint(0.0, Estimate(-1e-12, 2e-12), 1e-12),
    CalibratedPoint(0.1, Estimate(3e-12, 2e-12), 1e-12),
    CalibratedPoint(0.25, Estimate(1.23456e-9, 2e-12), -3e-12),
    CalibratedPoint(1.0, Estimate(2.6e-8, 1e-11), 2e-11),
)
NEEDLE = NeedleCharacteristic((0.0, 0.25, 1.0), (0.0, 1.23456e-9, 2.6e-8), DAY, 'valve "3", today')
RIG = """name: small
plant: nominal
limits: {position: [5 mm, 0.6 m], command: 10 V, pressure: 20 MPa}
bypass_valves:
  internal_leakage:
    needle: {calibration: measured/needles.yaml}
"""


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    """Return a rig file whose needle is in the calibration file beside it."""
    rig = tmp_path / "rig.yaml"
    rig.write_text(RIG)
    calibration_file(rig).parent.mkdir()
    needles = {"internal_leakage": NeedleCalibration(NEEDLE, POINTS)}
    dump_calibration(calibration_file(rig), "small: rig", DAY, needles)
    return rig


def calibration_file(rig_file: Path) -> Path:
    return rig_file.parent / "measured" / "needles.yaml"


def problem_of(rig_file: Path) -> str:
    with pytest.raises(ConfigError) as caught:
        load_rig(rig_file)
    (problem,) = caught.value.problems
    return str(problem)


def test_a_rig_file_takes_its_needle_from_a_calibration_file(rig_file: Path) -> None:
    assert load_rig(rig_file).bypass_valves["internal_leakage"].needle == NEEDLE


def test_the_path_counts_from_the_file_that_names_it_also_in_a_parent(rig_file: Path) -> None:
    child = rig_file.parent / "elsewhere" / "child.yaml"
    child.parent.mkdir()
    child.write_text(f"name: child\nparent: {rig_file}\n")
    assert load_rig(child).bypass_valves["internal_leakage"].needle == NEEDLE


def test_points_that_the_meter_did_not_resolve_are_kept_as_comments(rig_file: Path) -> None:
    text = calibration_file(rig_file).read_text()
    assert "# 0.1: below what the meter resolves: 7.0e-12 at most" in text
    assert "- [0.25, 1.23456e-09 m^3/(s Pa^0.5)]  # +- 2.0e-12, -3.0e-12" in text


def test_a_calibration_that_cannot_be_written_leaves_the_earlier_one(rig_file: Path) -> None:
    path = calibration_file(rig_file)
    before = path.read_bytes()
    with pytest.raises(AttributeError):
        dump_calibration(path, "small", DAY, {"internal_leakage": None})  # type: ignore[dict-item]
    assert path.read_bytes() == before
    assert list(path.parent.iterdir()) == [path]


@pytest.mark.parametrize(
    ("old", "new", "reported"),
    [
        (
            "measured/needles",
            "measured/none",
            "6:14 calibration: {folder}/measured/none.yaml cannot be read",
        ),
        ("measured/needles.yaml", "[1]", "6:14 calibration: [1] should be a valid string"),
        ("needles.yaml", "needles.yaml, id: x", "6:50 id: is not a known key"),
        (
            "internal_leakage",
            "external_leakage_1",
            "6:14 calibration: {folder}/measured/needles.yaml has no needle of external_leakage_1; "
            "needles there: internal_leakage; measure it by `rig calibrate valves --valve ext",
        ),
    ],
)
def test_a_reference_that_leads_nowhere_is_placed_in_the_rig_file(
    rig_file: Path, old: str, new: str, reported: str
) -> None:
    rig_file.write_text(RIG.replace(old, new))
    assert f"{rig_file}:{reported.format(folder=rig_file.parent)}" in problem_of(rig_file)


@pytest.mark.parametrize(
    ("old", "new", "reported"),
    [
        ("[1, ", "[0.9, ", "openings: 0.9 is not 1; end with the fully open valve"),
        ("2.6e-08 m^3/(s Pa^0.5)", "2.6e-08", "points: a list has no unit; write a leakage coef"),
        ("date: 2026-03-02\nneedles", "needles", "lacks the key date"),
        ("needles:\n", "needels:\n", "needels: is not a known key; did you mean needles?"),
    ],
)
def test_a_mistake_in_a_calibration_file_is_placed_there(
    rig_file: Path, old: str, new: str, reported: str
) -> None:
    path = calibration_file(rig_file)
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    found = problem_of(rig_file)
    assert f"{path}:" in found
    assert reported in found
