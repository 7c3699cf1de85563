"""MCAP as other programs read it, and what is on disk when the writer dies."""

import json
import struct
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st
from mcap.reader import NonSeekingReader, make_reader

from rig.recording import McapWriter, Recording, RecordingError, read_recording, recover
from rig.recording.formats.mcap_writer import CHUNK_SAMPLES
from rig.recording.formats.sample_layout import SampleLayout, sample_schema


def protobuf_fields(data: bytes) -> Iterator[tuple[int, bytes | int | float]]:
    """Decode a protobuf message by the wire format: (field number, value) in order."""
    position = 0

    def varint() -> int:
        nonlocal position
        value = shift = 0
        while True:
            byte = data[position]
            position += 1
            value |= (byte & 0x7F) << shift
            shift += 7
            if byte < 0x80:
                return value

    while position < len(data):
        number, wire_type = divmod(varint(), 8)
        if wire_type == 0:
            yield number, varint()
        elif wire_type == 1:
            yield number, struct.unpack_from("<d", data, position)[0]
            position += 8
        else:
            assert wire_type == 2
            length = varint()
            yield number, data[position : position + length]
            position += length


def names_of(count: int) -> list[str]:
    return ["time_s", *(f"est_{k}_Pa" for k in range(count - 1))]


@pytest.mark.parametrize("count", [1, 2, 15, 16, 17, 40, 300])
def test_the_schema_is_a_file_descriptor_set_of_one_double_a_channel(count: int) -> None:
    names = names_of(count)
    [(_, file)] = protobuf_fields(sample_schema(names))
    assert isinstance(file, bytes)
    described = dict(protobuf_fields(file))
    assert (described[2], described[12]) == (b"rig", b"proto3")
    message = described[4]
    assert isinstance(message, bytes)
    (_, name), *fields = protobuf_fields(message)
    assert name == b"Sample"
    double, optional = 1, 1
    assert [dict(protobuf_fields(field)) for _, field in fields if isinstance(field, bytes)] == [
        {1: name.encode(), 3: number, 4: optional, 5: double, 10: name.encode()}
        for number, name in enumerate(names, 1)
    ]


@given(count=st.integers(1, 40), seed=st.integers(0, 2**32 - 1))
def test_every_sample_is_a_protobuf_message_of_its_values(count: int, seed: int) -> None:
    rows = np.random.default_rng(seed).standard_normal((3, count))
    layout = SampleLayout(names_of(count))
    records = layout.blank(3, 1)
    layout.set_values(records, rows)
    data = records.tobytes()
    header = 9 + 22  # opcode and length; channel, sequence and two times
    for k, row in enumerate(rows):
        record = data[k * layout.dtype.itemsize : (k + 1) * layout.dtype.itemsize]
        assert list(protobuf_fields(record[header:])) == list(enumerate(row.tolist(), 1))


def test_any_mcap_reader_finds_samples_events_and_metadata_in_order(
    healthy: Recording, tmp_path: Path
) -> None:
    start_ns = 1_700_000_000_000_000_000
    rows = np.column_stack(list(healthy.channels.values()))
    path = tmp_path / "run.mcap"
    metadata = {"seed": 3, "start_ns": start_ns}
    with McapWriter(path, list(healthy.channels), metadata) as writer:
        writer.write(rows[:300])
        writer.event(0.2995, "fault", "internal_leakage opens")
        writer.write(rows[300:])
        writer.event(1.9995, "note", "end")
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        records = {record.name: record.metadata for record in reader.iter_metadata()}
        messages = list(reader.iter_messages())
    assert {key: json.loads(text) for key, text in records["rig"].items()} == metadata
    times = [message.log_time - start_ns for _, _, message in messages]
    assert times == sorted([*range(0, 2_000_000_000, 1_000_000), 299_500_000, 1_999_500_000])
    noted = [json.loads(m.data) for _, c, m in messages if c.topic == "rig/events"]
    assert noted[0] == {"time_s": 0.2995, "kind": "fault", "text": "internal_leakage opens"}
    samples = [message for _, channel, message in messages if channel.topic == "rig/samples"]
    assert [message.sequence for message in samples] == list(range(2000))
    assert [value for _, value in protobuf_fields(samples[1234].data)] == rows[1234].tolist()


