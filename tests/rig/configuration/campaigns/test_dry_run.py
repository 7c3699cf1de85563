"""What a check shows of a campaign before anything moves."""

from math import inf, sqrt
from pathlib import Path

import numpy as np
import pytest

from rig.configuration import ConfigError
from rig.configuration.campaigns.dry_run import valve_speed
from rig.configuration.checking import CheckReport, check
from rig.plant.effects import Model
from rig.plant.parameters import NOMINAL
from rig.plant.simulation import simulate


def check_test(folder: Path, keys: str, rig: str = "ideal") -> CheckReport:
    path = folder / "campaign.yaml"
    body = "".join(f"    {line}\n" for line in keys.splitlines())
    path.write_text(f"name: c\nrig: {rig}\ntests:\n  - name: a\n    duration: 20 s\n{body}")
    return check(path)


def test_the_dry_run_shows_how_long_the_rig_is_busy() -> None:
    minutes, seconds = divmod(7 * (40 + 2), 60)
    assert f"rig time {minutes} min {seconds} s" in str(check("quickstart"))


def test_the_dry_run_shows_motion_and_speed_against_what_the_valve_delivers(
    tmp_path: Path,
) -> None:
    report = check_test(
        tmp_path, "setpoint: {type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 0.5 Hz}"
    )
    (test,) = report.tests
    assert test.position_range_m == pytest.approx((0.1, 0.5))
    assert test.peak_speed_m_per_s == pytest.approx(np.pi * 0.2)
    assert test.valve_speed_m_per_s == pytest.approx(26.6 / 6e4 / 6.33e-4, rel=2e-3)
    assert report.warnings == ()


def test_a_fully_open_valve_moves_an_unloaded_ram_at_the_speed_stated() -> None:
    frictionless = NOMINAL._replace(stiction=0.0, coulomb=0.0, viscous=0.0)
    motion = simulate(Model("x", frictionless), np.full(500, 10.0), position=0.05)
    assert motion["velocity"][-100:].mean() == pytest.approx(valve_speed(NOMINAL, 10.0), rel=1e-3)


def test_a_setpoint_faster_than_the_valve_is_warned_of(tmp_path: Path) -> None:
    setpoint = "setpoint: {type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 1 Hz}"
    (warning,) = check_test(tmp_path, setpoint).warnings
    assert warning.startswith("a: the setpoint moves at up to 1.3 m/s, the valve delivers 0.7 m/s")


def test_a_setpoint_in_jumps_has_no_speed_to_compare(tmp_path: Path) -> None:
    # The ram rests at the end, which the dry run would warn of in a test that expects healthy.
    setpoint = "expect: inconclusive\nsetpoint: {type: steps, levels: [0.1 m, 0.4 m], hold: 2 s}"
    report = check_test(tmp_path, setpoint)
    assert report.tests[0].peak_speed_m_per_s == inf
    assert "in jumps" in str(report)
    assert report.warnings == ()


def test_an_open_loop_run_that_drifts_out_of_the_stroke_is_warned_of(tmp_path: Path) -> None:
    leak = (
        "setpoint: {type: sine, amplitude: 3 V, frequency: 0.5 Hz, phase: 0.1 rad}\n"
        "faults: [{type: external_leakage_1, at: 5 s, flow: 1.2 L/min, pressure: 6.9 MPa}]\n"
    )
    (warning,) = check_test(tmp_path, leak + "start_position: 0.1 m").warnings
    assert "the ram drifts beyond the limits of 5 mm to 0.6 m" in warning
    safe = check_test(tmp_path, leak + "start_position: 0.4 m")
    assert safe.warnings == ()
    low, high = safe.tests[0].position_range_m
    assert 0.15 < low < 0.39
    assert 0.4 < high < 0.6
    assert safe.tests[0].command_range_V == pytest.approx((-3.0, 3.0), abs=1e-3)


def test_the_printed_amplitude_of_section_7_2_stalls_the_ram(tmp_path: Path) -> None:
    keys = (
        "load: {stiffness: 6e5 N/m, contact: 0.176 m}\n"
        "setpoint: {type: sine, mean: 0.177 m, amplitude: 0.02 m, frequency: 0.5 Hz}"
    )
    (warning,) = check_test(tmp_path, keys).warnings
    assert "the spring pushes back with 12.6 kN, the ram stalls at 8.735 kN" in warning


