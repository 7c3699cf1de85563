"""A channel that repeats a reading, which its noise does not let it do, is found and left out."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from estimator.gap.plant import Plant, record_of, stuck_stretches
from estimator.gap.prediction import GapResult
from estimator.gap.servo.actuator import servo_actuator
from estimator.gap.verdict.describing import stuck_channels
from rig.plant import Model
from rig.recording import Recording

N = 4000
FIRST = 1500
"""Sample whose reading is the one that is repeated."""


@pytest.fixture(scope="module")
def plant() -> Plant:
    return servo_actuator(Model())


def recording(plant: Plant, seed: int = 1, speed: float = 0.05) -> Recording:
    """Return 4 s of a ram that moves at `speed` (m/s), with the noise that the sensors have."""
    rng = np.random.default_rng(seed)
    time = np.arange(N) * 1e-3
    truth = {
        "position_m": 0.3 + speed * time,
        "pressure_1_Pa": np.full(N, 6.9e6),
        "pressure_2_Pa": np.full(N, 6.8e6),
        "spool_m": np.full(N, 1e-5),
    }
    channels = {"time_s": time, "command_V": np.sin(time)}
    for output in plant.outputs:
        channels[output.channel] = truth[output.channel] + rng.normal(0.0, output.noise, N)
        if output.resolution:
            counts = np.round(channels[output.channel] / output.resolution)
            channels[output.channel] = counts * output.resolution
    return Recording(channels)


def index_of(plant: Plant, channel: str) -> int:
    return [output.channel for output in plant.outputs].index(channel)


@pytest.mark.parametrize("channel", ["pressure_1_Pa", "pressure_2_Pa", "spool_m"])
def test_a_stuck_channel_is_found_from_the_first_repeated_reading_on_and_left_out(
    plant: Plant, channel: str
) -> None:
    rows = recording(plant)
    rows[channel][FIRST:] = rows[channel][FIRST]
    (found,) = stuck_stretches(rows, plant)
    index = index_of(plant, channel)
    assert (found.output, found.first, found.end) == (index, FIRST + 1, N)
    left_out = ~np.isfinite(record_of(rows, plant).variances)
    assert left_out[found.first : found.end, index].all()
    assert not left_out[: found.first].any()
    assert not np.delete(left_out, index, axis=1).any()


@given(st.integers(0, 2**32 - 1), st.integers(1, 60))
def test_noise_is_never_taken_for_a_stuck_channel_however_coarsely_it_is_written(
    seed: int, times: int
) -> None:
    plant = servo_actuator(Model())
    rows = recording(plant, seed)
    index = index_of(plant, "pressure_1_Pa")
    step = times / 20.0 * plant.outputs[index].noise
    rows["pressure_1_Pa"][:] = np.round(rows["pressure_1_Pa"] / step) * step
    assert not stuck_stretches(rows, plant)


def test_a_rig_without_noise_at_rest_has_no_stuck_channel(plant: Plant) -> None:
    rows = recording(plant, speed=0.0)
    for output in plant.outputs:
        rows[output.channel][:] = rows[output.channel][0]
    assert not stuck_stretches(rows, plant)


def test_a_lost_message_is_no_stuck_channel(plant: Plant) -> None:
    rows = recording(plant)
    rows["spool_m"][FIRST : FIRST + 20] = rows["spool_m"][FIRST]
    assert not stuck_stretches(rows, plant)


def test_a_gauge_at_the_end_of_its_range_is_saturated_and_not_stuck(plant: Plant) -> None:
    rows = recording(plant)
    index = index_of(plant, "pressure_1_Pa")
    rows["pressure_1_Pa"][FIRST:] = plant.outputs[index].lower
    assert not stuck_stretches(rows, plant)


def test_a_stuck_channel_is_told_with_its_value_its_times_and_what_to_look_at(
    plant: Plant,
) -> None:
    rows = recording(plant)
    rows["pressure_2_Pa"][FIRST : FIRST + 1000] = 6.8e6
    (told,) = stuck_channels([recording(plant), rows], plant)
    assert (told.name, told.place) == ("stuck_channel", "reading of pressure_2_Pa")
    assert "1.5 s to 2.5 s" in told.what
    assert not told.in_model
    assert GapResult("unknown_effect", [], discovered=[told]).discovered[0].experiment
