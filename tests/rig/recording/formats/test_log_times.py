"""A recording whose messages say two times is refused, although all its checksums are right."""

import struct
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rig.recording import McapWriter, RecordingError, read_recording, recover
from rig.recording.formats.division import Division
from rig.recording.formats.log_times import LogTimes
from rig.recording.formats.mcap_stream import McapStream
from tests.rig.recording.rewriting import rewrite

CHANNELS = ["time_s", "command_V", "position_m", "pressure_1_Pa", "pressure_2_Pa", "estimate"]
DIVIDED = Division(tuple(CHANNELS[1:5]), ("time_s",), ("estimate",))
START_NS = 1_800_000_000_000_000_000
LATER_NS = 5_300_000
SAMPLES, EVENTS, DETAILS, OVERVIEW = 1, 2, 3, 4
LOG_TIME, PUBLISH_TIME = 15, 23
"""Offsets of these times in a message's record."""


def written(path: Path, division: Division | None = None) -> Path:
    """Write 2.5 s at 1 kHz, with an event; return the path."""
    rows = np.arange(2500.0)[:, None] * [1e-3, 1e-3, 1e-4, 1e3, 1e3, 1.0]
    with McapWriter(path, CHANNELS, {"start_ns": START_NS}, division) as writer:
        writer.write(rows)
        writer.event(1.234, "note", "something")
    return path


def set_later(
    monkeypatch: pytest.MonkeyPatch, channel: int, fields: tuple[int, ...], number: int = 0
) -> None:
    """Have the writer write later times into one message of a topic in each chunk.

    The checksums are made afterwards, and are right.
    """
    write = McapStream.write_chunk

    def changed(self: McapStream, content: bytes, indexes: Any) -> None:
        data, at, count = bytearray(content), 0, 0
        while at < len(data):
            length, of = struct.unpack_from("<QH", data, at + 1)
            count += of == channel
            if of == channel and count == number + 1:
                for field in fields:
                    (time_ns,) = struct.unpack_from("<Q", data, at + field)
                    struct.pack_into("<Q", data, at + field, time_ns + LATER_NS)
            at += 9 + length
        write(self, bytes(data), indexes)

    monkeypatch.setattr(McapStream, "write_chunk", changed)


@pytest.mark.parametrize("division", [None, DIVIDED], ids=["whole", "divided"])
def test_what_is_written_agrees_also_if_another_program_wrote_it_anew(
    tmp_path: Path, division: Division | None
) -> None:
    path = written(tmp_path / "one.mcap", division)
    assert read_recording(path, required=()).time_s[-1] == 2.499
    if division is None:
        anew = tmp_path / "anew.mcap"
        rewrite(path.read_bytes(), anew)
        assert read_recording(anew, required=()).time_s[-1] == 2.499


BOTH = (LOG_TIME, PUBLISH_TIME)


@pytest.mark.parametrize(
    ("division", "channel", "fields", "number", "reason"),
    [
        (None, SAMPLES, BOTH, 7, "rig/samples says that it is of 0.007 s, and its log time is"),
        (DIVIDED, SAMPLES, BOTH, 7, "rig/samples says that it is of 0.007 s, and its log time is"),
        (None, SAMPLES, (PUBLISH_TIME,), 7, "publish time of a message of rig/samples is 0.0053 s"),
        (None, EVENTS, BOTH, 0, "rig/events says that it is of 1.234 s, and its log time"),
        (DIVIDED, DETAILS, BOTH, 0, "rig/details says that it is of 0 s, and its log time"),
        (DIVIDED, OVERVIEW, BOTH, 3, "rig/overview has a log time, 0.0653 s, at which no"),
    ],
)  # fmt: skip
def test_a_message_that_says_two_times_is_refused_and_recovered_by_its_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, division: Division | None, channel: int,
    fields: tuple[int, ...], number: int, reason: str,
) -> None:  # fmt: skip
    set_later(monkeypatch, channel, fields, number)
    path = written(tmp_path / "two.mcap", division)
    monkeypatch.undo()
    with pytest.raises(RecordingError) as caught:
        read_recording(path, required=())
    (problem,) = caught.value.problems
    assert "its times contradict each other in " in str(problem)
    assert reason in str(problem)
    assert "rig recover" in str(problem)
    summary = recover(path, tmp_path / "whole.mcap")
    assert (summary.samples_kept, summary.events_kept) == (2500, 1)
    # Without all samples it is not known whether the overview has a time at which there is none.
    assert (reason in str(summary)) == (channel != OVERVIEW)
    assert read_recording(tmp_path / "whole.mcap", required=()).time_s[7] == 0.007


def test_a_chunk_that_says_another_time_than_its_messages_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = McapStream.write_chunk

    def changed(self: McapStream, content: bytes, indexes: Any) -> None:
        for entries in indexes.values():
            entries["log_time"] += LATER_NS
        write(self, content, indexes)

    monkeypatch.setattr(McapStream, "write_chunk", changed)
    path = written(tmp_path / "two.mcap")
    with pytest.raises(RecordingError, match="a chunk says that it is of log time"):
        read_recording(path, required=())


def test_a_beginning_in_the_metadata_that_the_log_times_deny_is_refused() -> None:
    times = LogTimes()
    times.start_ns = START_NS
    times.compare("rig/samples", np.array([0.0, 1.0]), np.array([5, 10**9 + 5], np.uint64))
    assert times.wrong == 2
    assert times.first.endswith("its log time is 1.8e+09 s earlier")


def test_times_that_no_file_can_hold_are_left_to_other_checks() -> None:
    times = LogTimes()
    times.compare("rig/samples", np.array([np.nan, np.inf, 1e300]), np.zeros(3, np.uint64))
    assert (times.wrong, times.start_ns) == (0, None)
