"""A divided recording takes little of the disk, loses nothing, and opens in other programs."""

import json
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import Message
from mcap.writer import CompressionType, Writer
from numpy.typing import NDArray

from rig.recording import McapWriter, RecordingError, division_of, read_recording, recover
from rig.recording.formats import division, sample_collector
from rig.recording.formats.joining import Halves, NumberedRows
from rig.recording.formats.sample_layout import details_message, details_of
from rig.recording.recording import content_hash

START_NS = 1_790_000_000_000_000_000
N = 2000
CHANNELS = (
    "time_s", "setpoint_m", "command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa",
    "innovation_position_m", "filter_resets", "est_position_m", "est_load_N",
    "verdict_code", "wakeup_s", "tick", "valve_enabled",
)  # fmt: skip
SIGNALS = CHANNELS[1:6]
REPLAYED = CHANNELS[6:10]
DETAILS = ("time_s", *CHANNELS[10:])


@pytest.fixture(scope="module")
def rows() -> NDArray[np.float64]:
    """Rows as a loop writes them: with noise, counters, and readings that are missing."""
    rng = np.random.default_rng(2)
    ticks = np.arange(N)
    rows = np.column_stack([
        ticks * 1e-3, *rng.standard_normal((9, N)), np.full(N, np.nan),
        rng.integers(20_000, 40_000, N) * 1e-9, ticks, np.ones(N),
    ])  # fmt: skip
    rows[:, 1:6] += (0.3, 0.0, 0.3, 7e6, 7e6)
    rows[700:, CHANNELS.index("verdict_code")] = 0.0
    return rows


def kept(rows: NDArray[np.float64]) -> dict[str, NDArray[np.float64]]:
    """Return the channels of rows that a divided recording keeps in every sample."""
    whole = dict(zip(CHANNELS, map(np.ascontiguousarray, rows.T), strict=True))
    return {name: values for name, values in whole.items() if name not in REPLAYED}


