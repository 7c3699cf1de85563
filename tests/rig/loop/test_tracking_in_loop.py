"""The tracking law on the simulated loop: what was asked is followed, and what is held stays."""

from dataclasses import replace
from typing import Final

import numpy as np
import pytest

from control import Constant, ControlSettings
from estimator.filters import start_memory
from rig.configuration.rigs.rig import Rig, load_rig
from rig.plant import Model
from rig.runner.campaign.bench import plain_test
from rig.runner.campaign.simulated_bench import loop_of
from tools.simulated.tracking_guide import TRACKING
from tools.tracking.runs import SINE, STEPS, run

PROPORTIONAL: Final = ControlSettings()


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("simulated")


def test_the_thesis_s_loop_lags_a_fast_sine_by_half_its_amplitude(rig: Rig) -> None:
    assert run(rig, SINE, 6.0, PROPORTIONAL).rms(2.0) == pytest.approx(0.073, abs=2e-3)


def test_the_tracking_law_follows_it_within_a_millimetre(rig: Rig) -> None:
    moved = run(rig, SINE, 8.0, TRACKING)
    assert moved.rms() < 1e-3


def test_a_ram_that_is_held_does_not_hunt(rig: Rig) -> None:
    held = run(rig, Constant(0.3), 15.0, TRACKING)
    assert held.swing(5.0) < 1e-4


def test_a_valve_with_play_does_not_hunt_once_the_setpoint_has_rested(rig: Rig) -> None:
    worn = replace(rig, plant=rig.plant.with_effect("valve_hysteresis", value=1e-5))
    assert run(worn, Constant(0.3), 25.0, TRACKING).swing(20.0) < 1e-4


def test_the_integral_takes_up_a_null_bias(rig: Rig) -> None:
    off = replace(rig, plant=rig.plant.with_effect("spool_null_bias", value=2e-5))
    left = np.abs(run(off, SINE, 10.0, PROPORTIONAL).error(8.0)).max()
    assert left > 0.1
    assert run(off, SINE, 12.0, TRACKING).rms(8.0) < 3e-3


def test_a_test_that_runs_in_parts_has_the_same_rows_as_one_that_runs_at_once(rig: Rig) -> None:
    tuned = replace(rig, control=TRACKING)
    found = []
    for ticks in (3000, 700):
        memory = start_memory("product", Model(), rig.sensors)
        test = plain_test("steps", STEPS, 3.0, 0.3, 0.5)
        loop = loop_of(tuned, test, memory, Model(), judged=False)
        loop.position()
        parts = []
        while loop.ticks_left:
            parts.append(loop.advance(ticks))
        found.append(np.concatenate(parts))
    np.testing.assert_array_equal(found[0], found[1])


def test_a_change_to_the_same_control_changes_no_command_also_behind_a_skip(rig: Rig) -> None:
    tuned = replace(rig, control=TRACKING)
    found = []
    for changed in (False, True):
        test = plain_test("sine", SINE, 3.0, float(SINE.sample(np.zeros(1))[0]), 0.5)
        memory = start_memory("product", Model(), rig.sensors)
        loop = loop_of(tuned, test, memory, Model(), judged=False)
        guide = loop.guide
        loop.position()
        loop.advance(500)
        assert loop.skip_to(1200, 300) == 500
        loop.advance(100)
        if changed:
            assert loop.change(loop.gain, guide) == 600
        found.append(loop.advance(1000)[:, loop.channels.index("command_V")])
    # The way back from the setpoint behind the skip to the one laid out rounds.
    np.testing.assert_allclose(found[0], found[1], rtol=0.0, atol=1e-6)


@pytest.mark.parametrize("start", [0.12, 0.3, 0.48])
def test_the_way_to_the_start_of_a_test_winds_nothing_up(rig: Rig, start: float) -> None:
    tuned = replace(rig, control=TRACKING)
    test = plain_test("held", Constant(start), 0.5, start, 2.0)
    loop = loop_of(
        tuned, test, start_memory("product", Model(), rig.sensors), Model(), judged=False
    )
    loop.position()
    rows = loop.advance(500)
    error = start - rows[:, loop.channels.index("position_m")]
    assert np.abs(error).max() < 1e-3
