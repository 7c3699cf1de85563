"""What the setpoints promise the loop, the thesis's own signals among them."""

import gzip
from dataclasses import replace
from math import inf, isinf, pi
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from control.setpoints import (
    Chirp,
    Constant,
    FromFile,
    Multisine,
    Polyline,
    Pseudorandom,
    Setpoint,
    SetpointError,
    SetpointFileError,
    Sine,
    Steps,
)

TICKS = 1e-3 * np.arange(40_001)

lengths = st.floats(-1.0, 1.0)
levels = st.floats(0.0, 0.6)
seeds = st.integers(0, 2**32)
frequencies = st.lists(
    st.integers(50, 10_000).map(lambda millihertz: millihertz / 1000),
    min_size=1,
    max_size=8,
    unique=True,
).map(tuple)
multisines = st.builds(
    Multisine,
    mean=levels,
    amplitude=st.floats(1e-3, 0.3),
    frequencies_hz=frequencies,
    seed=st.none() | seeds,
)
holds = st.tuples(st.floats(1e-3, 4.0), st.floats(1e-3, 4.0)).map(sorted)


@st.composite
def pseudorandoms(draw: st.DrawFn) -> Pseudorandom:
    lower, upper = sorted((draw(levels), draw(levels)))
    shortest, longest = draw(holds)
    return Pseudorandom(lower, upper, shortest, longest, draw(seeds))


def problems_of(error: pytest.ExceptionInfo[SetpointError]) -> list[str]:
    return [problem.field for problem in error.value.problems]


def test_a_constant_stands_still() -> None:
    setpoint = Constant(0.3)
    assert setpoint.sample(TICKS).tolist() == [0.3] * TICKS.size
    assert setpoint.peak_rate(40.0) == 0.0


def test_a_polyline_is_straight_between_its_corners_and_holds_beyond_them() -> None:
    setpoint = Polyline((1.0, 2.0, 4.0), (0.1, 0.3, 0.2))
    assert setpoint.sample(np.array([0.0, 1.5, 3.0, 9.0])).tolist() == pytest.approx(
        [0.1, 0.2, 0.25, 0.2]
    )
    assert setpoint.peak_rate(0.5) == 0.0
    assert setpoint.peak_rate(9.0) == pytest.approx(0.2)


@pytest.mark.parametrize(
    ("times", "values", "field"),
    [
        ((0.0, 1.0), (0.1,), "values"),
        ((0.0,), (0.1,), "values"),
        ((0.0, 0.0), (0.1, 0.2), "times_s"),
        ((0.0, 1.0), (0.1, inf), "values[1]"),
    ],
)
def test_a_polyline_without_corners_in_order_is_refused(
    times: tuple[float, ...], values: tuple[float, ...], field: str
) -> None:
    with pytest.raises(SetpointError) as error:
        Polyline(times, values)
    assert field in problems_of(error)


def test_the_open_loop_sine_of_section_5_1_is_reproduced() -> None:
    setpoint = Sine(0.0, 3.0, 0.5, 0.1, "command")
    np.testing.assert_allclose(setpoint.sample(TICKS), 3.0 * np.sin(pi * TICKS + 0.1), atol=1e-12)


def test_the_closed_loop_sine_of_section_7_1_stays_in_its_range() -> None:
    position = Sine(0.3, 0.2, 0.5, 0.1).sample(TICKS)
    assert position.min() == pytest.approx(0.1, abs=1e-6)
    assert position.max() == pytest.approx(0.5, abs=1e-6)


def test_the_chirp_of_section_3_2_is_reproduced() -> None:
    setpoint = Chirp(0.0, 3.0, start_hz=0.5, sweep_hz_per_s=0.25, quantity="command")
    printed = 3.0 * np.sin(pi * (1.0 + TICKS / 4.0) * TICKS)
    np.testing.assert_allclose(setpoint.sample(TICKS), printed, atol=1e-10)


def test_the_chirp_of_section_3_2_ends_at_10_5_hz() -> None:
    setpoint = Chirp(0.0, 1.0, 0.5, 0.25)
    assert setpoint.peak_rate(40.0) == pytest.approx(2.0 * pi * 10.5)
    last = setpoint.sample(np.linspace(39.0, 41.0, 200_001))
    crossings = np.count_nonzero(np.diff(np.sign(last)))
    assert crossings == pytest.approx(2 * 2 * 10.5, abs=1)


