"""What is exported reads back bit for bit, in every format."""

import struct
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from rig.recording import Event, Recording, RecordingError, export, read_recording

FORMATS = [".mcap", ".csv", ".csv.gz", ".parquet"]

json_values = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(), inner, max_size=3),
    max_leaves=8,
)
events = st.lists(
    st.builds(Event, time_s=st.floats(0.0, 2.0), kind=st.text(max_size=8), text=st.text()),
    max_size=3,
)


def bits(values: NDArray[np.float64]) -> NDArray[np.uint64]:
    """Return float64 bit patterns, all NaN alike."""
    return np.where(np.isnan(values), np.nan, values).view(np.uint64)


def filled(values: Sequence[float], n: int) -> NDArray[np.float64]:
    return np.resize(np.array(values, dtype=np.float64), n)


@pytest.mark.parametrize("extension", FORMATS)
@given(
    optional=st.lists(st.floats(), min_size=1, max_size=60),
    position=st.lists(st.floats(-0.1, 1.0), min_size=1, max_size=60),
    metadata=st.dictionaries(st.text(), json_values, max_size=3),
    noted=events,
)
def test_a_recording_reads_back_bit_for_bit_with_metadata_and_events(
    tmp_path_factory: pytest.TempPathFactory,
    healthy: Recording,
    extension: str,
    optional: list[float],
    position: list[float],
    metadata: dict[str, object],
    noted: list[Event],
) -> None:
    metadata.pop("start_ns", None)
    n = len(healthy)
    channels = healthy.channels | {
        "position_m": filled(position, n),
        "est_load_N": filled(optional, n),
    }
    recording = Recording(channels, metadata, noted)
    path = tmp_path_factory.mktemp("round") / f"trip{extension}"
    export(recording, path)
    copy = read_recording(path)
    assert list(copy.channels) == list(channels)
    for name, values in channels.items():
        np.testing.assert_array_equal(bits(copy[name]), bits(values), strict=True)
    assert copy.content_hash() == recording.content_hash()
    assert copy.metadata == metadata
    assert copy.events == noted


@pytest.mark.parametrize("extension", [".mcap", ".parquet"])
def test_binary_formats_keep_even_the_bits_of_a_nan(
    healthy: Recording, tmp_path: Path, extension: str
) -> None:
    odd = filled(struct.unpack("<2d", struct.pack("<2Q", 0x7FF8000000000123, 0xFFF8 << 48)), 2000)
    export(Recording(healthy.channels | {"load_N": odd}), tmp_path / f"run{extension}")
    copy = read_recording(tmp_path / f"run{extension}")["load_N"]
    assert (copy.view(np.uint64) == odd.view(np.uint64)).all()


@pytest.mark.parametrize("extension", FORMATS)
def test_equal_recordings_make_equal_files(
    healthy: Recording, tmp_path: Path, extension: str
) -> None:
    export(healthy, tmp_path / f"a{extension}")
    export(healthy, tmp_path / f"b{extension}")
    assert (tmp_path / f"a{extension}").read_bytes() == (tmp_path / f"b{extension}").read_bytes()


def test_parquet_fields_carry_their_units(healthy: Recording, tmp_path: Path) -> None:
    export(healthy, tmp_path / "run.parquet")
    schema = pq.read_schema(tmp_path / "run.parquet")
    units = {field.name: field.metadata[b"unit"] for field in schema}
    assert units["pressure_1_Pa"] == b"Pa"
    assert units["time_s"] == b"s"


def test_csv_has_the_plain_columns_alone(healthy: Recording, tmp_path: Path) -> None:
    export(healthy, tmp_path / "run.csv")
    with (tmp_path / "run.csv").open() as file:
        assert next(file) == "time_s,command_V,position_m,pressure_1_Pa,pressure_2_Pa,spool_m\n"


def test_a_missing_sample_is_an_empty_cell_in_csv(healthy: Recording, tmp_path: Path) -> None:
    load_n = np.full(len(healthy), np.nan)
    load_n[1] = 2.5
    export(Recording({"time_s": healthy.time_s, "load_N": load_n}), tmp_path / "run.csv")
    assert (tmp_path / "run.csv").read_text().startswith("time_s,load_N\n0,\n0.001,2.5\n")


def test_metadata_beside_a_csv_is_not_taken_for_that_of_other_data(
    healthy: Recording, tmp_path: Path
) -> None:
    path = tmp_path / "run.csv"
    export(healthy, path)
    path.write_text("\n".join(path.read_text().splitlines()[:1500]))
    with pytest.warns(UserWarning, match="describes other data"):
        cut = read_recording(path)
    assert (cut.metadata, cut.events) == ({}, [])


def test_unreadable_metadata_beside_a_csv_is_refused(healthy: Recording, tmp_path: Path) -> None:
    export(healthy, tmp_path / "run.csv")
    (tmp_path / "run.csv.json").write_text("{")
    with pytest.raises(RecordingError, match=r"run\.csv\.json: file: cannot be read"):
        read_recording(tmp_path / "run.csv")


def test_metadata_of_a_former_export_does_not_stay_behind(
    healthy: Recording, tmp_path: Path
) -> None:
    export(healthy, tmp_path / "run.csv")
    export(Recording(healthy.channels), tmp_path / "run.csv")
    assert read_recording(tmp_path / "run.csv").metadata == {}


@pytest.mark.parametrize("extension", FORMATS)
def test_an_export_that_fails_leaves_the_former_file_and_nothing_else(
    healthy: Recording, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, extension: str
) -> None:
    path = tmp_path / f"run{extension}"
    export(Recording(healthy.channels), path)
    before = path.read_bytes()

    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("os.replace", fail)
    with pytest.raises(OSError, match="disk full"):
        export(healthy, path)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_what_cannot_be_written_is_reported_all_at_once_and_nothing_is_written(
    healthy: Recording, tmp_path: Path
) -> None:
    odd = Recording(
        {"time_s": healthy.time_s, "load N": healthy.time_s}, {"gain": np.inf, "at": object()}
    )
    with pytest.raises(RecordingError) as refusal:
        export(odd, tmp_path / "run.mcap")
    fields = [problem.field for problem in refusal.value.problems]
    assert fields == ["metadata 'gain'", "metadata 'at'", "channels"]
    assert not list(tmp_path.iterdir())


def test_an_unknown_format_and_a_missing_folder_are_reported(
    healthy: Recording, tmp_path: Path
) -> None:
    with pytest.raises(RecordingError) as refusal:
        export(healthy, tmp_path / "none" / "run.mat")
    values = [problem.value for problem in refusal.value.problems]
    assert values == ["unknown extension '.mat'", f"folder {tmp_path / 'none'} does not exist"]
