"""A recording that no filter could use is refused, with all the reasons at once."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from rig.recording import (
    MAX_PROBLEMS,
    Recording,
    RecordingError,
    RecordingProblem,
    export,
    read_recording,
)

Judge = Callable[..., list[RecordingProblem]]


def csv(lines: Sequence[str]) -> str:
    return "\n".join(lines) + "\n"


def scaled(lines: Sequence[str], name: str, factor: float) -> str:
    """Return the CSV with one column multiplied by a factor."""
    rows = [line.split(",") for line in lines]
    position = rows[0].index(name)
    for row in rows[1:]:
        row[position] = repr(float(row[position]) * factor)
    return csv([",".join(row) for row in rows])


def with_cell(lines: Sequence[str], line: int, name: str, cell: str) -> list[str]:
    """Return the lines with one cell replaced; lines count from 1."""
    cells = lines[line - 1].split(",")
    cells[lines[0].split(",").index(name)] = cell
    return [*lines[: line - 1], ",".join(cells), *lines[line:]]


def only(problems: Sequence[RecordingProblem]) -> RecordingProblem:
    assert len(problems) == 1, [str(problem) for problem in problems]
    return problems[0]


@pytest.mark.parametrize(
    ("wrong", "right", "remedy"),
    [
        ("pressure1", "pressure_1_Pa", "rename 'pressure1' to pressure_1_Pa"),
        ("p2", "pressure_2_Pa", "rename 'p2' to pressure_2_Pa"),
        ("Command [V]", "command_V", "rename 'Command [V]' to command_V"),
        ("pressure_1_bar", "pressure_1_Pa", "multiply by 1e5 (bar to Pa)"),
        ("position_mm", "position_m", "multiply by 1e-3 (mm to m)"),
        ("elapsed", "position_m", "needed are time_s, command_V, position_m"),
    ],
)
def test_a_missing_column_is_named_with_the_nearest_present_and_how_to_convert_it(
    judge: Judge, healthy_csv: list[str], wrong: str, right: str, remedy: str
) -> None:
    problem = only(judge(csv([healthy_csv[0].replace(right, wrong), *healthy_csv[1:]])))
    assert (problem.field, problem.value) == (right, "missing column")
    assert wrong in problem.limit
    assert remedy in problem.remedy


@pytest.mark.parametrize("cell", ["", "nan", "NaN"])
def test_a_dropout_in_a_required_column_is_refused_at_its_line(
    judge: Judge, healthy_csv: list[str], cell: str
) -> None:
    problem = only(judge(csv(with_cell(healthy_csv, 700, "pressure_1_Pa", cell))))
    assert (problem.line, problem.field) == (700, "pressure_1_Pa")
    assert problem.value == "empty or NaN"


def test_a_sample_that_the_loop_recorded_as_missed_is_no_dropout(
    judge: Judge, healthy_csv: list[str], tmp_path: Path
) -> None:
    lines = [f"{healthy_csv[0]},exchange_status", *(f"{line},0" for line in healthy_csv[1:])]
    missed = with_cell(with_cell(lines, 700, "position_m", ""), 700, "exchange_status", "1")
    (tmp_path / "missed.csv").write_text(csv(missed))
    assert np.isnan(read_recording(tmp_path / "missed.csv")["position_m"]).sum() == 1
    unexplained = with_cell(lines, 700, "position_m", "")
    assert only(judge(csv(unexplained))).line == 700
    no_command = with_cell(missed, 700, "command_V", "")
    assert only(judge(csv(no_command))).field == "command_V"


def test_a_longer_dropout_is_one_problem_from_first_to_last_line(
    judge: Judge, healthy_csv: list[str]
) -> None:
    lines = healthy_csv
    for line in range(700, 712):
        lines = with_cell(lines, line, "position_m", "")
    problem = only(judge(csv(lines)))
    assert (problem.line, problem.value) == (700, "empty or NaN in 12 rows up to 711")


def test_an_overflow_in_a_required_column_is_not_called_a_dropout(
    judge: Judge, healthy_csv: list[str]
) -> None:
    problem = only(judge(csv(with_cell(healthy_csv, 700, "command_V", "-inf"))))
    assert (problem.line, problem.field, problem.value) == (700, "command_V", "-inf")


def test_dropped_samples_are_a_gap_with_line_size_and_expected_step(
    judge: Judge, healthy_csv: list[str]
) -> None:
    problem = only(judge(csv([*healthy_csv[:500], *healthy_csv[511:]])))
    assert (problem.line, problem.field) == (501, "time_s")
    assert problem.value == "gap of 12 ms, 0.498 s to 0.51 s"
    assert problem.limit == "expected step 1 ms"


def test_blank_lines_do_not_shift_the_line_numbers_that_follow(
    judge: Judge, healthy_csv: list[str]
) -> None:
    lines = [*healthy_csv[:100], "", "", *healthy_csv[100:500], *healthy_csv[501:]]
    problem = only(judge(csv(lines)))
    assert (problem.line, problem.value) == (503, "gap of 2 ms, 0.498 s to 0.5 s")


def test_a_jitter_of_a_third_of_a_step_is_no_gap(healthy: Recording) -> None:
    time_s = healthy.time_s.copy()
    time_s[1::2] += 0.3e-3
    assert problems_of_channels(healthy, {"time_s": time_s}) == []


def problems_of_channels(
    healthy: Recording, changed: dict[str, np.ndarray[tuple[int], np.dtype[np.float64]]]
) -> list[RecordingProblem]:
    from rig.recording.recording import REPLAY_CHANNELS, Table
    from rig.recording.validation import problems_of

    table = Table("run.csv", healthy.channels | changed)
    return problems_of(table, REPLAY_CHANNELS, of_rig=True, longest_s=None)


def test_time_that_goes_back_is_refused_at_the_line_where_it_does(
    judge: Judge, healthy_csv: list[str]
) -> None:
    lines = [*healthy_csv[:1500], *healthy_csv[1499:]]
    problem = only(judge(csv(lines)))
    assert (problem.line, problem.field) == (1501, "time_s")
    assert problem.value == "1.498 s after 1.498 s"


def test_time_with_too_few_decimals_is_one_problem(judge: Judge, healthy_csv: list[str]) -> None:
    rows = [line.split(",", 1) for line in healthy_csv[1:]]
    lines = [healthy_csv[0], *(f"{float(time):.2f},{rest}" for time, rest in rows)]
    problem = only(judge(csv(lines)))
    assert "at least 3 decimals" in problem.remedy


@pytest.mark.parametrize(
    ("factor", "value", "remedy"),
    [
        (2.0, "500 Hz", "resample to 1 kHz"),
        (0.1, "10000 Hz", "resample to 1 kHz"),
        (1.02, "980.392 Hz", "resample to 1 kHz"),
        (1e3, "1 Hz", "looks like ms: multiply it by 0.001"),
        (1e6, "0.001 Hz", "looks like us: multiply it by 1e-06"),
    ],
)
def test_another_rate_is_reported_with_how_to_resample_or_which_unit_it_is(
    judge: Judge, healthy_csv: list[str], factor: float, value: str, remedy: str
) -> None:
    found = judge(scaled(healthy_csv, "time_s", factor))
    problem = next(problem for problem in found if "sampled" in problem.value)
    assert problem.field == "time_s"
    assert value in problem.value
    assert remedy in problem.remedy


def test_a_clock_half_a_percent_off_is_accepted(healthy: Recording) -> None:
    assert problems_of_channels(healthy, {"time_s": healthy.time_s * 1.005}) == []


def test_a_rate_that_is_wrong_only_on_average_is_found(healthy: Recording) -> None:
    steps = np.full(len(healthy), 1e-3)
    steps[::3] = 1.4e-3
    found = problems_of_channels(healthy, {"time_s": np.cumsum(steps)})
    assert "sampled at" in only(found).value


def test_a_recording_under_a_second_is_too_short_and_one_of_a_second_is_not(
    judge: Judge, healthy_csv: list[str]
) -> None:
    assert only(judge(csv(healthy_csv[:1000]))).value == "0.999 s (999 rows)"
    with_gap = csv(with_cell(healthy_csv[:1001], 500, "position_m", ""))
    assert only(judge(with_gap)).field == "position_m"


def test_a_header_alone_is_no_recording(judge: Judge, healthy_csv: list[str]) -> None:
    assert only(judge(healthy_csv[0] + "\n")).value == "no samples"


@pytest.mark.parametrize(
    ("name", "factor", "remedy"),
    [
        ("position_m", 1e3, "looks like mm"),
        ("spool_m", 1e6, "um"),
        ("command_V", 1e3, "looks like mV"),
    ],
)
def test_a_column_in_another_unit_than_its_name_says_is_refused_with_the_likely_unit(
    judge: Judge, healthy_csv: list[str], name: str, factor: float, remedy: str
) -> None:
    problem = only(judge(scaled(healthy_csv, name, factor)))
    assert problem.field == name
    assert remedy in problem.remedy


@pytest.mark.parametrize(
    ("pascal", "remedy"),
    [(1e-6, "MPa"), (1e-5, "bar: multiply by 1e5"), (1.450377e-4, "psi"), (1e-3, "kPa")],
)
def test_pressures_in_another_unit_are_recognised_for_both_chambers(
    healthy: Recording, pascal: float, remedy: str
) -> None:
    names = ["pressure_1_Pa", "pressure_2_Pa"]
    found = problems_of_channels(healthy, {name: healthy[name] * pascal for name in names})
    assert [problem.field for problem in found] == names
    assert all(remedy in problem.remedy for problem in found)


def test_one_chamber_drained_to_the_tank_is_plausible(healthy: Recording) -> None:
    drained = np.full(len(healthy), 200.0)
    assert problems_of_channels(healthy, {"pressure_2_Pa": drained}) == []


def test_a_spike_is_refused_as_a_spike_not_as_a_unit(judge: Judge, healthy_csv: list[str]) -> None:
    problem = only(judge(csv(with_cell(healthy_csv, 321, "pressure_1_Pa", "2.5e9"))))
    assert problem.line == 321
    assert "check the sensor" in problem.remedy


def test_a_filter_that_ran_away_is_no_fault_of_the_recording(healthy: Recording) -> None:
    runaway = np.full(len(healthy), 1e300)
    runaway[-1] = np.inf
    runaway[0] = np.nan
    assert problems_of_channels(healthy, {"est_pressure_1_Pa": runaway}) == []


def test_all_that_is_wrong_is_reported_at_once_the_whole_file_first(
    judge: Judge, healthy_csv: list[str]
) -> None:
    lines = with_cell(healthy_csv, 40, "pressure_2_Pa", "")
    lines = with_cell(lines, 20, "position_m", "stuck")
    lines = [lines[0].replace("command_V", "command"), *lines[1:100], *lines[102:]]
    found = [(problem.line, problem.field) for problem in judge(csv(lines))]
    assert found == [
        (None, "command_V"),
        (20, "position_m"),
        (40, "pressure_2_Pa"),
        (101, "time_s"),
    ]


def test_a_recording_full_of_dropouts_is_reported_by_its_first_twenty(
    judge: Judge, healthy_csv: list[str], tmp_path_factory: pytest.TempPathFactory
) -> None:
    lines = healthy_csv
    for line in range(10, 110, 2):
        lines = with_cell(lines, line, "position_m", "")
    path = tmp_path_factory.mktemp("dropouts") / "run.csv"
    path.write_text(csv(lines))
    with pytest.raises(RecordingError) as refusal:
        read_recording(path)
    assert [problem.line for problem in refusal.value.problems] == [*range(10, 50, 2)]
    assert len(refusal.value.problems) == MAX_PROBLEMS
    assert refusal.value.omitted == {str(path): 30}


@pytest.mark.parametrize("extension", [".mcap", ".parquet"])
def test_where_there_are_no_lines_problems_are_reported_by_row(
    healthy: Recording, tmp_path_factory: pytest.TempPathFactory, extension: str
) -> None:
    position_m = healthy["position_m"].copy()
    position_m[41] = np.nan
    path = tmp_path_factory.mktemp("rows") / f"run{extension}"
    export(Recording(healthy.channels | {"position_m": position_m}), path)
    with pytest.raises(RecordingError) as refusal:
        read_recording(path)
    problem = only(refusal.value.problems)
    assert (problem.line, problem.field) == (42, "position_m")
