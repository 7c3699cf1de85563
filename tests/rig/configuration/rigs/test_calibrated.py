"""The calibrations that a rig file names: which may be used, and what is said of them."""

from datetime import date, timedelta
from pathlib import Path

import pytest

from rig.configuration import ConfigError, check, load_rig
from rig.configuration.campaigns import plain
from rig.configuration.rigs.calibrated import corrected_twice
from rig.plant import Model

DAY = date(2026, 6, 1)
RIG = """name: small
plant: nominal
limits: {position: [5 mm, 0.6 m], command: 10 V, pressure: 20 MPa}
supply_pressure_sensor: true
"""
FILE = """channel: CHANNEL
transducer: LABEL
date: 2026-03-02
valid_for: 12 months
points:
  - {reference: 0 MPa, indicated: 0.02 MPa}
  - {reference: 15 MPa, indicated: 15.1 MPa}
"""
CAMPAIGN = """name: still
rig: ../rigs/small.yaml
tests:
  - {name: rest, setpoint: {type: constant, value: 0.3 m}, duration: 20 s, expect: healthy}
"""


@pytest.fixture
def home(tmp_path: Path) -> Path:
    """Return a folder of configurations with calibrations of both chamber pressures."""
    for folder in ("rigs", "transducers", "campaigns"):
        (tmp_path / folder).mkdir()
    for number in (1, 2):
        text = FILE.replace("CHANNEL", f"pressure_{number}_Pa").replace("LABEL", f"PT-{number}")
        (tmp_path / "transducers" / f"p{number}.yaml").write_text(text)
    return tmp_path


def rig_file(home: Path, added: str) -> Path:
    path = home / "rigs" / "small.yaml"
    path.write_text(RIG + added)
    return path


def problems_of(path: Path, day: date = DAY) -> list[str]:
    with pytest.raises(ConfigError) as caught:
        load_rig(path, day=day)
    return [str(problem).partition("small.yaml:")[2] for problem in caught.value.problems]


def test_a_file_is_named_by_path_or_by_name(home: Path) -> None:
    rig = load_rig(rig_file(home, "calibrations: [../transducers/p1.yaml, p2]\n"), day=DAY)
    assert [each.transducer for each in rig.calibrations] == ["PT-1", "PT-2"]


def test_channels_without_calibration_are_known_where_one_has_one(home: Path) -> None:
    assert not load_rig(rig_file(home, "")).uncalibrated
    named = load_rig(rig_file(home, "calibrations: [p1]\n"), day=DAY).uncalibrated
    assert {"pressure_2_Pa", "supply_pressure_Pa", "position_m"} <= set(named)
    assert not {"pressure_1_Pa", "load_N", "spool_m"} & set(named)


def test_a_path_counts_from_the_file_that_names_it_also_in_a_parent(home: Path) -> None:
    parent = rig_file(home, "calibrations: [../transducers/p1.yaml]\n")
    child = home / "child.yaml"
    child.write_text(f"name: child\nparent: {parent}\n")
    assert [each.transducer for each in load_rig(child, day=DAY).calibrations] == ["PT-1"]


@pytest.mark.parametrize(
    ("changed", "named", "problem"),
    [
        ("", "[p1, p1]", "5:20 calibrations[1]: p1 is a second calibration of press"),
        (
            "PT-1",
            "[p1, p2]",
            "5:20 calibrations[1]: p2 is of transducer PT-1, which reads pressure",
        ),
        (
            "",
            "[p3]",
            "5:16 calibrations[0]: p3 is not a known transducer; available transducers: p1",
        ),
        ("", "p1", "5:1 calibrations: p1 is not a list; write a list of transducer files"),
        ("", "[[p1]]", "5:16 calibrations[0]: [p1] is not the name or path of a transducer file"),
    ],
)
def test_a_list_that_means_no_rig_is_refused(
    home: Path, changed: str, named: str, problem: str
) -> None:
    second = home / "transducers" / "p2.yaml"
    second.write_text(second.read_text().replace("PT-2", changed or "PT-2"))
    (found,) = problems_of(rig_file(home, f"calibrations: {named}\n"))
    assert found.startswith(problem)


def test_a_channel_that_the_rig_does_not_measure_is_refused(home: Path) -> None:
    path = home / "transducers" / "p1.yaml"
    path.write_text(path.read_text().replace("pressure_1_Pa", "load_N").replace("MPa", "kN"))
    (problem,) = problems_of(rig_file(home, "calibrations: [p1]\n"))
    assert "is of load_N, which this rig does not measure; correct the channel" in problem


