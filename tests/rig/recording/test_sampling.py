"""Rows of any period, uneven and with gaps, become even samples, each reading at its true time."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray

from rig.recording import Recording, RecordingError, export, read_measured
from rig.recording.interpolation import without_interpolated
from rig.recording.sampling import on_grid, period_of, sampling_of

Array = NDArray[np.float64]
Write = Callable[[Recording], Path]


def times(n: int, period: float) -> Array:
    return np.asarray(period * np.arange(n), dtype=np.float64)


def course(time_s: Array) -> Array:
    return 0.3 + 0.05 * np.sin(2.0 * np.pi * 0.7 * time_s)


def recorded(time_s: Array) -> Recording:
    command = np.where(time_s < 1.0, 1.0, -2.0)
    return Recording({"time_s": time_s, "command_V": command, "position_m": course(time_s)})


@pytest.fixture
def write(tmp_path: Path) -> Write:
    def written(recording: Recording) -> Path:
        export(recording, tmp_path / "run.csv")
        return tmp_path / "run.csv"

    return written


def rows_of(healthy: Recording, rows: NDArray[np.int64]) -> Recording:
    return Recording({name: values[rows] for name, values in healthy.channels.items()})


@given(st.sampled_from([1e-4, 3.3e-4, 1e-3, 4e-3, 0.011]), st.integers(0, 10_000))
@settings(max_examples=30, deadline=None)
def test_readings_of_any_period_and_jitter_are_brought_to_the_time_of_their_sample(
    period: float, seed: int
) -> None:
    jitter = np.random.default_rng(seed).uniform(-0.4, 0.4, round(3.0 / period))
    time_s = period * (np.arange(len(jitter)) + jitter)
    made = on_grid(recorded(time_s), 1e-3, ["command_V"])
    known = np.isfinite(made["position_m"])
    wrong = np.abs(made["position_m"] - course(made.time_s))[known]
    # Of a motion of 1 m/s^2, what is left out is the bend over half a sample and half a row.
    assert wrong.max() < 1.0 * max(1e-3, period) ** 2
    assert known.mean() > 0.6 * min(1e-3 / period, 1.0)
    assert np.allclose(np.diff(made.time_s), 1e-3)


def test_a_command_acts_from_its_own_row_to_the_next() -> None:
    made = on_grid(recorded(times(8, 0.25)), 0.1, ["command_V"])
    assert made["command_V"][:10] == pytest.approx(np.ones(10))
    assert made["command_V"][10:] == pytest.approx(np.full(9, -2.0))
    averaged = on_grid(recorded(times(20_000, 1e-4) + 3e-4), 1e-3, ["command_V"])
    # Of this sample, from 0.9993 s on, the command is -2 V for 0.3 ms.
    assert averaged["command_V"][998:1001] == pytest.approx([1.0, 0.7 - 0.6, -2.0])


def test_even_rows_of_the_period_of_the_samples_are_used_as_they_are(healthy: Recording) -> None:
    made = on_grid(healthy, 1e-3, ["command_V"])
    assert made.channels is healthy.channels
    assert made.sampling is not None
    assert made.sampling.notes() == []


def test_a_gap_is_missing_samples_and_later_rows_keep_their_time(
    healthy: Recording, write: Write
) -> None:
    cut = rows_of(healthy, np.r_[0:500, 620:2000])
    made = read_measured(write(cut))
    assert len(made) == 2000
    assert np.isnan(made["position_m"]).sum() == 120
    assert made["position_m"][620:] == pytest.approx(healthy["position_m"][620:])
    assert made.sampling is not None
    assert made.sampling.notes() == ["1 gap, 0.12 s in all"]
    assert np.isfinite(made["command_V"]).all()


def test_empty_cells_are_missing_readings_and_no_problem(healthy: Recording, write: Write) -> None:
    lacking = {name: values.copy() for name, values in healthy.channels.items()}
    lacking["pressure_1_Pa"][100:130] = np.nan
    lacking["command_V"][700:900] = np.nan
    made = read_measured(write(Recording(lacking)))
    missing = np.isnan(made["pressure_1_Pa"])
    assert missing[100:130].all()
    # Nobody knows what the readings belong to while the command is unknown for 0.2 s.
    assert missing[700:900].all()
    assert missing.sum() == 230


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda t: np.where(np.arange(len(t)) == 700, t - 5e-3, t), "must increase in every row"),
        (lambda t: np.where(np.arange(len(t)) == 700, t - 1e-3, t), "must increase in every row"),
        (lambda t: 1e3 * t, "the time looks like ms"),
        (lambda t: 0.05 * t, "average the rows of each ms"),
        (lambda t: np.where(t > 1.0, t + 700.0, t), "split the recording here"),
    ],
    ids=["backwards", "repeated", "in ms", "too quick", "a gap of 700 s"],
)
def test_times_that_cannot_be_are_refused(
    healthy: Recording, write: Write, change: Callable[[Array], Array], words: str
) -> None:
    wrong = Recording({**healthy.channels, "time_s": change(healthy.time_s)})
    with pytest.raises(RecordingError, match=words):
        read_measured(write(wrong))


def test_a_repeated_time_is_told_with_its_line(healthy: Recording, write: Write) -> None:
    with pytest.raises(RecordingError) as raised:
        read_measured(write(rows_of(healthy, np.r_[0:700, 699:2000])))
    (problem,) = raised.value.problems
    assert problem.line == 702


def test_the_period_is_that_of_the_rows_between_gaps_and_uneven_rows_get_a_finer_grid() -> None:
    even = times(500, 4e-3)
    assert period_of(np.where(even > 1.0, even + 0.7, even)) == 4e-3
    steps = np.random.default_rng(0).integers(10, 13, 500).astype(np.float64)
    uneven = sampling_of(np.asarray(1e-3 * np.cumsum(steps), dtype=np.float64))
    assert not uneven.even
    assert uneven.period == pytest.approx(0.011, rel=0.02)
    assert uneven.grid == 1e-3
    assert sampling_of(even).grid == 4e-3


# Interpolation


def noisy(seed: int, n: int = 20_000) -> dict[str, Array]:
    generator = np.random.default_rng(seed)
    time_s = times(n, 1e-3)
    return {
        "pressure_1_Pa": 7e6 + 1e6 * np.sin(time_s) + 3e4 * generator.standard_normal(n),
        "position_m": np.round(course(time_s) / 3e-5) * 3e-5,
    }


def seldom(channels: dict[str, Array], every: float, *, held: bool) -> dict[str, Array]:
    """Return channels as a slower log would have them: one reading in `every` rows is one."""
    made = {}
    for name, values in channels.items():
        rows = np.arange(len(values), dtype=np.float64)
        read = np.arange(0.0, len(values), every)
        interpolated = np.interp(read, rows, values)
        made[name] = (
            interpolated[np.searchsorted(read, rows, side="right") - 1]
            if held
            else np.interp(rows, read, interpolated)
        )
    return made


@pytest.mark.parametrize("held", [True, False], ids=["repeated", "straight lines"])
@pytest.mark.parametrize("every", [2.0, 4.0, 10.0, 10.3])
def test_a_slower_log_is_recognised_by_its_readings(every: float, *, held: bool) -> None:
    original = noisy(1)
    made, found = without_interpolated(seldom(original, every, held=held), [*original])
    assert found["pressure_1_Pa"].held is held
    assert found["pressure_1_Pa"].rows == round(every)
    kept = np.isfinite(made["pressure_1_Pa"])
    assert kept.mean() == pytest.approx(1.0 / every, rel=0.05)
    if every == round(every):
        assert np.array_equal(made["pressure_1_Pa"][kept], original["pressure_1_Pa"][kept])


@given(
    st.floats(-4.0, 2.0), st.floats(-0.3, 0.3), st.floats(0.0, 0.1), st.floats(0.1, 5.0),
    st.integers(0, 1000), st.booleans(),
)  # fmt: skip
@settings(max_examples=60, deadline=None)
def test_a_sensor_that_counts_or_rests_or_moves_evenly_is_never_called_interpolated(
    noise: float, speed: float, amplitude: float, frequency: float, seed: int, resting: bool
) -> None:
    time_s, count = times(15_000, 1e-3), 3e-5
    values = speed * time_s + amplitude * np.sin(2.0 * np.pi * frequency * time_s)
    values *= np.sin(0.7 * time_s) > 0.0 if resting else 1.0
    values += count * 10.0**noise * np.random.default_rng(seed).standard_normal(len(time_s))
    read = np.round(values / count) * count
    assert without_interpolated({"position_m": read}, ["position_m"])[1] == {}


def test_of_a_log_with_one_slow_sensor_only_that_loses_readings() -> None:
    quick, slow = noisy(1), seldom(noisy(2), 10.0, held=True)
    channels = {**quick, "pressure_2_Pa": slow["pressure_1_Pa"]}
    made, found = without_interpolated(channels, [*channels])
    assert list(found) == ["pressure_2_Pa"]
    assert np.isfinite(made["pressure_1_Pa"]).all()
    assert np.isfinite(made["position_m"]).all()