@pytest.fixture(scope="module")
def path(rows: NDArray[np.float64], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A recording as the recorder makes it: 20 rows at a time, flushed each half second."""
    path = tmp_path_factory.mktemp("divided") / "run.mcap"
    with McapWriter(path, CHANNELS, {"start_ns": START_NS}, division_of(CHANNELS)) as writer:
        writer.event(0.1, "note", "begun")
        for first in range(0, N, 20):
            writer.write(rows[first : first + 20])
            if first % 500 == 480:
                writer.flush()
    return path


def messages(path: Path, topic: str) -> list[Message]:
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        return [message for _, _, message in reader.iter_messages(topic)]


def test_the_filter_s_signals_the_details_and_what_a_replay_makes_are_told_apart() -> None:
    divided = division_of(CHANNELS)
    assert (divided.signals, divided.details, divided.replayed) == (SIGNALS, DETAILS, REPLAYED)


def test_all_but_what_a_replay_makes_reads_back_bit_for_bit(
    path: Path, rows: NDArray[np.float64]
) -> None:
    recording = read_recording(path)
    assert recording.replayed == REPLAYED
    assert recording.content_hash() == content_hash(kept(rows))
    assert next(iter(recording.channels)) == "time_s"
    assert [event.text for event in recording.events] == ["begun"]


def test_another_program_finds_a_message_a_sample_and_an_overview_at_50_hz(
    path: Path, rows: NDArray[np.float64]
) -> None:
    samples = messages(path, "rig/samples")
    assert [sample.log_time - START_NS for sample in samples] == list(range(0, 2 * 10**9, 10**6))
    tagged = np.dtype([("tag", "u1"), ("value", "<f8")])
    values = np.frombuffer(b"".join(sample.data for sample in samples), tagged)["value"]
    np.testing.assert_array_equal(values.reshape(N, -1), rows[:, 1:6])

    overview = messages(path, "rig/overview")
    times = [message.log_time - START_NS for message in overview]
    assert times == list(range(0, 2 * 10**9, 20 * 10**6))
    single = np.dtype([("tag", "u1"), ("value", "<f4")])
    shown = np.frombuffer(b"".join(message.data for message in overview), single)["value"]
    places = [CHANNELS.index(name) for name in (*REPLAYED, *DETAILS[1:])]
    np.testing.assert_array_equal(shown.reshape(N // 20, -1), rows[::20, places].astype("<f4"))


def test_the_schemas_tell_names_and_types_of_the_fields(path: Path) -> None:
    with path.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    schemas = {schema.name: schema for schema in summary.schemas.values()}
    assert set(schemas) == {"rig.Sample", "rig.Event", "rig.Details", "rig.Overview"}
    assert all(name.encode() in schemas["rig.Overview"].data for name in REPLAYED)
    topics = {channel.topic: channel for channel in summary.channels.values()}
    assert json.loads(topics["rig/details"].metadata["channels"]) == list(DETAILS)
    assert json.loads(topics["rig/overview"].metadata["units"])["est_load_N"] == "N"


def test_a_divided_recording_takes_half_of_the_disk(
    path: Path, rows: NDArray[np.float64], tmp_path: Path
) -> None:
    with McapWriter(tmp_path / "whole.mcap", CHANNELS) as writer:
        writer.write(rows)
    assert path.stat().st_size < 0.6 * (tmp_path / "whole.mcap").stat().st_size


def test_of_a_divided_file_that_was_cut_all_whole_chunks_are_recovered(
    path: Path, rows: NDArray[np.float64], tmp_path: Path
) -> None:
    (tmp_path / "cut.mcap").write_bytes(path.read_bytes()[: int(0.7 * path.stat().st_size)])
    summary = recover(tmp_path / "cut.mcap", tmp_path / "saved.mcap")
    assert summary.samples_kept == 1500
    saved = read_recording(tmp_path / "saved.mcap")
    assert saved.content_hash() == content_hash(kept(rows[:1500]))
    assert saved.replayed == REPLAYED
    shown, original = (
        [message.data for message in messages(each, "rig/overview")]
        for each in (tmp_path / "saved.mcap", path)
    )
    assert shown == original[:75]


def test_a_file_whose_chunks_another_program_cut_elsewhere_reads_the_same(
    path: Path, tmp_path: Path
) -> None:
    with path.open("rb") as file:
        reader = make_reader(file)
        records = list(reader.iter_metadata())
        found = list(reader.iter_messages())
    with (tmp_path / "again.mcap").open("wb") as file:
        writer = Writer(file, chunk_size=9000, compression=CompressionType.ZSTD)
        writer.start(library="another program")
        writer.add_metadata("rig", records[0].metadata)
        ids = {}
        for schema, channel, message in found:
            assert schema is not None
            if channel.topic not in ids:
                number = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.topic] = writer.register_channel(
                    channel.topic, channel.message_encoding, number, channel.metadata
                )
            times = message.log_time, message.publish_time
            writer.add_message(
                ids[channel.topic], times[0], message.data, times[1], message.sequence
            )
        writer.finish()
    again = read_recording(tmp_path / "again.mcap")
    assert again.content_hash() == read_recording(path).content_hash()


def test_samples_without_their_details_are_told(
    rows: NDArray[np.float64], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def later(first: int, count: int, columns: bytes) -> bytes:
        return details_message(first + 10, count, columns)

    monkeypatch.setattr("rig.recording.formats.divided_rows.details_message", later)
    damaged = tmp_path / "damaged.mcap"
    with McapWriter(damaged, CHANNELS, None, division_of(CHANNELS)) as writer:
        writer.write(rows[:1000])
    with pytest.raises(RecordingError, match="the details of 10 samples are missing"):
        read_recording(damaged)
    summary = recover(damaged, tmp_path / "saved.mcap")
    assert summary.samples_kept == 990
    missing, contradicted = summary.lost
    assert missing == "10 samples, as their details are missing"
    # The details were moved by ten rows, whose times are in them.
    assert "the log times of 990 messages or chunks contradicted" in contradicted


def test_details_that_say_they_are_endless_are_refused_unread(
    rows: NDArray[np.float64], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sample_collector, "most_bytes", lambda: 10**8)
    monkeypatch.setattr(
        "rig.recording.formats.divided_rows.details_message",
        lambda first, count, columns: details_message(first, 2**32 - 1, columns),
    )
    bomb = tmp_path / "bomb.mcap"
    with McapWriter(bomb, CHANNELS, None, division_of(CHANNELS)) as writer:
        writer.write(rows[:1000])
    with pytest.raises(RecordingError, match="too large: its samples take"):
        read_recording(bomb)


def test_a_chunk_that_could_not_be_written_is_written_whole_the_next_time(
    rows: NDArray[np.float64], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "run.mcap"
    with McapWriter(path, CHANNELS, None, division_of(CHANNELS)) as writer:
        writer.write(rows[:1990])
        with monkeypatch.context() as full:
            full.setattr(writer._stream, "write_chunk", refused)
            with pytest.raises(OSError, match="no space"):
                writer.flush()
    assert read_recording(path).content_hash() == content_hash(kept(rows[:1990]))
    assert len(messages(path, "rig/overview")) == 100


def refused(*_: object) -> None:
    raise OSError("no space")


def test_halves_are_joined_by_their_numbers_however_they_come() -> None:
    def numbered(first: int, end: int) -> NumberedRows:
        return NumberedRows(first, np.arange(first, end, dtype=np.float64)[:, None])

    for bounds in ((0, 3, 4, 10), (0, 5, 10), (0, 10)):
        halves = Halves()
        blocks = []
        for first, end in pairwise((0, 4, 6, 10)):
            blocks += halves.joined(signals=numbered(first, end))
        for first, end in pairwise(bounds):
            blocks += halves.joined(details=numbered(first, end))
        joined = np.concatenate([block.rows for block in blocks])
        np.testing.assert_array_equal(joined, np.repeat(np.arange(10.0)[:, None], 2, axis=1))
        assert halves.unmatched == 0


def test_a_message_of_details_says_what_it_was_made_of() -> None:
    for length in (0, 127, 128, 40_000):
        assert details_of(details_message(7, 500, b"x" * length)) == (7, 500, b"x" * length)
    with pytest.raises(ValueError, match="not laid out as rig"):
        details_of(details_message(7, 500, b"xyz")[:-1])
    with pytest.raises(ValueError, match="not laid out as rig"):
        details_of(details_message(7, 500, b"")[:-1] + b"\xff" * 10**6)


def test_an_overview_row_comes_every_20_ms_whatever_the_rows_are_apart(tmp_path: Path) -> None:
    assert division.OVERVIEW_PERIOD_S == 0.02
    rows = np.zeros((200, len(CHANNELS)))
    rows[:, 0] = np.arange(200) * 5e-3
    path = tmp_path / "slow.mcap"
    with McapWriter(path, CHANNELS, None, division_of(CHANNELS)) as writer:
        writer.write(rows)
    assert [each.log_time for each in messages(path, "rig/overview")] == list(
        range(0, 10**9, 20 * 10**6)
    )
