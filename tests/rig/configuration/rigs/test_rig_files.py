"""Rig files: what a rig is, how it differs from its model, and what it must not exceed."""

import datetime
from pathlib import Path

import pytest

from faults.bypass import NOMINAL_BYPASSES
from faults.verdict import FAULT_KINDS, Verdict
from rig.configuration import ConfigError
from rig.configuration.rigs.limits import Limits
from rig.configuration.rigs.rig import Rig, load_rig
from rig.plant.parameters import KARNOPP, NOMINAL
from rig.plant.sensors import DATA_SHEET

SMALL = """
name: small
plant: nominal
limits: {position: [5 mm, 0.6 m], command: 10 V, pressure: 20 MPa}
"""


SENSORS_FITTED = ("has_load_cell", "has_spool_sensor", "has_supply_pressure_sensor")


def load_text(folder: Path, text: str) -> Rig:
    path = folder / "rig.yaml"
    path.write_text(text)
    return load_rig(path)


def test_the_simulated_rig_differs_from_every_model_as_real_rigs_do() -> None:
    rig = load_rig("simulated")
    assert rig.plant.parameters == NOMINAL._replace(
        bulk_modulus=0.96 * 6.89e8,
        viscous=1.1 * 350.0,
        discharge_coefficient=1.01 * 0.6,
        spool_null_bias=1.5e-6,
        friction_asymmetry=120.0,
        supply_droop=8e11,
    )
    assert rig.plant.effects == ("spool_null_bias", "friction_asymmetry", "supply_droop")
    assert rig.sensors == DATA_SHEET
    assert rig.limits == Limits(0.005, 0.6, 10.0, 20e6)
    assert rig.gain_V_per_m == 50.0


def test_the_simulated_rig_can_inject_every_fault_of_figure_2_3() -> None:
    rig = load_rig("simulated")
    assert rig.return_valve is not None
    assert {*rig.bypass_valves, Verdict.RETURN_BLOCKAGE} == set(FAULT_KINDS)


def test_the_simulated_rigs_bypasses_are_the_nominal_ones() -> None:
    for kind, valve in load_rig("simulated").bypass_valves.items():
        assert valve.needle.coefficients == NOMINAL_BYPASSES[kind].needle.coefficients
        assert valve.ball_coefficient == NOMINAL_BYPASSES[kind].ball_coefficient


def test_the_ideal_rig_is_the_nominal_model_behind_the_same_sensors_and_valves() -> None:
    ideal, simulated = load_rig("ideal"), load_rig("simulated")
    assert ideal.plant.parameters == NOMINAL
    assert (ideal.sensors, ideal.limits) == (simulated.sensors, simulated.limits)
    assert ideal.bypass_valves == simulated.bypass_valves


def test_the_thesis_rig_has_karnopp_friction() -> None:
    assert load_rig("thesis").plant.parameters == NOMINAL._replace(friction_law=KARNOPP)


def test_a_rig_may_lack_sensors_and_valves(tmp_path: Path) -> None:
    rig = load_text(tmp_path, SMALL)
    assert not any(getattr(rig, name) for name in SENSORS_FITTED)
    assert not rig.bypass_valves
    assert rig.return_valve is None
    assert rig.sensors == DATA_SHEET


def test_a_calibrated_needle_carries_its_points_and_day(tmp_path: Path) -> None:
    rig = load_text(
        tmp_path,
        SMALL
        + """
bypass_valves:
  internal_leakage:
    needle:
      points:
        - [0, 0 m^3/(s Pa^0.5)]
        - [50 %, 4e-9 m^3/(s Pa^0.5)]
        - [1, 2e-8 m^3/(s Pa^0.5)]
      date: 2024-03-01
      id: N-17
""",
    )
    needle = rig.bypass_valves["internal_leakage"].needle
    assert needle.coefficient(0.5) == 4e-9
    assert (needle.date, needle.id) == (datetime.date(2024, 3, 1), "N-17")


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        (
            "0.6 m]",
            "0.7 m]",
            "position: 5 mm to 0.7 m reaches beyond the stroke of 0 m to 0.6069 m",
        ),
        ("20 MPa", "10 MPa", "pressure: 10 MPa is not above the supply pressure of 13.8 MPa"),
        ("plant: nominal", "plant: nominl", "plant: nominl is not a known model"),
        ("plant: nominal", "plant: {parameters: {}}", "plant: lacks the key model"),
        ("plant: nominal", "plant: [nominal]", "plant: [nominal] is not a mapping; keys: model"),
        ("10 V", "10", "command: 10 has no unit; write a voltage"),
        ("plant", "parent: simulated\nplant", None),
        ("plant", "parent: rig.yaml\nplant", "parent: rig descends from this rig"),
        ("plant", "backend: real\nplant", "backend: real is not a choice here; choose one of simu"),
        ("plant", "load_cell: maybe\nplant", "load_cell: maybe should be a valid boolean"),
        (
            "plant",
            "sensors: {pressure_min: 1 MPa, pressure_max: 1 MPa}\nplant",
            "pressure_max: 1 MPa is not above pressure_min (1 MPa)",
        ),
        (
            "plant",
            "bypass_valves: {internal_leakage: {needle: {points: [1, 2]}}}\nplant",
            "points: [1, 2] is not a list of [opening, coefficient]; write [[0, 0 m^3/(s Pa^0.5)]",
        ),
        (
            "plant",
            "bypass_valves: {internal_leakage: {needle: {points: [[0, 0 m^3/(s Pa^0.5)], "
            "[0.5, 1e-8 m^3/(s Pa^0.5)]]}}}\nplant",
            "openings: 0.5 is not 1; end with the fully open valve",
        ),
        (
            "plant",
            "bypass_valves: {return_blockage: {travel: 1 s}}\nplant",
            "return_blockage: has no bypass; describe the valve of the return line as `retu",
        ),
    ],
)
def test_a_mistake_in_a_rig_is_named_with_its_remedy(
    tmp_path: Path, old: str, new: str, problem: str | None
) -> None:
    text = SMALL.replace(old, new, 1)
    if problem is None:
        assert load_text(tmp_path, text).return_valve is not None
        return
    with pytest.raises(ConfigError) as caught:
        load_text(tmp_path, text)
    (found,) = caught.value.problems
    assert str(found).split(" ", 1)[1].startswith(problem)
