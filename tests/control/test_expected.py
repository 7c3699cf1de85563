"""Where a ram should be without an integral part: that is all that an integral may go by."""

from dataclasses import replace

import numpy as np
import pytest

from control import ControlSettings, Setpoint, Sine, Steps
from control.expected import expected_position
from rig.configuration import load_rig
from rig.plant import NOMINAL, Model, Parameters
from rig.plant.integrator import TICK
from tools.tracking.runs import Run, run

PI = ControlSettings(feedforward="model", integral_time=0.6)
TIME = np.arange(6000, dtype=np.float64) * TICK
STEP = Steps((0.2, 0.24), 1.0)
LARGE = Steps((0.2, 0.45), 1.0)
SPRUNG = Model().with_effect("spring_load", stiffness=2e4, contact=0.22)


def expected(setpoint: Setpoint, settings: ControlSettings = PI, gain: float = 100.0) -> np.ndarray:
    return expected_position(setpoint.sample(TIME), settings, NOMINAL, gain, 10.0)


def test_compiled_code_and_plain_python_expect_the_same() -> None:
    samples = LARGE.sample(TIME)
    plain = expected_position(samples, PI, NOMINAL, 100.0, 10.0, compiled=False)
    np.testing.assert_array_equal(expected(LARGE), plain)


def test_without_an_integral_part_nothing_is_expected() -> None:
    assert expected(STEP, ControlSettings(feedforward="model")).size == 0


@pytest.mark.parametrize(
    "settings", [PI, replace(PI, feedforward="none"), replace(PI, feedforward_gain=0.0)]
)
def test_a_motion_without_jumps_is_expected_to_be_followed_whatever_the_law_adds(
    settings: ControlSettings,
) -> None:
    sine = Sine(0.3, 0.15, 0.5, -np.pi / 2)
    assert np.abs(expected(sine, settings) - sine.sample(TIME)).max() < 1e-3


@pytest.mark.parametrize(
    "par",
    [
        NOMINAL,
        NOMINAL._replace(spool_null_bias=1e-5, valve_deadband=2e-5),
        NOMINAL._replace(spring_stiffness=2e4, spring_contact=0.22),
    ],
)
def test_the_expected_position_always_ends_at_a_resting_setpoint(par: Parameters) -> None:
    for setpoint in (STEP, LARGE):
        samples = setpoint.sample(TIME)
        found = expected_position(samples, PI, par, 50.0, 10.0)
        assert abs(found[-1] - samples[-1]) < 1e-5
        assert found.max() <= samples.max() + 1e-5


def test_a_step_takes_the_time_that_gain_and_measured_speed_give_it() -> None:
    measured = ControlSettings(feedforward_gain=20.0, integral_time=0.6)
    found = expected(STEP, measured, gain=20.0)
    # A speed of 1/20 m/(s V) under 20 V/m: a time constant of 1 s.
    left = (0.24 - found[3000]) / (0.24 - found[2000])
    assert left == pytest.approx(np.exp(-1.0), abs=0.01)


def test_a_large_step_is_expected_no_faster_than_the_valve_allows() -> None:
    assert np.diff(expected(LARGE)).max() / TICK < 0.75


def overshoot(moved: Run) -> float:
    return max(part for part, _ in moved.step_answers())


@pytest.mark.parametrize(
    ("plant", "most"),
    [
        (Model(), 0.02),
        (Model(parameters=NOMINAL._replace(area_gradient=0.8 * NOMINAL.area_gradient)), 0.04),
        (SPRUNG, 0.04),
        (Model(parameters=NOMINAL._replace(spool_null_bias=0.4 * NOMINAL.valve_gain)), 0.02),
    ],
)
def test_steps_hardly_overshoot_also_on_rigs_that_the_model_does_not_know(
    plant: Model, most: float
) -> None:
    rig = replace(load_rig("simulated"), plant=plant)
    moved = run(rig, Steps((0.3, 0.32, 0.28), 2.0), 6.0, PI, 100.0)
    assert overshoot(moved) < most
    # What a wrong model, a spring or a null bias leaves is still taken up.
    assert np.abs(moved.error(5.8)).max() < 6e-4
