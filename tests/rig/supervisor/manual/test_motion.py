"""A manual motion keeps its bounds, and ends at rest whenever no next turn comes."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from rig.supervisor.manual.bounds import ACCELERATION, ALIVE_S, HOLD_SPEED, Bounds, ManualError
from rig.supervisor.manual.generator import SHAPES, Generator, Wave, check_change
from rig.supervisor.manual.motion import Planner

Array = NDArray[np.float64]
BOUNDS = Bounds(0.007, 0.598, 0.35, 43.0)
SINE = Wave("sine", 0.3, 0.02, 0.5, 0.5)
TURN = 20


def followed(
    planner: Planner,
    turns: int,
    ahead: int = 60,
    each: Callable[[int], object] = lambda turn: None,
) -> Array:
    """Return the setpoints (ticks,) that a loop meets as they are laid out turn by turn."""
    laid_out = np.full((turns + 1) * TURN + 4000, np.nan)
    for turn in range(turns):
        each(turn)
        plan = planner.extend(turn * TURN + ahead)
        end = plan.first + plan.values.size
        laid_out[plan.first : end], laid_out[end:] = plan.values, plan.values[-1]
    return laid_out[ahead:]


def speeds(setpoints: Array) -> Array:
    return np.diff(setpoints) / 1e-3


def greatest_acceleration(setpoints: Array) -> float:
    return float(np.abs(np.diff(speeds(setpoints)) / 1e-3).max())


@pytest.mark.parametrize("target_m", [0.1202, 0.1003, 0.08])
def test_a_move_ends_at_its_target_within_speed_and_acceleration(target_m: float) -> None:
    planner = Planner(0.1, BOUNDS)
    planner.go(target_m, 0.02)
    setpoints = followed(planner, 100)
    assert setpoints[-1] == target_m
    assert planner.rests
    assert np.abs(speeds(setpoints)).max() <= 0.02 + 1e-9
    assert greatest_acceleration(setpoints) <= ACCELERATION + 1e-6


@pytest.mark.parametrize("turns", [3, 10, 17])
def test_a_motion_comes_to_rest_within_its_bounds_when_no_next_turn_comes(turns: int) -> None:
    planner = Planner(0.1, BOUNDS)
    planner.go(0.2, 0.1)
    setpoints = followed(planner, turns)
    assert greatest_acceleration(setpoints) <= ACCELERATION + 1e-6
    begun = np.flatnonzero(speeds(setpoints))[-1]
    assert begun <= turns * TURN + 100.0 * 0.1 / ACCELERATION * 10


def test_hold_to_run_ends_within_its_way_and_time_after_the_last_heartbeat() -> None:
    planner, last_turn = Planner(0.1, BOUNDS), 30
    alive = round(ALIVE_S / 1e-3)
    planner.go(BOUNDS.high_m, HOLD_SPEED, alive)

    def beat(turn: int) -> None:
        if turn <= last_turn:
            planner.alive_until(turn * TURN + alive)

    setpoints = followed(planner, 100, each=beat)
    last = last_turn * TURN - 60
    assert np.flatnonzero(speeds(setpoints))[-1] < last + 250
    assert 0.0 < setpoints[-1] - setpoints[last] < 0.005
    assert planner.rests


def test_a_heartbeat_that_comes_too_late_does_not_begin_the_motion_anew() -> None:
    planner = Planner(0.1, BOUNDS)
    planner.go(0.2, HOLD_SPEED, 120)
    rested = followed(planner, 30)[-1]
    planner.alive_until(10_000)
    assert planner.extend(2000).values[-1] == rested


def test_a_turn_that_comes_late_goes_on_from_the_stop_that_was_laid_out() -> None:
    planner = Planner(0.1, BOUNDS)
    planner.go(0.3, 0.1)
    before = followed(planner, 20)
    place = planner.place + 100
    assert not planner.caught_up(place)
    plan = planner.extend(place + 60)
    whole = np.concatenate((before[: place - 60], plan.values))
    assert greatest_acceleration(whole) <= ACCELERATION + 1e-6
    assert planner.speed > 0.0


def test_what_the_loop_did_not_take_is_planned_again() -> None:
    planner = Planner(0.1, BOUNDS)
    planner.go(0.3, 0.1)
    followed(planner, 5)
    first = planner.extend(200)
    assert not planner.dropped()
    second = planner.extend(200)
    assert np.array_equal(first.values, second.values)


def test_a_late_turn_breaks_a_generator_off_and_the_ram_comes_to_rest() -> None:
    planner = Planner(0.3, BOUNDS)
    planner.generate(lambda: Generator(SINE, BOUNDS), 0.3, 0.02)
    followed(planner, 100, ahead=200)
    assert planner.generator is not None
    assert planner.caught_up(planner.place + 30)
    assert planner.extend(planner.place + 500).values[-1] == pytest.approx(0.3, abs=0.021)
    assert planner.rests


def test_a_generator_changes_without_a_bump() -> None:
    planner = Planner(0.3, BOUNDS)
    planner.generate(lambda: Generator(SINE, BOUNDS), 0.3, 0.02)
    faster = replace(SINE, amplitude_m=0.04, frequency_hz=1.0, to_hz=1.0)

    def change(turn: int) -> None:
        if turn == 200 and planner.generator is not None:
            planner.generator.change(faster)
        if turn == 400 and planner.generator is not None:
            planner.generator.change(faster.at_rest)

    setpoints = followed(planner, 520, ahead=200, each=change)
    steady = 2.0 * np.pi * 0.04 * 1.0
    assert np.abs(speeds(setpoints)).max() == pytest.approx(steady, rel=0.01)
    assert greatest_acceleration(setpoints) < 1.5 * (2.0 * np.pi) ** 2 * 0.04
    assert setpoints[-1] == pytest.approx(0.3, abs=1e-9)
    assert planner.rests


def test_a_change_during_a_change_waits_for_its_end() -> None:
    generator = Generator(SINE, BOUNDS)
    generator.sample(300)
    generator.change(replace(SINE, amplitude_m=0.03))
    generator.change(replace(SINE, amplitude_m=0.04))
    assert generator.wave == SINE
    assert generator.wanted.amplitude_m == 0.04
    setpoints = generator.sample(4000)
    assert setpoints.max() == pytest.approx(0.34, abs=1e-4)
    assert greatest_acceleration(setpoints) < 1.0


@pytest.mark.parametrize("shape", SHAPES)
def test_every_shape_reaches_its_amplitude_within_its_slope_and_curvature(shape: str) -> None:
    phase = np.linspace(0.0, 2.0, 40_001)
    wave = SHAPES[shape].wave(phase)
    step = phase[1] - phase[0]
    assert (wave.min(), wave.max()) == pytest.approx((-1.0, 1.0))
    assert np.abs(np.diff(wave)).max() / step == pytest.approx(SHAPES[shape].slope, rel=1e-3)
    second = np.abs(np.diff(wave, 2)).max() / step**2
    assert second == pytest.approx(SHAPES[shape].curvature, rel=1e-2)


def test_a_chirp_goes_from_one_frequency_to_the_other_and_back() -> None:
    generator = Generator(Wave("chirp", 0.3, 0.01, 0.5, 4.0, sweep_s=5.0), BOUNDS)
    beyond = generator.sample(10_000) > 0.3
    rises = np.flatnonzero(np.diff(beyond.astype(int)) == 1)
    assert rises.size == pytest.approx(2.25 * 10.0, abs=2)
    assert np.diff(rises).min() == pytest.approx(250, abs=20)


@pytest.mark.parametrize(
    ("wave", "why"),
    [
        (replace(SINE, amplitude_m=0.1, frequency_hz=1.0, to_hz=1.0), "speed"),
        (replace(SINE, amplitude_m=0.003, frequency_hz=18.0, to_hz=18.0), "speed"),
        (replace(SINE, mean_m=0.59), "mean plus amplitude"),
        (replace(SINE, mean_m=0.02), "mean less amplitude"),
        (replace(SINE, frequency_hz=30.0, to_hz=30.0), "frequency"),
    ],
)
def test_a_wave_beyond_the_bounds_is_refused_with_limit_and_remedy(wave: Wave, why: str) -> None:
    with pytest.raises(ManualError, match=why):
        check_change(SINE, wave, BOUNDS)
