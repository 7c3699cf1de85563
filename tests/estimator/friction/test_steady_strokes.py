"""Strokes at constant speed: the mean force, and which of them are none."""

import numpy as np
import pytest

from estimator.friction.samples import Spring
from estimator.friction.steady_strokes import Stroke, steady_speeds
from rig.plant import NOMINAL
from rig.plant.integrator import TICK
from rig.recording import Recording

NONE = Spring(0.0, 0.0)
SPEED, FORCE = 0.2, 1200.0
STROKE = Stroke(0.0, 2.0)


def recorded(rng: np.random.Generator, ripple: float = 0.0, acceleration: float = 0.0) -> Recording:
    """Return 2 s of a stroke with a friction of 1200 N, and a force that ripples at 30 Hz."""
    time_s = np.asarray(np.arange(2000) * TICK, dtype=np.float64)
    force = FORCE + ripple * np.sin(2.0 * np.pi * 30.0 * time_s)
    force += NOMINAL.moving_mass * acceleration
    noise = 3e4 * rng.standard_normal((2, 2000))
    position = 0.05 + SPEED * time_s + 0.5 * acceleration * (time_s - 1.45) ** 2
    return Recording(
        {
            "time_s": time_s,
            "position_m": np.round(position / 3e-5) * 3e-5,
            "pressure_1_Pa": 7e6 + force / NOMINAL.piston_area + noise[0],
            "pressure_2_Pa": 7e6 + noise[1],
        }
    )


def test_a_steady_stroke_shows_speed_and_force_within_their_errors() -> None:
    rng = np.random.default_rng(1)
    scores, settled = [], []
    for _ in range(200):
        (shown,) = steady_speeds(recorded(rng), [STROKE], NONE, NOMINAL)
        scores.append((shown.force - FORCE) / shown.standard_error)
        settled.append(shown.settled)
        assert shown.velocity == pytest.approx(SPEED, abs=1e-4)
    assert abs(np.mean(scores)) < 0.3
    assert 0.75 < np.std(scores) < 1.15
    assert np.mean(settled) > 0.98


def test_stick_slip_is_not_taken_for_a_speed() -> None:
    rng = np.random.default_rng(2)
    (shown,) = steady_speeds(recorded(rng, ripple=150.0), [STROKE], NONE, NOMINAL)
    assert not shown.settled


def test_inertia_is_taken_off() -> None:
    rng = np.random.default_rng(3)
    (shown,) = steady_speeds(recorded(rng, acceleration=1.0), [STROKE], NONE, NOMINAL)
    assert shown.force == pytest.approx(FORCE, abs=5.0)


def test_missed_samples_are_bridged() -> None:
    recording = recorded(np.random.default_rng(5))
    for channel in ("position_m", "pressure_1_Pa", "pressure_2_Pa"):
        recording.channels[channel][7::50] = np.nan
    (shown,) = steady_speeds(recording, [STROKE], NONE, NOMINAL)
    assert shown.settled
    assert shown.force == pytest.approx(FORCE, abs=5.0)


def test_a_stroke_that_is_too_short_or_hardly_measured_shows_nothing() -> None:
    rng = np.random.default_rng(4)
    recording = recorded(rng)
    assert not list(steady_speeds(recording, [Stroke(0.0, 0.2)], NONE, NOMINAL))
    recording.channels["position_m"][1200:1500] = np.nan
    assert not list(steady_speeds(recording, [STROKE], NONE, NOMINAL))
