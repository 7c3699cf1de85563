"""What is left of a recording when its writer is killed or its file is damaged."""

import subprocess
import sys
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, strategies as st
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

from rig.recording import McapWriter, Recording, RecordingError, export, read_recording, recover

from .rewriting import rewrite

KILLED_WRITER = """
import sys
import numpy as np
from rig.recording import McapWriter

rows = np.load(sys.argv[2])
writer = McapWriter(sys.argv[1], sys.argv[3].split(","), {"seed": 7})
writer.write(rows[:700])
writer.write(rows[700:1234])
writer.flush()
writer.event(1.2, "fault", "internal_leakage opens")
writer.flush()
writer.write(rows[1234:1900])
print("flushed and written on", flush=True)
sys.stdin.read()
"""


@pytest.fixture(scope="module")
def whole(healthy: Recording, tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of a complete file of three chunks of 600, 600 and 800 samples."""
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    rows = np.column_stack(list(healthy.channels.values()))
    with McapWriter(path, list(healthy.channels), {"seed": 7}) as writer:
        for first, last in ((0, 600), (600, 1200), (1200, 2000)):
            writer.write(rows[first:last])
            writer.flush()
    return path.read_bytes()


def second_chunk(whole: bytes) -> int:
    """Return an offset within the second chunk's compressed samples."""
    return int(len(whole) * 0.45)


def test_a_killed_writer_leaves_every_flushed_sample_and_event(
    healthy: Recording, tmp_path: Path
) -> None:
    path = tmp_path / "run.mcap"
    rows = np.column_stack(list(healthy.channels.values()))
    np.save(tmp_path / "rows.npy", rows)
    arguments = [str(path), str(tmp_path / "rows.npy"), ",".join(healthy.channels)]
    with subprocess.Popen(
        [sys.executable, "-c", KILLED_WRITER, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
    ) as writer:
        assert writer.stdout is not None
        assert writer.stdout.readline() == b"flushed and written on\n"
        writer.kill()

    with pytest.raises(RecordingError, match=rf"cut off.*; rig recover {path} OUT"):
        read_recording(path)
    summary = recover(path, tmp_path / "saved.mcap")
    saved = read_recording(tmp_path / "saved.mcap")
    assert summary.samples_kept == len(saved) == 1234
    assert summary.last_time_s == saved.time_s[-1] == 1.233
    for name, values in healthy.channels.items():
        np.testing.assert_array_equal(saved[name], values[:1234])
    assert saved.metadata["seed"] == 7
    assert [event.kind for event in saved.events] == ["fault"]
    assert "cut off" in saved.metadata["recovered"]["lost"][0]
    assert "1234 samples, 0 s to 1.233 s, 1 events" in str(summary)


@example(keep=1e-5)  # within the first bytes, by which the file is known as MCAP
@given(keep=st.floats(0.0, 1.0, exclude_max=True))
def test_a_file_cut_anywhere_is_refused_and_its_whole_chunks_are_recovered(
    healthy: Recording, whole: bytes, tmp_path_factory: pytest.TempPathFactory, keep: float
) -> None:
    folder = tmp_path_factory.mktemp("cut")
    (folder / "cut.mcap").write_bytes(whole[: int(keep * len(whole))])
    with pytest.raises(RecordingError):
        read_recording(folder / "cut.mcap")
    try:
        summary = recover(folder / "cut.mcap", folder / "saved.mcap")
    except RecordingError:
        assert not (folder / "saved.mcap").exists()
        assert keep < 0.5  # at least the first of three chunks is there beyond
        return
    assert summary.samples_kept in (600, 1200, 2000)
    saved = read_recording(folder / "saved.mcap") if summary.samples_kept > 1000 else None
    if saved is not None:
        np.testing.assert_array_equal(
            saved["pressure_1_Pa"], healthy["pressure_1_Pa"][: len(saved)]
        )


@given(place=st.floats(0.0, 1.0, exclude_max=True), bit=st.integers(0, 7))
def test_a_damaged_file_is_read_right_or_refused_never_read_wrong(
    healthy: Recording,
    whole: bytes,
    tmp_path_factory: pytest.TempPathFactory,
    place: float,
    bit: int,
) -> None:
    damaged = bytearray(whole)
    damaged[int(place * len(whole))] ^= 1 << bit
    path = tmp_path_factory.mktemp("flip") / "run.mcap"
    path.write_bytes(damaged)
    try:
        recording = read_recording(path)
    except RecordingError:
        return
    assert recording.content_hash() == healthy.content_hash()


def test_an_index_that_lost_its_end_does_not_shorten_the_recording(
    whole: bytes, tmp_path: Path
) -> None:
    with BytesIO(whole) as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    damaged = bytearray(whole)
    for record in (summary.statistics, summary.chunk_indexes[-1]):
        builder = RecordBuilder()
        record.write(builder)
        damaged[whole.rindex(builder.end())] = 0x7F  # an opcode that readers pass over
    (tmp_path / "run.mcap").write_bytes(damaged)
    with pytest.raises(RecordingError, match="summary's checksum is wrong"):
        read_recording(tmp_path / "run.mcap")


def test_damage_in_the_middle_keeps_the_longest_unbroken_part(
    healthy: Recording, whole: bytes, tmp_path: Path
) -> None:
    damaged = bytearray(whole)
    damaged[second_chunk(whole)] ^= 0xFF
    (tmp_path / "run.mcap").write_bytes(damaged)
    with pytest.raises(RecordingError, match=r"damaged.*; rig recover"):
        read_recording(tmp_path / "run.mcap")
    summary = recover(tmp_path / "run.mcap", tmp_path / "saved.mcap")
    assert (summary.samples_kept, summary.samples_dropped) == (800, 600)
    assert (summary.first_time_s, summary.last_time_s) == (1.2, 1.999)
    assert summary.lost[0].startswith("a chunk of log time 0.6 s to 1.199 s")
    assert summary.lost[1] == "600 readable samples on the other side of a gap"


def test_a_chunk_whose_record_is_gone_leaves_no_hidden_gap(whole: bytes, tmp_path: Path) -> None:
    chunk = 0x06
    damaged = bytearray(whole)
    with BytesIO(whole) as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    start = summary.chunk_indexes[1].chunk_start_offset
    assert damaged[start] == chunk
    damaged[start] = 0x7F  # an opcode that readers pass over
    (tmp_path / "run.mcap").write_bytes(damaged)
    recovered = recover(tmp_path / "run.mcap", tmp_path / "saved.mcap")
    assert (recovered.samples_kept, recovered.first_time_s) == (800, 1.2)


def test_a_sound_file_is_recovered_whole(healthy: Recording, whole: bytes, tmp_path: Path) -> None:
    (tmp_path / "run.mcap").write_bytes(whole)
    summary = recover(tmp_path / "run.mcap", tmp_path / "saved.mcap")
    assert summary.lost == ()
    assert "nothing was lost" in str(summary)
    saved = read_recording(tmp_path / "saved.mcap")
    assert saved.content_hash() == healthy.content_hash()


def test_what_lies_behind_a_recording_is_told_as_lost(whole: bytes, tmp_path: Path) -> None:
    path = tmp_path / "two.mcap"
    path.write_bytes(whole + whole)
    summary = recover(path, tmp_path / "out.mcap")
    assert f"{len(whole)} bytes behind the recording's end" in str(summary)


@pytest.mark.parametrize("target", ["run.mcap", "other.mcap"])
def test_recovery_overwrites_neither_its_input_nor_anything_else(
    whole: bytes, tmp_path: Path, target: str
) -> None:
    (tmp_path / "run.mcap").write_bytes(whole)
    (tmp_path / "other.mcap").write_bytes(b"precious")
    before = (tmp_path / target).read_bytes()
    with pytest.raises(RecordingError, match="exists already"):
        recover(tmp_path / "run.mcap", tmp_path / target)
    assert (tmp_path / target).read_bytes() == before


def test_recovery_shows_all_that_is_wrong_with_its_paths(tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as refusal:
        recover(tmp_path / "none.mcap", tmp_path / "none" / "out.csv")
    values = [problem.value for problem in refusal.value.problems]
    assert values == [
        "is no file",
        "not an MCAP name",
        f"folder {tmp_path / 'none'} does not exist",
    ]


def test_a_file_that_is_no_mcap_is_not_taken_for_a_damaged_one(
    healthy: Recording, tmp_path: Path
) -> None:
    export(healthy, tmp_path / "run.csv")
    (tmp_path / "run.csv").rename(tmp_path / "run.mcap")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        read_recording(tmp_path / "run.mcap")
    with pytest.raises(RecordingError, match="not an MCAP file"):
        recover(tmp_path / "run.mcap", tmp_path / "saved.mcap")


@pytest.mark.parametrize("topic", ["rig/samples", "/imu"])
def test_another_programs_mcap_is_refused_as_such(tmp_path: Path, topic: str) -> None:
    with (tmp_path / "run.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("Imu", "jsonschema", b"{}")
        channel = writer.register_channel(topic, "json", schema)
        writer.add_message(channel, 0, b"{}", 0)
        writer.finish()
    for attempt in (
        lambda: read_recording(tmp_path / "run.mcap"),
        lambda: recover(tmp_path / "run.mcap", tmp_path / "saved.mcap"),
    ):
        with pytest.raises(RecordingError, match="only recordings written by rig"):
            attempt()


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("compression", [CompressionType.NONE, CompressionType.LZ4])
def test_a_recording_rewritten_by_an_mcap_tool_keeps_its_data(
    healthy: Recording,
    whole: bytes,
    tmp_path: Path,
    chunked: bool,
    compression: CompressionType,
) -> None:
    copy = tmp_path / "copy.mcap"
    rewrite(whole, copy, compression=compression, use_chunking=chunked, chunk_size=10_000)
    recover(copy, tmp_path / "saved.mcap")
    assert read_recording(tmp_path / "saved.mcap").content_hash() == healthy.content_hash()
    if chunked:
        assert read_recording(tmp_path / "copy.mcap").content_hash() == healthy.content_hash()
    else:
        with pytest.raises(RecordingError, match=r"leads to 0 of 2000 messages.*; rig recover"):
            read_recording(tmp_path / "copy.mcap")
