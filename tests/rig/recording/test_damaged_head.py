"""One flipped bit before the first chunk costs a recording none of its samples."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from rig.recording import McapWriter, RecordingError, division_of, recover
from rig.recording.formats import read_mcap

from .rewriting import rewrite

N = 300
CHANNELS = ("time_s", "setpoint_m", "position_m", "pressure_1_Pa", "est_position_m", "tick")
METADATA = {"start_ns": 10**18, "test": {"type": "CampaignTest"}, "units": {"position_m": "m"}}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """The bytes of a complete, divided recording of three chunks of 100 samples each."""
    path = tmp_path_factory.mktemp("whole") / "run.mcap"
    ticks = np.arange(N)
    rows = np.column_stack([ticks * 1e-3, *np.random.default_rng(1).standard_normal((4, N)), ticks])
    with McapWriter(path, CHANNELS, METADATA, division_of(CHANNELS)) as writer:
        for first in range(0, N, 100):
            writer.write(rows[first : first + 100])
            writer.flush()
    return path.read_bytes()


def saved(folder: Path, content: bytes, offset: int | None = None) -> Sequence[str]:
    """Flip a bit at an offset, recover the file, check that no sample is lost; return losses."""
    damaged = bytearray(content)
    if offset is not None:
        damaged[offset] ^= 4
    (folder / "run.mcap").write_bytes(damaged)
    summary = recover(folder / "run.mcap", folder / "saved.mcap")
    columns = read_mcap(str(folder / "saved.mcap")).columns
    assert summary.samples_kept == len(columns["time_s"]) == N
    return summary.lost


@pytest.mark.parametrize(
    ("before", "further", "kind"),
    [
        (b"rig.Overview", 40, "schema"),
        (b"rig.Sample", 60, "schema"),
        (b"rig/sample.proto", -3, "schema"),
        (b"rig.Details", 30, "schema"),
        (b"rig/details\x08", 2, "channel"),
        (b"rig/samples", 60, "channel"),
    ],
)
def test_a_damaged_schema_or_channel_is_taken_from_the_end_of_the_file(
    whole: bytes, tmp_path: Path, before: bytes, further: int, kind: str
) -> None:
    (loss,) = saved(tmp_path, whole, whole.index(before) + further)
    assert loss.startswith(f"the {kind} record at byte ")
    assert loss.endswith("damaged; its copy at the file's end was used")


def test_of_damaged_metadata_the_other_keys_are_kept(whole: bytes, tmp_path: Path) -> None:
    (loss,) = saved(tmp_path, whole, whole.index(b'{"type": "CampaignTest"'))
    assert loss == "the metadata 'test': damaged"
    metadata = read_mcap(str(tmp_path / "saved.mcap")).metadata
    assert metadata["units"] == METADATA["units"]
    assert "test" not in metadata


@pytest.mark.parametrize("time", ["null", "1e99", "-1"])
def test_a_beginning_that_is_no_time_is_damaged(tmp_path: Path, whole: bytes, time: str) -> None:
    text = str(METADATA["start_ns"]).encode()
    lost = saved(tmp_path, whole.replace(text, time.ljust(len(text)).encode()))
    assert "the metadata 'start_ns': damaged" in lost


def metadata_start(content: bytes) -> int:
    """Return the offset of the metadata record, which follows the header, the first record."""
    return 8 + 9 + int.from_bytes(content[9:17], "little")


@pytest.mark.parametrize("further", [0, 9, 13], ids=["kind", "length of the name", "name"])
def test_it_is_told_that_all_metadata_are_lost(whole: bytes, tmp_path: Path, further: int) -> None:
    lost = saved(tmp_path, whole, metadata_start(whole) + further)
    assert lost[-1] == "the metadata: its record is damaged or missing"


def test_a_record_of_a_damaged_length_hides_no_chunk(whole: bytes, tmp_path: Path) -> None:
    start = metadata_start(whole)
    first, second = saved(tmp_path, whole, start + 3)
    assert first.startswith(f"bytes {start} to ")
    assert first.endswith(": unreadable")
    assert second == "the metadata: its record is damaged or missing"


def test_a_flip_that_only_the_checksum_of_all_data_shows_is_told(
    whole: bytes, tmp_path: Path
) -> None:
    (loss,) = saved(tmp_path, whole, whole.index(b'"position_m": "m"') + 3)
    assert "something outside the samples and events is damaged" in loss


def test_a_whole_file_has_the_checksum_of_all_its_data(whole: bytes, tmp_path: Path) -> None:
    assert saved(tmp_path, whole) == ()


def test_the_samples_do_without_the_overview_where_the_end_is_missing(
    whole: bytes, tmp_path: Path
) -> None:
    end = whole.rindex(b"rig.Sample") - 60
    lost = saved(tmp_path, whole[:end], whole.index(b"rig.Overview") + 40)
    assert lost[0] == "the overview of what a replay makes again: its schema is damaged"


def test_what_cannot_be_saved_is_called_damaged_and_not_foreign(
    whole: bytes, tmp_path: Path
) -> None:
    end = whole.rindex(b"rig.Sample") - 60
    with pytest.raises(RecordingError, match=r"damaged \(topic rig/samples.*record again") as error:
        saved(tmp_path, whole[:end], whole.index(b"rig.Sample") + 60)
    assert "only recordings written by rig" not in str(error.value)


def test_a_recording_without_its_details_is_refused_by_what_is_missing(
    whole: bytes, tmp_path: Path
) -> None:
    rewrite(whole, tmp_path / "cut.mcap", ["rig/samples"])
    with pytest.raises(RecordingError, match=r"cut\.mcap: file: the topic rig/details is missing"):
        recover(tmp_path / "cut.mcap", tmp_path / "saved.mcap")