def test_steps_change_on_the_tick_and_stay_at_the_last_level() -> None:
    setpoint = Steps((0.1, 0.2, 0.3, 0.4), hold_s=0.2)
    position = setpoint.sample(TICKS[:1001])
    changes = np.flatnonzero(np.diff(position)) + 1
    assert changes.tolist() == [200, 400, 600]
    assert position[-1] == 0.4


def test_steps_jump_only_once_a_level_has_been_held() -> None:
    setpoint = Steps((0.2, 0.2, 0.3), hold_s=1.0)
    assert setpoint.peak_rate(1.9) == 0.0
    assert isinf(setpoint.peak_rate(2.0))
    assert setpoint.peak_rate(1.0) == 0.0


@given(pseudorandoms(), st.integers(0, 9_000), st.integers(1, 1_000))
def test_any_window_of_a_pseudorandom_reference_is_part_of_the_same_sequence(
    setpoint: Pseudorandom, first: int, count: int
) -> None:
    window = slice(first, first + count)
    whole = setpoint.sample(TICKS[:10_001])
    np.testing.assert_array_equal(setpoint.sample(TICKS[window]), whole[window])


@given(pseudorandoms())
def test_a_pseudorandom_reference_keeps_its_range_and_its_shortest_hold(
    setpoint: Pseudorandom,
) -> None:
    position = setpoint.sample(TICKS[:10_001])
    assert position.min() >= setpoint.lower
    assert position.max() <= setpoint.upper
    changes = np.flatnonzero(np.diff(position))
    assert np.all(np.diff(changes) >= int(setpoint.hold_min_s / 1e-3) - 1)


@pytest.mark.parametrize(
    "setpoint",
    [
        Pseudorandom(0.05, 0.5, 2.0, 2.0, seed=1),
        Pseudorandom(0.1, 0.5, 0.2, 4.0, seed=2),
        Pseudorandom(0.174, 0.184, 0.2, 4.0, seed=3),
    ],
    ids=["section 5.2.2", "section 7.1.2", "section 7.2.2"],
)
def test_levels_and_holds_of_the_thesis_are_uniform(setpoint: Pseudorandom) -> None:
    time = 1e-2 * np.arange(1_000_001)
    position = setpoint.sample(time)
    changes = np.flatnonzero(np.diff(position)) + 1
    reached = (position[changes] - setpoint.lower) / (setpoint.upper - setpoint.lower)
    held = np.diff(time[changes])
    # Uniform on [0, 1]: mean 1/2, standard deviation 1/sqrt(12); some 5000 levels each.
    assert reached.mean() == pytest.approx(0.5, abs=0.03)
    assert reached.std() == pytest.approx(12**-0.5, abs=0.02)
    assert held.mean() == pytest.approx(0.5 * (setpoint.hold_min_s + setpoint.hold_max_s), abs=0.1)
    assert held.std() == pytest.approx(
        (setpoint.hold_max_s - setpoint.hold_min_s) / 12**0.5, abs=0.1
    )


def test_each_seed_gives_a_sequence_of_its_own() -> None:
    setpoint = Pseudorandom(0.05, 0.5, 2.0, 2.0, seed=1)
    np.testing.assert_array_equal(setpoint.sample(TICKS), replace(setpoint).sample(TICKS))
    assert np.all(setpoint.sample(TICKS) != replace(setpoint, seed=2).sample(TICKS))


@given(multisines, st.floats(0.0, 900.0))
@settings(max_examples=50)
def test_a_multisine_never_exceeds_its_amplitude(setpoint: Multisine, start_s: float) -> None:
    time = start_s + np.linspace(0.0, 100.0, 50_001)
    assert np.max(np.abs(setpoint.sample(time) - setpoint.mean)) <= setpoint.amplitude


@pytest.mark.parametrize("seed", [None, 0, 1, 2])
def test_a_multisine_makes_use_of_its_amplitude(seed: int | None) -> None:
    setpoint = Multisine(0.3, 0.1, (0.1, 0.3, 0.7, 1.1, 1.9), seed)
    period = np.linspace(0.0, 10.0, 100_001)
    assert np.max(np.abs(setpoint.sample(period) - 0.3)) > 0.099


