"""`rig check` tells how a ram will follow before it moves, as the simulated loop then shows."""

from dataclasses import replace

import numpy as np
import pytest

from control import ControlSettings, Setpoint, Sine, Steps
from rig.configuration import Rig, load_campaign, load_rig, plan_campaign
from rig.configuration.campaigns.following import expected_following
from rig.plant import Model
from rig.runner.campaign.bench import plain_test
from tools.tracking.runs import STEPS, run

AHEAD = ControlSettings(feedforward="model", integral_time=1.0)
FAST = Sine(0.3, 0.15, 0.5, 0.1)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("simulated")


@pytest.mark.parametrize("control", [ControlSettings(), AHEAD])
def test_the_expected_error_is_that_of_the_simulated_rig(
    rig: Rig, control: ControlSettings
) -> None:
    moved = run(rig, FAST, 10.0, control)
    test = plain_test("sine", FAST, 10.0, 0.3, 2.0)
    found = expected_following(test, replace(rig, control=control), Model())
    assert found.rms == pytest.approx(moved.rms(), rel=0.1, abs=3e-4)
    assert found.worst == pytest.approx(np.abs(moved.error()).max(), rel=0.1, abs=2e-3)


@pytest.mark.parametrize(
    ("setpoint", "needs"), [(Sine(0.3, 0.15, 0.5), 7.2), (Sine(0.3, 0.15, 0.7), 10.2)]
)
def test_the_motion_itself_asks_for_so_many_volts(
    rig: Rig, setpoint: Setpoint, needs: float
) -> None:
    test = plain_test("sine", setpoint, 5.0, 0.3, 2.0)
    assert expected_following(test, rig, Model()).needed_V == pytest.approx(needs, rel=0.02)


def test_the_error_of_steps_is_foreseen_with_the_gain_of_the_test(rig: Rig) -> None:
    control = replace(AHEAD, integral_time=0.6)
    moved = run(rig, STEPS, 6.0, control, 100.0)
    test = replace(plain_test("steps", STEPS, 6.0, 0.3, 2.0), gain_V_per_m=100.0)
    found = expected_following(test, replace(rig, control=control), Model())
    assert found.rms == pytest.approx(moved.rms(), rel=0.1)
    assert found.law.startswith("100 V/m")


@pytest.mark.parametrize("step", [0.2, 0.02, 1e-3])
def test_a_jump_is_an_error_but_no_motion_that_needs_volts(rig: Rig, step: float) -> None:
    test = plain_test("steps", Steps((0.2, 0.2 + step), 2.0), 6.0, 0.2, 2.0)
    found = expected_following(test, rig, Model())
    assert found.needed_V == 0.0
    assert found.worst == pytest.approx(step, abs=2e-3)


def test_the_law_is_told_in_words(rig: Rig) -> None:
    test = plain_test("sine", FAST, 5.0, 0.3, 2.0)
    assert expected_following(test, rig, Model()).law == "50 V/m alone"
    own = replace(test, control=replace(AHEAD, cyclic=True))
    assert expected_following(own, rig, Model()).law == (
        "50 V/m, feedforward, integral of 1 s, before its frequencies are corrected"
    )


def test_tests_that_differ_by_their_gain_alone_are_expected_to_follow_differently() -> None:
    campaign, rig = load_campaign("quickstart")
    first = next(test for test in campaign.tests if test.setpoint.quantity == "position")
    tests = tuple(replace(first, name=f"{gain:g}", gain_V_per_m=gain) for gain in (50.0, 200.0))
    slow, quick = (each.following for each in plan_campaign(replace(campaign, tests=tests), rig))
    assert slow is not None
    assert quick is not None
    assert quick.worst < 0.5 * slow.worst
    assert "200 V/m" in str(quick)
