"""Break-away: the greatest force of a slow ramp is what the seals held, whatever the noise."""

import numpy as np
import pytest

from estimator.friction.break_away import break_aways, presliding_creep
from estimator.friction.samples import Spring
from rig.plant import NOMINAL, Model
from rig.plant.integrator import TICK
from rig.plant.parameters import KARNOPP
from rig.plant.simulation import simulate
from rig.recording import Recording

NONE = Spring(0.0, 0.0)
TOP_V, PERIOD_S = 0.012, 24.0
NOISE_PA = 3e4


def ramp(top: float = TOP_V) -> np.ndarray:
    """Return a command up, down and back to null, V."""
    time_s = np.arange(round(PERIOD_S / TICK)) * TICK
    corners = np.array([0.0, 0.25, 0.75, 1.0]) * PERIOD_S
    return np.interp(time_s, corners, [0.0, top, -top, 0.0])


def recorded(model: Model, command: np.ndarray, position: float = 0.3) -> Recording:
    motion = simulate(model, command, position=position)
    rng = np.random.default_rng(5)
    return Recording(
        {
            "time_s": np.asarray(np.arange(command.size) * TICK, dtype=np.float64),
            "command_V": command,
            "position_m": np.round(motion["position"] / 3e-5) * 3e-5,
            "pressure_1_Pa": motion["pressure_1"] + NOISE_PA * rng.standard_normal(command.size),
            "pressure_2_Pa": motion["pressure_2"] + NOISE_PA * rng.standard_normal(command.size),
        }
    )


@pytest.mark.parametrize("stiction", [1700.0, 2400.0, 3100.0])
def test_a_slow_ramp_shows_stiction_and_asymmetry_of_an_unknown_seal(stiction: float) -> None:
    truth = NOMINAL._replace(stiction=stiction, friction_asymmetry=90.0)
    back, out = break_aways(recorded(Model(parameters=truth), ramp()), NONE, truth.piston_area)
    assert back.taken_off
    assert out.taken_off
    assert 0.5 * (out.force - back.force) == pytest.approx(stiction, abs=16.0)
    assert 0.5 * (out.force + back.force) == pytest.approx(90.0, abs=10.0)


def test_the_noise_does_not_make_the_force_greater() -> None:
    rng = np.random.default_rng(3)
    errors = []
    for _ in range(40):
        flat = {
            "time_s": np.arange(4000) * TICK,
            "command_V": np.zeros(4000),
            "position_m": np.full(4000, 0.3),
            "pressure_1_Pa": 5e6 + NOISE_PA * rng.standard_normal(4000),
            "pressure_2_Pa": 3e6 + NOISE_PA * rng.standard_normal(4000),
        }
        _, out = break_aways(Recording(flat), NONE, NOMINAL.piston_area)
        errors.append((out.force - 2e6 * NOMINAL.piston_area) / out.standard_error)
    assert abs(np.mean(errors)) < 4.0 / np.sqrt(len(errors))
    assert np.std(errors) < 1.5


def test_a_ramp_that_does_not_move_the_ram_is_no_break_away() -> None:
    found = break_aways(recorded(Model(), ramp(0.003)), NONE, NOMINAL.piston_area)
    assert not any(each.taken_off for each in found)


def test_a_known_spring_is_taken_off() -> None:
    truth = Model().with_effect("spring_load", stiffness=2e4, contact=0.25)
    recording = recorded(truth, ramp())
    back, out = break_aways(recording, Spring(2e4, 0.25), NOMINAL.piston_area)
    assert 0.5 * (out.force + back.force) == pytest.approx(0.0, abs=60.0)
    left = break_aways(recording, NONE, NOMINAL.piston_area)
    assert 0.5 * (left[0].force + left[1].force) > 800.0


def test_a_recording_shorter_than_the_windows_shows_nothing() -> None:
    recording = recorded(Model(), np.zeros(100))
    assert break_aways(recording, NONE, NOMINAL.piston_area) == ()


def test_missing_samples_are_bridged() -> None:
    recording = recorded(Model(), ramp())
    recording.channels["pressure_1_Pa"][5000:5003] = np.nan
    back, out = break_aways(recording, NONE, NOMINAL.piston_area)
    assert np.isfinite([back.force, out.force]).all()
    recording.channels["pressure_1_Pa"][5000:9000] = np.nan
    assert break_aways(recording, NONE, NOMINAL.piston_area) == ()


def test_softer_bristles_creep_further_and_karnopps_do_not() -> None:
    nominal = presliding_creep(NOMINAL, 0.002)
    softer = presliding_creep(NOMINAL._replace(bristle_stiffness=5e6), 0.002)
    assert softer == pytest.approx(2.0 * nominal)
    assert presliding_creep(NOMINAL._replace(friction_law=KARNOPP), 0.002) == 0.0


@pytest.mark.parametrize("slope", [0.002, 0.004])
def test_what_bristles_are_short_of_stiction_is_as_reckoned(slope: float) -> None:
    period = 4.0 * TOP_V / slope
    time_s = np.arange(round(period / TICK)) * TICK
    corners = np.array([0.0, 0.25, 0.75, 1.0]) * period
    command = np.interp(time_s, corners, [0.0, TOP_V, -TOP_V, 0.0])
    truth = NOMINAL._replace(stiction=2000.0)
    motion = simulate(Model(parameters=truth), command, position=0.05)
    greatest = NOMINAL.piston_area * float(np.max(motion["pressure_1"] - motion["pressure_2"]))
    creep = presliding_creep(truth, slope)
    reckoned = (truth.stiction - truth.coulomb) / truth.stribeck_velocity * creep
    assert truth.stiction - greatest == pytest.approx(reckoned, rel=0.25)
