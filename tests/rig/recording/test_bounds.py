"""A small file cannot fill the memory: what it would unfold to is bounded before it is read."""

import gzip
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import zstandard
from mcap.records import Chunk

from rig.recording import (
    McapWriter,
    Recording,
    RecordingError,
    RecordingProblem,
    bounds,
    read_bounded,
    read_recording,
    recover,
)
from rig.recording.formats import sample_collector

Judge = Callable[..., list[RecordingProblem]]


@pytest.fixture
def little_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let recordings take one megabyte."""
    share = 1e6 / (os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))
    monkeypatch.setattr(bounds, "SHARE_OF_MEMORY", share)
    monkeypatch.setattr(bounds, "_CONTAINER_LIMIT", Path("/nowhere"))


def test_no_more_memory_is_taken_than_a_container_may_have(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    limit = tmp_path / "memory.max"
    monkeypatch.setattr(bounds, "_CONTAINER_LIMIT", limit)
    limit.write_text("max\n")
    whole = bounds.most_bytes()
    limit.write_text("8000000\n")
    assert bounds.most_bytes() == 2_000_000 < whole


def test_a_compressed_csv_of_zeros_is_refused_after_its_first_megabyte(judge: Judge) -> None:
    (problem,) = judge(gzip.compress(bytes(20 << 20)), "bomb.csv.gz")
    assert "a line is longer than 1.05 MB" in str(problem)


@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize("row", [b"0,0\n", b"\n", b"1.5,2,3,4,5,6,7,8,9\n"])
def test_a_compressed_csv_of_too_many_rows_is_refused(judge: Judge, row: bytes) -> None:
    (problem,) = judge(gzip.compress(b"time_s,x\n" + row * 300_000), "bomb.csv.gz")
    assert "too large: " in str(problem)
    assert "of this machine's memory" in str(problem)


@pytest.mark.parametrize("name", ["holes.csv", "holes.parquet", "holes.mcap"])
def test_a_file_of_holes_is_refused_unread(tmp_path: Path, name: str) -> None:
    path = tmp_path / name
    with path.open("wb") as file:
        file.truncate(6_000_000_000)
    with pytest.raises(RecordingError):
        read_recording(path)


@pytest.mark.usefixtures("little_memory")
@pytest.mark.parametrize(
    "columns",
    [
        {"time_s": np.zeros(200_000), "x": np.zeros(200_000)},
        {"time_s": np.zeros(1), "x": ["x" * 3_000_000]},
    ],
    ids=["rows", "a text"],
)
def test_a_parquet_file_that_unfolds_is_refused_by_what_its_footer_says(
    judge: Judge, tmp_path: Path, columns: dict[str, object]
) -> None:
    path = tmp_path / "made.parquet"
    pq.write_table(pa.table(columns), path, compression="zstd")
    assert path.stat().st_size < 10_000
    (problem,) = judge(path.read_bytes(), "bomb.parquet")
    assert "too large: " in str(problem)


def chunk(data: bytes, size: int, compression: str = "zstd") -> Chunk:
    return Chunk(
        compression=compression, data=data, message_start_time=0, message_end_time=1,
        uncompressed_crc=1, uncompressed_size=size,
    )  # fmt: skip


@pytest.mark.parametrize(
    ("bomb", "reason"),
    [
        (chunk(b"", 1 << 40), r"takes 1.1e\+03 GB, and may take 268 MB"),
        (chunk(zstandard.compress(bytes(1 << 24)), 1000), "does not hold the 1000 bytes"),
        (chunk(bytes(2000), 1000, ""), "does not hold the 1000 bytes"),
        (chunk(b"", 0, "brotli"), "compression 'brotli' is not known"),
        (chunk(b"", 0, ""), "checksum is wrong"),
    ],
)
def test_a_chunk_is_decompressed_no_further_than_it_says(bomb: Chunk, reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        sample_collector._content_of(bomb)


@pytest.fixture
def recorded(tmp_path: Path, healthy: Recording) -> Path:
    path = tmp_path / "run.mcap"
    with McapWriter(path, list(healthy.channels), {"seed": 1}) as writer:
        writer.write(np.column_stack(list(healthy.channels.values())))
    return path


def test_more_samples_than_memory_takes_are_neither_read_nor_recovered(
    tmp_path: Path, recorded: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(bounds, "SHARE_OF_MEMORY", 1e-9)
    with pytest.raises(RecordingError, match="too large: its samples take 48 kB"):
        read_recording(recorded)
    with pytest.raises(RecordingError, match="too large: its samples take 48 kB"):
        recover(recorded, tmp_path / "whole.mcap")


def test_a_recording_that_a_power_cut_filled_up_with_zeros_is_recovered_at_once(
    tmp_path: Path, recorded: Path, healthy: Recording
) -> None:
    with recorded.open("r+b") as file:
        file.truncate(recorded.stat().st_size // 4 * 3)
        file.truncate(6_000_000_000)
    summary = recover(recorded, tmp_path / "whole.mcap")
    assert 1000 <= summary.samples_kept < len(healthy)
    assert "of 6000000000: cut off or unreadable" in str(summary)


def test_neither_a_device_nor_a_pipe_nor_what_is_larger_is_read(tmp_path: Path) -> None:
    pipe, large = tmp_path / "pipe", tmp_path / "large"
    os.mkfifo(pipe)
    large.write_bytes(bytes(11))
    for path, reason in (
        (Path("/dev/zero"), "a device"), (pipe, "a pipe"), (large, "larger than 10 bytes"),
    ):  # fmt: skip
        with pytest.raises(OSError, match=reason):
            read_bounded(path, 10)
    assert read_bounded(large, 11) == bytes(11)


def test_a_pipe_with_the_name_of_a_recording_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "run.csv")
    with pytest.raises(RecordingError, match="is no regular file"):
        read_recording(tmp_path / "run.csv")