def test_one_device_may_measure_two_quantities(home: Path) -> None:
    path = home / "transducers" / "p2.yaml"
    text = path.read_text().replace("pressure_2_Pa", "oil_temperature_K").replace("PT-2", "PT-1")
    path.write_text(text.replace("MPa", "K"))
    rig = home / "rigs" / "small.yaml"
    rig.write_text("name: small\nparent: emulated\ncalibrations: [p1, p2]\n")
    assert len(load_rig(rig, day=DAY).calibrations) == 2


def test_an_encoder_that_is_homed_takes_no_calibration(home: Path) -> None:
    path = home / "transducers" / "p1.yaml"
    path.write_text(path.read_text().replace("pressure_1_Pa", "position_m").replace("MPa", "m"))
    assert load_rig(rig_file(home, "calibrations: [p1]\n"), day=DAY).calibrations
    homed = "calibrations: [p1]\nhoming: {end: retract, command: 0.5 V}\n"
    (problem,) = problems_of(rig_file(home, homed))
    assert "is of an encoder whose zero is found anew in every session" in problem


def test_hardware_measures_what_its_drivers_read(home: Path) -> None:
    path = home / "rigs" / "small.yaml"
    path.write_text("name: small\nparent: emulated\ncalibrations: [p1]\n")
    rig = load_rig(path, day=DAY)
    assert {"flow_1_m3_per_s", "pump_pressure_Pa"} <= set(rig.uncalibrated)
    assert rig.calibrations[0].channel == "pressure_1_Pa"


@pytest.mark.parametrize("day", [date(2026, 3, 1), date(2027, 3, 3)])
def test_a_calibration_that_does_not_hold_is_refused_if_the_rig_says_so(
    home: Path, day: date
) -> None:
    added = "calibrations: [p1]\nexpired_calibrations: refuse\n"
    path = rig_file(home, added)
    assert load_rig(path, day=DAY).calibrations
    (problem,) = problems_of(path, day)
    assert problem.startswith("5:16 calibrations[0]: p1 ")
    assert "; name the file of a calibration that holds today in the rig file, or" in problem
    assert load_rig(rig_file(home, added.replace("refuse", "warn")), day=day).calibrations


def test_a_campaign_is_refused_with_its_rig(home: Path) -> None:
    rig_file(home, "calibrations: [p1]\nexpired_calibrations: refuse\n")
    campaign = home / "campaigns" / "still.yaml"
    campaign.write_text(CAMPAIGN)
    assert "calibration" not in " ".join(check(campaign, day=DAY).warnings[1:])
    with pytest.raises(ConfigError, match="p1 expired on 2027-03-02"):
        check(campaign, day=date(2027, 3, 3))


def test_a_check_names_calibrations_and_warns_in_time(home: Path) -> None:
    path = rig_file(home, "calibrations: [p1]\n")
    text = str(check(path, day=DAY))
    assert "calibration of pressure_1_Pa (transducer PT-1): of 2026-03-02, until 2027-03-02" in text
    assert "largest correction -100 kPa" in text
    assert "without calibration: position_m, pressure_2_Pa, supply_pressure_Pa" in text
    last = date(2027, 3, 2)
    for day, warning in (
        (last - timedelta(days=29), "expires in 29 days"),
        (last + timedelta(days=1), "expired on 2027-03-02"),
        (date(2026, 3, 1), "is not valid before 2026-03-02"),
    ):
        assert any(warning in each for each in check(path, day=day).warnings)


def test_limits_beyond_the_calibrated_range_are_pointed_out(home: Path) -> None:
    path = rig_file(home, "calibrations: [p1]\n")
    (warning,) = check(path, day=DAY).warnings
    assert "reaches from 0 Pa to 15 MPa, and the limits allow 0 Pa to 20 MPa" in warning


def test_a_model_that_undoes_the_same_error_is_pointed_out(home: Path) -> None:
    calibrations = load_rig(rig_file(home, "calibrations: [p1]\n"), day=DAY).calibrations
    assert not list(
        corrected_twice(calibrations, Model().with_effect("pressure_2_bias", value=1e4))
    )
    (warning,) = corrected_twice(calibrations, Model().with_effect("pressure_1_bias", value=1e4))
    assert "has pressure_1_bias, and the calibration of pressure_1_Pa" in warning


def test_a_rig_without_calibrations_is_recorded_as_before(home: Path) -> None:
    recorded = plain(load_rig(rig_file(home, "expired_calibrations: refuse\n")))
    assert not {"calibrations", "uncalibrated"} & set(recorded)


def test_a_needle_table_and_a_calibration_of_a_transducer_are_not_mixed_up(home: Path) -> None:
    bypass = "bypass_valves: {internal_leakage: {needle: {calibration: ../transducers/p1.yaml}}}\n"
    with pytest.raises(ConfigError, match="belongs in the rig file's list `calibrations`"):
        load_rig(rig_file(home, bypass))
