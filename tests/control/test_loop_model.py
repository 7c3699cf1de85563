"""What a model says of the position loop agrees with the plant it is a model of."""

import numpy as np
import pytest

from control import ControlSettings, Multisine, Sine, Steps, raised_cosine
from control.guidance import LoopBasis, guide_of, law_of, moving_guide
from control.loop_model import (
    MOST_TONES,
    feedforward_command,
    frequencies_of,
    hold_band,
    loop_answer,
    velocity_gain,
)
from control.tracking import PLAIN
from rig.configuration.campaigns.dry_run import valve_speed
from rig.plant import NOMINAL, Model
from rig.plant.integrator import TICK
from rig.plant.sensors import DATA_SHEET
from rig.plant.simulation import simulate

MODEL_AHEAD = ControlSettings(feedforward="model")
TIME = np.arange(4000, dtype=np.float64) * TICK


def test_the_speed_for_a_volt_is_that_of_the_valve() -> None:
    assert velocity_gain(NOMINAL) == pytest.approx(valve_speed(NOMINAL, 1.0))
    assert velocity_gain(NOMINAL, 0.5 * NOMINAL.supply_pressure) < velocity_gain(NOMINAL)


@pytest.mark.parametrize("stiffness", [0.0, 1e4])
def test_the_model_follows_its_own_feedforward_without_any_loop(stiffness: float) -> None:
    model = Model().with_effect("spring_load", stiffness=stiffness, contact=0.22)
    setpoint = Sine(0.3, 0.1, 0.5, -np.pi / 2).sample(TIME)
    command = feedforward_command(setpoint, MODEL_AHEAD, model.parameters, 10.0)
    moved = simulate(model, command, position=float(setpoint[0]))["position"]
    assert np.abs(moved - setpoint).max() < 4e-3


def test_a_resting_setpoint_has_no_feedforward_and_a_jump_no_more_than_the_limit() -> None:
    jump = np.where(TIME < 1.0, 0.2, 0.4)
    command = feedforward_command(jump, MODEL_AHEAD, NOMINAL, 10.0)
    assert np.abs(command).max() == 10.0
    assert np.count_nonzero(command) <= 4


def test_a_given_gain_takes_the_place_of_the_model() -> None:
    ramp = 0.1 + 0.05 * TIME
    given = ControlSettings(feedforward_gain=14.0)
    assert feedforward_command(ramp, given, NOMINAL, 10.0) == pytest.approx(0.7)


def test_a_sine_is_corrected_with_its_double_and_triple_and_other_motions_by_what_they_repeat() -> (
    None
):
    assert frequencies_of(Sine(0.3, 0.1, 0.5)) == (0.5, 1.0, 1.5)
    assert frequencies_of(Multisine(0.3, 0.1, (0.9, 0.2))) == (0.2, 0.9)
    assert frequencies_of(Sine(0.0, 3.0, 0.5, quantity="command")) == ()
    many = tuple(0.1 * k for k in range(1, 30))
    assert len(frequencies_of(Multisine(0.3, 0.1, many))) == MOST_TONES
    assert frequencies_of(Steps((0.2, 0.4), 1.0)) == ()


def test_a_slow_correction_passes_the_loop_and_a_fast_one_does_not() -> None:
    slow, fast = (loop_answer(f, NOMINAL, 50.0, MODEL_AHEAD) for f in (0.01, 5.0))
    assert slow == pytest.approx(1.0, abs=0.03)
    assert abs(fast) < 0.2


def test_what_a_weak_loop_hardly_passes_is_not_corrected() -> None:
    sine, cyclic = Sine(0.3, 0.1, 0.5), ControlSettings(cyclic=True)
    for gain, corrected in ((50.0, 3), (25.0, 1), (10.0, 0)):
        guide = guide_of(sine, sine.sample(TIME), cyclic, NOMINAL, DATA_SHEET, gain, 10.0)
        assert len(guide.tones) == corrected


def test_settings_that_add_nothing_are_the_proportional_loop() -> None:
    sine = Sine(0.3, 0.1, 0.5)
    plain = guide_of(sine, sine.sample(TIME), ControlSettings(), NOMINAL, DATA_SHEET, 50.0, 10.0)
    assert plain is PLAIN


def test_the_way_to_a_test_has_its_law_and_tables_of_its_own() -> None:
    settings = ControlSettings(feedforward="model", integral_time=1.0, cyclic=True)
    law = law_of(settings, NOMINAL, DATA_SHEET, 50.0)
    basis = LoopBasis(settings, NOMINAL, 50.0, 10.0)
    way = raised_cosine(0.3, 0.4, 1000)
    moving = moving_guide(law, basis, way)
    assert moving.law == law
    assert moving.feedforward.max() > 1.0
    assert moving.expected[-1] == pytest.approx(0.4, abs=1e-3)
    assert moving.tones.size == 0
    assert moving_guide(law, None, way).expected.size == 0
    assert moving_guide(PLAIN.law, basis, way).feedforward.size == 0


def test_the_band_of_a_hold_is_a_count_and_half_the_jump_of_a_ram_that_breaks_away() -> None:
    smooth = NOMINAL._replace(stiction=NOMINAL.coulomb)
    assert hold_band(smooth, DATA_SHEET) == DATA_SHEET.position_resolution
    assert 3e-4 < hold_band(NOMINAL, DATA_SHEET) < 8e-4