@given(multisines)
@settings(max_examples=25)
def test_all_sines_of_a_multisine_are_equally_strong(setpoint: Multisine) -> None:
    # 1000 s, sampled above twice the highest frequency, hold whole periods of each.
    time = np.arange(32_000) / 32.0
    spectrum = np.abs(np.fft.rfft(setpoint.sample(time) - setpoint.mean)) / 16_000.0
    strong = np.flatnonzero(spectrum > 0.5 * spectrum.max())
    assert strong.tolist() == sorted(round(1000 * f) for f in setpoint.frequencies_hz)
    np.testing.assert_allclose(spectrum[strong], spectrum[strong[0]], rtol=1e-6)


def test_the_order_in_which_frequencies_are_written_does_not_matter() -> None:
    ascending = Multisine(0.3, 0.1, (0.1, 0.7, 1.9))
    shuffled = Multisine(0.3, 0.1, (1.9, 0.1, 0.7))
    np.testing.assert_array_equal(shuffled.sample(TICKS), ascending.sample(TICKS))


def test_schroeder_phases_leave_more_power_within_the_same_peak() -> None:
    tones = tuple(0.1 * k for k in range(1, 31))
    period = np.linspace(0.0, 10.0, 10_000, endpoint=False)
    rms = {
        seed: Multisine(0.0, 1.0, tones, seed).sample(period).std() for seed in (None, *range(9))
    }
    assert max(rms, key=lambda seed: rms[seed]) is None


@given(
    st.one_of(
        multisines,
        st.builds(Sine, mean=levels, amplitude=lengths, frequency_hz=st.floats(0.01, 10.0)),
        st.builds(
            Chirp,
            mean=levels,
            amplitude=lengths,
            start_hz=st.floats(0.0, 10.0),
            sweep_hz_per_s=lengths,
        ),
    )
)
@settings(max_examples=60)
def test_no_setpoint_moves_faster_than_its_peak_rate(setpoint: Setpoint) -> None:
    time = np.linspace(0.0, 10.0, 20_001)
    rate = np.abs(np.diff(setpoint.sample(time)) / np.diff(time))
    assert rate.max() <= setpoint.peak_rate(10.0) + 1e-9


@pytest.mark.parametrize(
    "setpoint",
    [Sine(0.3, 0.2, 0.5), Chirp(0.0, 3.0, 0.5, 0.25), Multisine(0.3, 0.1, (0.1, 0.7, 1.3), seed=4)],
)
def test_the_peak_rate_is_reached(setpoint: Setpoint) -> None:
    time = np.linspace(0.0, 10.0, 200_001)
    rate = np.abs(np.diff(setpoint.sample(time)) / np.diff(time))
    assert rate.max() > 0.97 * setpoint.peak_rate(10.0)


@pytest.mark.parametrize(
    ("setpoint", "named"),
    [
        (lambda: Constant(np.nan), ["value"]),
        (lambda: Sine(0.3, inf, 0.0), ["amplitude", "frequency_hz"]),
        (lambda: Sine(0.3, 0.1, 700.0), ["frequency_hz"]),
        (lambda: Chirp(0.3, 0.1, -1.0, np.nan), ["sweep_hz_per_s", "start_hz"]),
        (lambda: Steps((), 0.0), ["levels", "hold_s"]),
        (lambda: Steps((0.1, inf), 1.0), ["levels[1]"]),
        (lambda: Pseudorandom(0.5, 0.1, 4.0, 0.2, -1), ["upper", "hold_max_s", "seed"]),
        (lambda: Pseudorandom(0.1, 0.5, 0.0, 2.0, 1), ["hold_min_s"]),
        (lambda: Multisine(0.3, 0.1, ()), ["frequencies_hz"]),
        (
            lambda: Multisine(0.3, 0.1, (0.5, 0.0005, 0.5, 600.0)),
            ["frequencies_hz[1]", "frequencies_hz[2]", "frequencies_hz[3]"],
        ),
        (lambda: Constant(0.3, "pressure"), ["quantity"]),  # type: ignore[arg-type]
    ],
)
def test_a_setpoint_that_cannot_be_generated_is_refused_with_every_reason(
    setpoint: object, named: list[str]
) -> None:
    with pytest.raises(SetpointError) as error:
        setpoint()  # type: ignore[operator]
    assert problems_of(error) == named
    for problem in error.value.problems:
        assert problem.remedy
        assert str(problem) in str(error.value)


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_setpoint_file_is_followed_linearly_and_held_beyond_its_ends(tmp_path: Path) -> None:
    path = written(tmp_path / "ramp.csv", "time_s, position_m\n1.0, 0.1\n2.0, 0.3\n4.0, 0.2\n")
    setpoint = FromFile(path)
    position = setpoint.sample(np.array([0.0, 1.0, 1.5, 2.0, 3.0, 9.0]))
    np.testing.assert_allclose(position, [0.1, 0.1, 0.2, 0.3, 0.25, 0.2])
    assert setpoint.peak_rate(4.0) == pytest.approx(0.2)
    assert setpoint.peak_rate(0.5) == 0.0


