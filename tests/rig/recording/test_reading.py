"""Which file is read as what, and what is said when there is none."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from rig.recording import Recording, RecordingError, RecordingProblem, export, read_recording


def refusal(path: Path) -> RecordingProblem:
    with pytest.raises(RecordingError) as error:
        read_recording(path)
    assert len(error.value.problems) == 1, str(error.value)
    return error.value.problems[0]


def test_a_missing_file_is_reported_with_the_nearest_names(
    healthy: Recording, tmp_path: Path
) -> None:
    export(healthy, tmp_path / "leak_chamber_1.csv.gz")
    export(healthy, tmp_path / "healthy.csv.gz")
    problem = refusal(tmp_path / "leak_chamber1.csv.gz")
    assert problem.value == "does not exist"
    assert problem.remedy == "did you mean leak_chamber_1.csv.gz?"


def test_a_missing_folder_is_reported(tmp_path: Path) -> None:
    assert "does not exist either" in refusal(tmp_path / "none" / "run.csv").remedy


def test_a_folder_is_not_a_recording(tmp_path: Path) -> None:
    problem = refusal(tmp_path)
    assert problem.value == "is a folder"
    assert problem.remedy.endswith(f"{tmp_path}/*.mcap")  # as `rig run` leaves them


def test_an_unknown_extension_is_reported_with_those_known(tmp_path: Path) -> None:
    path = tmp_path / "run.xlsx"
    path.write_bytes(b"PK")
    problem = refusal(path)
    assert problem.value == "unknown extension '.xlsx'"
    assert problem.limit == "recordings are .mcap, .csv, .csv.gz, .parquet"


def test_extensions_count_in_any_case(healthy: Recording, tmp_path: Path) -> None:
    export(healthy, tmp_path / "RUN.CSV.GZ")
    assert len(read_recording(tmp_path / "RUN.CSV.GZ")) == len(healthy)


def test_the_recording_knows_where_it_came_from(healthy: Recording, tmp_path: Path) -> None:
    export(healthy, tmp_path / "run.parquet")
    assert read_recording(tmp_path / "run.parquet").source == str(tmp_path / "run.parquet")


def test_fewer_channels_may_be_asked_for_but_never_without_time(
    healthy: Recording, tmp_path: Path
) -> None:
    some = {name: healthy[name] for name in ("time_s", "position_m")}
    export(Recording(some), tmp_path / "run.csv")
    assert "position_m" in read_recording(tmp_path / "run.csv", required=["position_m"])
    table = pa.table({"position_m": healthy["position_m"]})
    pq.write_table(table, tmp_path / "run.parquet")
    with pytest.raises(RecordingError, match="time_s: missing column"):
        read_recording(tmp_path / "run.parquet", required=["position_m"])


def test_a_parquet_column_of_texts_or_named_twice_is_refused(
    healthy: Recording, tmp_path: Path
) -> None:
    names = [*healthy.channels, "state", "load_N", "load_N"]
    texts = ["running"] * len(healthy)
    numbers = np.arange(len(healthy))
    arrays = [*healthy.channels.values(), texts, numbers, numbers]
    pq.write_table(pa.table([pa.array(a) for a in arrays], names=names), tmp_path / "run.parquet")
    with pytest.raises(RecordingError) as error:
        read_recording(tmp_path / "run.parquet")
    assert [problem.field for problem in error.value.problems] == ["state", "load_N"]


def test_parquet_of_another_program_is_read_with_integers_and_nulls(
    healthy: Recording, tmp_path: Path
) -> None:
    load_n = [None, *range(1, len(healthy))]
    table = pa.table(healthy.channels | {"load_N": pa.array(load_n, pa.int32())})
    pq.write_table(table, tmp_path / "run.parquet")
    recording = read_recording(tmp_path / "run.parquet")
    assert np.isnan(recording["load_N"][0])
    assert recording["load_N"][7] == 7.0


def test_a_damaged_parquet_file_is_refused(healthy: Recording, tmp_path: Path) -> None:
    path = tmp_path / "run.parquet"
    export(healthy, path)
    path.write_bytes(path.read_bytes()[:-20])
    assert refusal(path).value.startswith("cannot be read as Parquet")
