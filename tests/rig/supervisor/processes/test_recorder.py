"""The recorder: every row of its segment is on disk, whatever becomes of the others."""

import errno
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from rig.loop.board import RING_ROWS, Board, RingReader, Word
from rig.loop.interlocks.ladder import Cause
from rig.recording import read_recording, recover
from rig.supervisor.processes.child import Child, ChildError
from rig.supervisor.processes.recorder import (
    NICENESS,
    BeginRecording,
    FinishRecording,
    NoteInRecording,
)
from tests.waiting import PATIENCE_S, until

CHANNELS = ("time_s", "setpoint_V", "segment")


@dataclass
class Session:
    """A recorder process with its board and the supervisor's end of its pipe."""

    board: Board
    child: Child
    folder: Path

    def write(self, segment: int, first: int, count: int) -> None:
        """Be the loop: write rows of a segment to the ring."""
        for tick in range(first, first + count):
            at = int(self.board.words[Word.ROWS])
            self.board.ring[at % RING_ROWS] = (tick * 1e-3, 1e-3 * tick, segment)
            self.board.words[Word.ROWS] = at + 1

    def begin(self, segment: int = 1, name: str = "test.mcap") -> Path:
        path = self.folder / name
        self.child.send(BeginRecording(segment, path, CHANNELS, {"test": {"name": name}}, 10**18))
        assert self.child.answer(PATIENCE_S) == segment
        return path

    def until_recorded(self, rows: int) -> None:
        until(lambda: self.board.words[Word.RECORDED] >= rows, "the rows to be recorded")


@pytest.fixture
def session(tmp_path: Path) -> Iterator[Session]:
    board = Board.create(len(CHANNELS))
    child = Child("recorder", "rig.supervisor.processes.recorder", board, tmp_path / "log", print)
    yield Session(board, child, tmp_path)
    child.end()
    os.close(board.fd)
    assert (tmp_path / "log").read_text() == ""


def test_the_file_holds_the_rows_of_its_segment_and_the_events(session: Session) -> None:
    session.write(0, 0, 500)
    path = session.begin()
    session.child.send(NoteInRecording(0.0, "test_begin", "here"))
    session.write(1, 0, 1500)
    session.write(2, 0, 100)
    session.child.send(FinishRecording(1500))
    assert session.child.answer(PATIENCE_S) == 1500
    recording = read_recording(path, required=("time_s",))
    np.testing.assert_array_equal(recording.time_s, np.arange(1500) * 1e-3)
    assert [event.kind for event in recording.events] == ["test_begin"]


def test_one_file_follows_the_other(session: Session) -> None:
    for segment in (1, 2):
        path = session.begin(segment, f"{segment}.mcap")
        session.write(segment, 0, 1100)
        session.child.send(FinishRecording(1100))
        assert session.child.answer(PATIENCE_S) == 1100
        assert read_recording(path, required=("time_s",)).time_s.size == 1100


def test_without_a_supervisor_the_file_is_completed_and_tells_why_the_others_tripped(
    session: Session,
) -> None:
    path = session.begin()
    session.write(1, 0, 1700)
    session.board.words[Word.FIELD_TRIP_AT], session.board.words[Word.FIELD_TRIP] = (
        2,
        Cause.FIELD_LOST,
    )
    session.board.words[Word.LOOP_TRIP_AT], session.board.words[Word.LOOP_TRIP] = (
        1,
        Cause.SUPERVISOR_LOST,
    )
    session.child.end()
    assert session.child.ended == "ended with exit code 0"
    recording = read_recording(path, required=("time_s",))
    assert recording.time_s.size == 1700
    (event,) = recording.events
    told = "SUPERVISOR_LOST: the supervisor gives no sign of life"
    assert (event.time_s, event.kind, event.text) == (1.699, "trip", told)


def test_after_a_kill_every_flushed_second_is_readable(session: Session) -> None:
    path = session.begin()
    session.write(1, 0, 1200)
    session.until_recorded(1200)
    os.kill(session.child._process.pid, signal.SIGKILL)
    with pytest.raises(ChildError, match="recorder process: killed by SIGKILL"):
        session.child.answer(PATIENCE_S)
    recover(path, session.folder / "saved.mcap")
    assert read_recording(session.folder / "saved.mcap", required=("time_s",)).time_s.size == 1200


def test_it_has_precedence_over_ordinary_programs_where_the_system_grants_it(
    session: Session,
) -> None:
    session.begin()
    asked = [sys.executable, "-c", f"import os; os.nice({NICENESS})"]
    granted = subprocess.run(asked, stderr=subprocess.DEVNULL, check=False).returncode == 0
    gained = os.getpriority(os.PRIO_PROCESS, session.child._process.pid) - os.nice(0)
    assert gained == (NICENESS if granted else 0)


def test_a_file_that_cannot_grow_is_reported_by_the_exit_code_though_the_log_cannot_either(
    session: Session,
) -> None:
    session.begin()
    resource.prlimit(session.child._process.pid, resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))
    session.write(1, 0, 1200)
    with pytest.raises(ChildError, match=f"ended with exit code {errno.EFBIG}"):
        session.child.answer(PATIENCE_S)


def test_a_reader_that_falls_behind_counts_what_it_lost() -> None:
    board = Board.create(2)
    reader = RingReader(board)
    board.ring[:, 0] = np.arange(RING_ROWS)
    board.words[Word.ROWS] = RING_ROWS + 1000
    rows = reader.take()
    assert reader.lost + len(rows) == RING_ROWS + 1000
    assert reader.lost >= 1000
    os.close(board.fd)


def test_a_reader_gets_every_row_once_and_in_order_across_the_ring_s_end() -> None:
    board = Board.create(1)
    reader = RingReader(board)
    taken = []
    written = 0
    for count in (RING_ROWS - 500, 700, 1):
        at = np.arange(written, written + count)
        board.ring[at % RING_ROWS, 0] = at
        written += count
        board.words[Word.ROWS] = written
        taken.append(reader.take()[:, 0])
    np.testing.assert_array_equal(np.concatenate(taken), np.arange(written))
    os.close(board.fd)