def test_a_fault_is_listed_with_its_flow_and_opening_or_a_blockage_with_its_coefficient(
    tmp_path: Path,
) -> None:
    keys = (
        "setpoint: {type: constant, value: 0.3 m}\n"
        "faults:\n"
        "  - {type: external_leakage_1, at: 5 s, needle_opening: 0.5}\n"
        "  - {type: internal_leakage, at: 5 s, until: 9 s, linear_coefficient: 2e-12 m^3/(s Pa)}\n"
        "  - {type: return_blockage, at: 5 s, ramp: 3 s, coefficient: 2e13 Pa/(m^3/s)^2}\n"
    )
    leak, linear, blockage = check_test(tmp_path, keys).tests[0].faults
    assert leak.needle_opening == pytest.approx(0.5)
    flow = leak.fault.coefficient * sqrt(6.9e6) * 60e3
    assert str(leak).endswith(f": {flow:.3g} L/min at 6.9 MPa, needle at 50.0%")
    assert linear.needle_opening is None
    assert str(linear) == ("internal_leakage at 5 s until 9 s: 0.828 L/min at 6.9 MPa (linear)")
    assert str(blockage) == "return_blockage at 5 s, growing over 3 s: 2e+13 Pa/(m^3/s)^2"


def test_what_is_no_configuration_is_refused(tmp_path: Path) -> None:
    stranger = tmp_path / "stranger.yaml"
    stranger.write_text("colour: blue\n")
    with pytest.raises(ConfigError, match="is no known configuration"):
        check(stranger)
    with pytest.raises(ConfigError, match=r"did you mean quickstart\?"):
        check("quickstrat")


def test_a_campaign_can_be_checked_against_another_rig() -> None:
    assert "on the rig ideal" in str(check("quickstart", rig_override="ideal"))


@pytest.mark.parametrize("on_fault", ["tolerate", "hold", "trip"])
def test_what_is_done_about_a_fault_is_reported_beforehand(tmp_path: Path, on_fault: str) -> None:
    setpoint = "setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}"
    report = check_test(tmp_path, f"{setpoint}\non_fault: {on_fault}")
    assert f"on a confirmed fault: {on_fault}" in str(report)
    assert "on a confirmed fault" not in str(check_test(tmp_path, setpoint))


def test_tolerance_by_a_detector_that_sizes_no_leak_is_warned_of(tmp_path: Path) -> None:
    path = tmp_path / "campaign.yaml"
    path.write_text(
        "name: c\nrig: ideal\ndetector: {filter: thesis-6}\non_fault: tolerate\ntests:\n"
        "  - {name: a, duration: 20 s, setpoint: {type: constant, value: 0.3 m}}\n"
    )
    (warning,) = check(path).warnings
    assert "so that none is tolerated; judge by product" in warning


SUPPLY_LEAK = """\
setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}
faults:
  - {type: supply_leakage, at: 12 s, coefficient: 4e-9 m^3/(s Pa^0.5)}
"""


def supplied(folder: Path, droop: str, sensor: str) -> str:
    """Write a rig with such a supply, and return its path."""
    path = folder / "rig.yaml"
    path.write_text(
        f"name: supplied\nparent: ideal\nplant: {{model: nominal, effects: {{{droop}}}}}\n"
        f"supply_pressure_sensor: {sensor}\n"
    )
    return str(path)


@pytest.mark.parametrize(
    ("droop", "sensor", "reported"),
    [
        ("", "true", "does not droop"),
        ("", "false", "does not droop"),
        ("supply_droop: 2e12 Pa/(m^3/s)^2", "false", "is an unknown_fault at best"),
        ("supply_droop: 2e12 Pa/(m^3/s)^2", "true", None),
    ],
)
def test_a_supply_leak_that_cannot_be_seen_or_named_is_warned_of(
    tmp_path: Path, droop: str, sensor: str, reported: str | None
) -> None:
    warnings = check_test(tmp_path, SUPPLY_LEAK, rig=supplied(tmp_path, droop, sensor)).warnings
    assert len(warnings) == (reported is not None)
    assert all(str(reported) in warning for warning in warnings)
