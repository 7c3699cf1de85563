"""The valves are moved so that each fault comes when and as large as the test says."""

from math import inf

import pytest

from faults.schedule import Fault
from rig.configuration import Rig, load_rig
from rig.supervisor.moves import moves, preparing_moves


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("emulated")


def leak(until_s: float = inf, ramp_s: float = 0.0, travel_s: float = 0.0) -> Fault:
    return Fault(
        "external_leakage_1", 1e-8, at_s=2.0, until_s=until_s, ramp_s=ramp_s, travel_s=travel_s
    )


def test_before_a_test_every_ball_is_shut_and_the_needle_stands_ready(rig: Rig) -> None:
    outputs = preparing_moves(rig, [leak()])
    assert {value for name, value in outputs.items() if name.endswith("_ball")} == {0.0}
    valve = rig.bypass_valves["external_leakage_1"]
    assert valve.effective(outputs["external_leakage_1_needle"]) == pytest.approx(1e-8)
    assert outputs["external_leakage_2_needle"] == 0.0
    assert outputs["return_blockage_needle"] == 0.0


def test_the_ball_turns_at_the_tick_of_the_fault_and_back_at_its_end(rig: Rig) -> None:
    assert moves(rig, [leak(until_s=5.0)]) == (
        (2000, {"external_leakage_1_ball": 1.0}),
        (5000, {"external_leakage_1_ball": 0.0}),
    )


def test_a_ramp_moves_the_needle_in_steps_up_to_the_coefficient(rig: Rig) -> None:
    made = moves(rig, [leak(ramp_s=1.0)])
    steps = [outputs["external_leakage_1_needle"] for _, outputs in made if len(outputs) and
             "external_leakage_1_needle" in outputs]  # fmt: skip
    assert steps == sorted(steps)
    assert len(steps) == 11
    assert rig.bypass_valves["external_leakage_1"].effective(steps[-1]) == pytest.approx(1e-8)
    assert made[-1][0] == 3000


def test_a_second_fault_of_a_bypass_finds_its_needle_set_while_the_ball_is_shut(rig: Rig) -> None:
    first, second = leak(until_s=4.0, travel_s=0.5), Fault("external_leakage_1", 2e-8, at_s=8.0)
    made = dict(moves(rig, [second, first]))
    needle = made[4500]["external_leakage_1_needle"]
    assert rig.bypass_valves["external_leakage_1"].effective(needle) == pytest.approx(2e-8)
    prepared = preparing_moves(rig, [second, first])["external_leakage_1_needle"]
    assert rig.bypass_valves["external_leakage_1"].effective(prepared) == pytest.approx(1e-8)


def test_a_blockage_is_the_throttle_s_share_of_its_greatest_resistance(rig: Rig) -> None:
    assert rig.return_valve is not None
    fault = Fault("return_blockage", 0.25 * rig.return_valve.maximum, at_s=1.0, until_s=2.0)
    assert moves(rig, [fault]) == (
        (1000, {"return_blockage_needle": 0.25}),
        (2000, {"return_blockage_needle": 0.0}),
    )


def test_a_leak_that_goes_on_moves_the_needle_alone(rig: Rig) -> None:
    first = Fault("internal_leakage", 2e-9, at_s=1.0, until_s=2.0, travel_s=0.5)
    second = Fault("internal_leakage", 4e-9, at_s=2.0, until_s=3.0, travel_s=0.5)
    made = moves(rig, (first, second))
    needle = rig.bypass_valves["internal_leakage"].needle_opening_for(4e-9)
    assert list(made) == [
        (1000, {"internal_leakage_ball": 1.0}),
        (2000, {"internal_leakage_needle": pytest.approx(needle)}),
        (3000, {"internal_leakage_ball": 0.0}),
    ]