def test_the_library_finds_a_moment_by_the_index(healthy: Recording, tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with McapWriter(path, list(healthy.channels)) as writer:
        writer.write(np.column_stack(list(healthy.channels.values())))
    with path.open("rb") as file:
        found = make_reader(file).iter_messages(
            "rig/samples", starting_at=1_500_000_000, ending_before=1_510_000_000
        )
        assert [message.sequence for _, _, message in found] == list(range(1500, 1510))


@given(cuts=st.lists(st.integers(0, 2000), max_size=6), flushed=st.integers(0, 2000))
def test_how_samples_are_batched_does_not_matter(
    tmp_path_factory: pytest.TempPathFactory, healthy: Recording, cuts: list[int], flushed: int
) -> None:
    rows = np.column_stack(list(healthy.channels.values()))
    path = tmp_path_factory.mktemp("batches") / "run.mcap"
    bounds = sorted({0, 2000, flushed, *cuts})
    with McapWriter(path, list(healthy.channels)) as writer:
        for first, last in pairwise(bounds):
            writer.write(rows[first:last])
            if last == flushed:
                writer.flush()
    assert read_recording(path).content_hash() == healthy.content_hash()


def test_a_second_of_data_is_on_disk_without_being_asked(
    healthy: Recording, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    with McapWriter(path, list(healthy.channels)) as writer:
        writer.write(np.column_stack(list(healthy.channels.values()))[: CHUNK_SAMPLES + 200])
        summary = recover(path, tmp_path / "copy.mcap")
    assert summary.samples_kept == CHUNK_SAMPLES


def test_the_file_is_complete_even_when_the_run_ends_in_an_error(
    healthy: Recording, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"

    def interrupted_run() -> None:
        with McapWriter(path, list(healthy.channels), {"seed": 2}) as writer:
            writer.write(np.column_stack(list(healthy.channels.values()))[:1100])
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted_run()
    recording = read_recording(path)
    assert (len(recording), recording.metadata) == (1100, {"seed": 2})


def test_an_aborted_run_without_samples_still_leaves_a_valid_file(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    with McapWriter(path, ["time_s", "position_m"], {"seed": 2}):
        pass
    with path.open("rb") as file:
        assert list(NonSeekingReader(file, validate_crcs=True).iter_messages()) == []
    with pytest.raises(RecordingError, match="no samples"):
        read_recording(path, required=["time_s"])


def test_an_existing_recording_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "run.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(RecordingError, match="exists already"):
        McapWriter(path, ["time_s"])
    assert path.read_bytes() == b"precious"


def test_what_cannot_be_written_is_reported_all_at_once_and_no_file_is_made(tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as refusal:
        McapWriter(tmp_path / "a" / "run.mcap", ["x m", "y_m", "y_m"], {"gain": float("nan")})
    reported = [problem.field for problem in refusal.value.problems]
    assert reported == ["metadata 'gain'", "channels", "channels", "channels", "file"]
    assert not (tmp_path / "a").exists()


@pytest.mark.parametrize(
    ("rows", "fault"),
    [
        (np.zeros((2, 3)), r"rows of shape \(2, 3\), must be \(n, 2\) for time_s, position_m"),
        (np.zeros(2), r"rows of shape \(2,\)"),
        (np.array([[np.nan, 0.0]]), "time_s = nan s, must be finite"),
        (np.array([[-1.0, 0.0]]), "time_s = -1 s"),
    ],
)
def test_rows_that_do_not_fit_are_refused(
    tmp_path: Path, rows: "np.ndarray[tuple[int, ...], np.dtype[np.float64]]", fault: str
) -> None:
    with (
        McapWriter(tmp_path / "run.mcap", ["time_s", "position_m"]) as writer,
        pytest.raises(ValueError, match=fault),
    ):
        writer.write(rows)
