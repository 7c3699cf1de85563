"""No damage to a file goes unnoticed: checksums and hashes are written, and are verified."""

import struct
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from rig.recording import (
    McapWriter,
    Recording,
    RecordingError,
    RecordingProblem,
    export,
    read_recording,
)

Judge = Callable[..., list[RecordingProblem]]
Rewrite = Callable[[pa.Table], pa.Table]
FLIPS = 60
_TAIL = 8


@pytest.fixture(scope="module")
def parquet(healthy: Recording, tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("exported") / "healthy.parquet"
    export(healthy, path)
    return path


@pytest.mark.parametrize("footer", [False, True], ids=["anywhere", "in the footer"])
def test_a_bit_that_flips_in_an_exported_parquet_file_never_changes_what_is_read(
    healthy: Recording, parquet: Path, tmp_path: Path, footer: bool
) -> None:
    rng = np.random.default_rng(20)
    content = parquet.read_bytes()
    (length,) = struct.unpack("<I", content[-_TAIL:-4])
    first = len(content) - _TAIL - length if footer else 0
    path = tmp_path / "flipped.parquet"
    refused = 0
    for bit in rng.integers(8 * first, 8 * len(content), FLIPS).tolist():
        flipped = bytearray(content)
        flipped[bit // 8] ^= 1 << bit % 8
        path.write_bytes(flipped)
        try:
            found = read_recording(path, required=())
        except RecordingError:
            refused += 1
        else:
            assert found.content_hash() == healthy.content_hash()
            assert (found.metadata, found.events) == (healthy.metadata, healthy.events)
    assert refused > 0.9 * FLIPS


def test_an_export_says_the_hash_of_what_it_holds(healthy: Recording, parquet: Path) -> None:
    described = pq.read_schema(parquet).metadata
    assert len(described[b"rig.sha256"]) == 64
    other = parquet.with_name("other.parquet")
    export(Recording(healthy.channels, {"seed": 2}, healthy.events), other)
    assert pq.read_schema(other).metadata[b"rig.sha256"] != described[b"rig.sha256"]


def with_a_value(table: pa.Table) -> pa.Table:
    values = table["spool_m"].to_numpy().copy()
    values[7] += 1e-9
    return table.set_column(table.column_names.index("spool_m"), "spool_m", pa.array(values))


def with_a_name(table: pa.Table) -> pa.Table:
    names = ["load_N" if name == "spool_m" else name for name in table.column_names]
    return table.rename_columns(names).replace_schema_metadata(table.schema.metadata)


def with_metadata(table: pa.Table) -> pa.Table:
    return table.replace_schema_metadata({**table.schema.metadata, b"rig.metadata": b'{"seed": 9}'})


@pytest.mark.parametrize("change", [with_a_value, with_a_name, with_metadata])
def test_values_that_another_program_changed_are_refused_until_it_says_so(
    judge: Judge, parquet: Path, tmp_path: Path, change: Rewrite
) -> None:
    changed = change(pq.read_table(parquet))
    path = tmp_path / "changed.parquet"
    pq.write_table(changed, path)
    (problem,) = judge(path.read_bytes(), "judged.parquet")
    assert "are not those that were written to it (by the SHA-256" in str(problem)
    assert "delete this metadata" in problem.remedy
    kept = {key: text for key, text in changed.schema.metadata.items() if key != b"rig.sha256"}
    pq.write_table(changed.replace_schema_metadata(kept), path)
    assert len(read_recording(path)) == changed.num_rows


def test_a_parquet_file_of_before_without_checksums_is_read(
    healthy: Recording, tmp_path: Path
) -> None:
    path = tmp_path / "before.parquet"
    metadata = {b"rig.metadata": b'{"seed": 1}', b"rig.events": b'[[0.5, "note", "x"]]'}
    table = pa.table({name: pa.array(values) for name, values in healthy.channels.items()})
    pq.write_table(
        table.replace_schema_metadata(metadata), path, compression="zstd",
        use_dictionary=False, use_byte_stream_split=True,
    )  # fmt: skip
    found = read_recording(path)
    assert found.content_hash() == healthy.content_hash()
    assert found.metadata == {"seed": 1}


@pytest.fixture
def mcap(tmp_path: Path, healthy: Recording) -> bytes:
    path = tmp_path / "whole.mcap"
    with McapWriter(path, list(healthy.channels), {"seed": 1}) as writer:
        writer.event(0.5, "note", "x")
        writer.write(np.column_stack(list(healthy.channels.values())))
    return path.read_bytes()


_CHUNK, _CRC_OF_CHUNK = 6, 24  # opcode; offset of the checksum in the record's content


def without_chunk_checksums(content: bytes) -> bytes:
    changed, offset = bytearray(content), 8
    while offset < len(content) - 8:
        opcode, length = struct.unpack_from("<BQ", content, offset)
        if opcode == _CHUNK:
            struct.pack_into("<I", changed, offset + 9 + _CRC_OF_CHUNK, 0)
        offset += 9 + length
    return bytes(changed)


def without_the_summary_s(content: bytes) -> bytes:
    return content[:-12] + bytes(4) + content[-8:]


@pytest.mark.parametrize("zeroed", [without_chunk_checksums, without_the_summary_s])
def test_a_recording_without_its_checksums_is_refused(
    judge: Judge, mcap: bytes, zeroed: Callable[[bytes], bytes]
) -> None:
    (problem,) = judge(zeroed(mcap), "zeroed.mcap")
    assert "checksum is missing" in str(problem)
    assert "rig recover" in problem.remedy


def test_a_summary_that_names_channels_which_are_not_there_is_damage(
    judge: Judge, mcap: bytes
) -> None:
    footer = len(mcap) - 8 - 29
    (start,) = struct.unpack_from("<Q", mcap, footer + 9)
    changed = bytearray(mcap)
    offset = start
    while changed[offset] != 0x0B:  # the statistics, which count the messages of each channel
        offset += 9 + struct.unpack_from("<Q", changed, offset + 1)[0]
    struct.pack_into("<H", changed, offset + 9 + 46, 77)
    struct.pack_into("<I", changed, footer + 25, zlib.crc32(bytes(changed[start : footer + 25])))
    (problem,) = judge(bytes(changed), "named.mcap")
    assert "damaged (a record of wrong form)" in str(problem)