def test_a_recorded_command_can_be_played_again(tmp_path: Path) -> None:
    path = tmp_path / "recording.csv.gz"
    with gzip.open(path, "wt") as text:
        text.write("time_s,command_V,position_m\n0,1.5,0.2\n0.001,-2.5,0.2\n")
    setpoint = FromFile(path, "command")
    assert setpoint.sample(np.array([0.0, 0.001])).tolist() == [1.5, -2.5]


def test_a_setpoint_file_is_read_once(tmp_path: Path) -> None:
    path = written(tmp_path / "ramp.csv", "time_s,position_m\n0,0.1\n1,0.2\n")
    setpoint = FromFile(path)
    path.unlink()
    assert setpoint.sample(np.array([1.0])).tolist() == [0.2]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("", [":1 time_s: no such column in an empty file", ":1 position_m: no such column"]),
        ("time_s,position_m\n", [":1 rows: none below the header"]),
        ("t,position_m\n0,0.1\n", [":1 time_s: no such column among t, position_m"]),
        (
            "time_s,command_V\n0,1\n",
            [":1 position_m: no such column among time_s, command_V; name it in "],
        ),
        (
            "time_s,position_m\n0,0.1\n0,0.2\nx,0.3\n2,nan\n3\n",
            [
                ":3 time_s: 0.0 is not after 0.0",
                ":4 time_s: x is not a finite number",
                ":5 position_m: nan is not a finite number",
                ":6 position_m: nothing is not a finite number",
            ],
        ),
    ],
)
def test_every_fault_of_a_setpoint_file_is_named_by_its_line(
    tmp_path: Path, text: str, expected: list[str]
) -> None:
    path = written(tmp_path / "bad.csv", text)
    with pytest.raises(SetpointFileError) as error:
        FromFile(path)
    lines = str(error.value).splitlines()
    assert len(lines) == len(expected)
    for line, start in zip(lines, expected, strict=True):
        assert line.startswith(f"{path}{start}")


def test_a_file_wrong_in_every_row_is_not_listed_to_its_end(tmp_path: Path) -> None:
    path = written(tmp_path / "bad.csv", "time_s,position_m\n" + "0,nothing\n" * 500)
    with pytest.raises(SetpointFileError, match="979 more problems"):
        FromFile(path)


@pytest.mark.parametrize("name", ["absent.csv", "absent.csv.gz"])
def test_a_missing_setpoint_file_is_named(tmp_path: Path, name: str) -> None:
    with pytest.raises(SetpointFileError, match=f"{name} file: unreadable .No such file"):
        FromFile(tmp_path / name)


def test_a_device_without_an_end_is_not_read() -> None:
    with pytest.raises(SetpointFileError, match=r"/dev/zero file: unreadable \(no regular file\)"):
        FromFile(Path("/dev/zero"))


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "noise.csv").write_bytes(bytes(range(128, 256)))
    (tmp_path / "plain.csv.gz").write_text("time_s,position_m\n0,0.1\n")
    for name in ("noise.csv", "plain.csv.gz"):
        with pytest.raises(SetpointFileError, match=f"{name} file: unreadable"):
            FromFile(tmp_path / name)


def test_every_pseudorandom_level_lasts_as_long_as_drawn() -> None:
    setpoint = Pseudorandom(0.05, 0.5, 2.0, 2.0, seed=5)
    position = setpoint.sample(TICKS)
    changes = np.flatnonzero(np.diff(position)) + 1
    assert changes.tolist() == list(range(2000, 40_001, 2000))
