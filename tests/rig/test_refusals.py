"""What the system refuses once is told as that, with its remedy, and leaves nothing behind."""

import errno
import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from rig.configuration.reading.document import Sources
from rig.loop.board import Board, Word
from rig.loop.interlocks.ladder import Cause
from rig.loop.wire.orders import Closed, Open
from rig.recording.formats.mcap_stream import McapStream
from rig.recording.targets import replacing
from rig.reserves import refusal
from rig.runner.campaign.control_port import ControlPort
from rig.runner.campaign.operator_requests import Desk
from rig.runner.run_folder.directory import DirectoryError, prepare_directory
from rig.runner.run_folder.journal import JOURNAL, is_written
from rig.runner.run_folder.keeping import FolderKeeper
from rig.stream.sender import StreamSender
from rig.stream.settings import StreamSettings
from rig.supervisor import connected_rig
from rig.supervisor.connected_rig import ConnectedRig
from rig.supervisor.processes.child import Child, run_to_end
from rig.supervisor.processes.loop_process import LoopProcess
from rig.supervisor.processes.streaming import Stream
from rig.surviving import start


@pytest.fixture
def no_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Grant no further thread, as the system does when a user has too many."""

    def refuse(*_: object) -> None:
        raise RuntimeError("can't start new thread")

    monkeypatch.setattr(threading, "_start_new_thread", refuse)


def refusing(number: int) -> Any:
    """Return a function that raises an error of the system, with the path that it was given."""

    def refuse(path: object = None, *_: object, **__: object) -> None:
        raise OSError(number, os.strerror(number), str(path))

    return refuse


def opened() -> int:
    return len(os.listdir("/proc/self/fd"))


@pytest.mark.usefixtures("no_threads")
def test_a_thread_that_is_not_granted_is_an_error_of_the_system_with_a_remedy() -> None:
    with pytest.raises(OSError, match="no further thread") as refused:
        start(threading.Thread())
    assert "ulimit -u" in refusal(refused.value)


@pytest.mark.usefixtures("no_threads")
def test_without_a_thread_no_folder_is_kept_and_no_descriptor_stays_open(tmp_path: Path) -> None:
    (tmp_path / JOURNAL).touch()
    keeper = FolderKeeper(tmp_path, lambda: None, lambda folder: None, lambda line: None)
    before = opened()
    with pytest.raises(OSError, match="no further thread"):
        keeper.__enter__()
    assert opened() == before


@pytest.mark.usefixtures("no_threads")
def test_without_a_thread_a_campaign_runs_without_a_control_port(tmp_path: Path) -> None:
    refused: list[str] = []
    with ControlPort(tmp_path, Desk(), refused.append):
        pass
    assert refused == ["there is no control port: the system grants no further thread"]


def test_without_a_socket_a_campaign_runs_without_a_control_port(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    refused: list[str] = []
    monkeypatch.setattr("rig.runner.campaign.control_port.socket.socket", refusing(errno.EMFILE))
    with ControlPort(tmp_path, Desk(), refused.append):
        pass
    assert refused == ["there is no control port: Too many open files"]


@pytest.mark.usefixtures("no_threads")
def test_without_a_thread_a_run_goes_on_without_its_stream(tmp_path: Path) -> None:
    said: list[str] = []
    board = Board.create(1)
    stream = Stream(StreamSettings(), "bench", tmp_path / "log", said.append, lambda command: "")
    stream.attach(board, ("time_s",))
    stream.close()
    os.close(board.fd)
    assert [line.partition(";")[0] for line in said] == [
        "stream: the system grants no further thread"
    ]


@pytest.mark.usefixtures("no_threads")
def test_a_sender_that_gets_no_thread_raises_an_error_of_the_system() -> None:
    with pytest.raises(OSError, match="no further thread"):
        StreamSender(MagicMock(), "bench", 1.0, lambda line: None)


def test_a_sender_whose_stream_gets_no_thread_raises_an_error_of_the_system() -> None:
    session = MagicMock()
    session.declare_queryable.side_effect = RuntimeError("can't start new thread")
    with pytest.raises(OSError, match="no further thread"):
        StreamSender(session, "bench", 1.0, lambda line: None)


@pytest.mark.parametrize("module", ["field", "loop_process", "publisher", "recorder"])
def test_a_part_that_cannot_map_the_board_says_so_in_a_line(
    module: str, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    part = import_module(f"rig.supervisor.processes.{module}")
    monkeypatch.setattr(part, "child_ends", refusing(errno.ENOMEM))
    with pytest.raises(SystemExit) as ended:
        part.main()
    assert ended.value.code == errno.ENOMEM
    assert "memory" in capfd.readouterr().err


@pytest.mark.usefixtures("no_threads")
def test_a_process_that_nobody_can_hear_is_not_left_alive(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    ended: list[str] = []
    process = SimpleNamespace(kill=lambda: ended.append("killed"), wait=lambda: ended.append("-"))
    monkeypatch.setattr("rig.supervisor.processes.child.subprocess.Popen", lambda *_, **__: process)
    board = Board.create(1)
    with pytest.raises(OSError, match="no further thread"):
        Child("part", "none", board, tmp_path / "log", lambda news: None)
    os.close(board.fd)
    assert ended == ["killed", "-"]


def test_a_session_whose_safety_thread_does_not_start_ends_its_parts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    @contextmanager
    def held(*_: object) -> Iterator[None]:
        yield

    def refuse() -> None:
        raise OSError(errno.EAGAIN, "the system grants no further thread")

    from rig.configuration import load_rig
    from rig.plant import Model

    ended: list[str] = []
    parts = [SimpleNamespace(end=lambda name=name: ended.append(name)) for name in "lfr"]
    started = SimpleNamespace(loop=parts[0], field=parts[1], recorder=parts[2])
    monkeypatch.setattr(connected_rig, "held", held)
    monkeypatch.setattr("rig.supervisor.connected_rig.Parts.start", lambda *_: started)
    safety = SimpleNamespace(start=refuse, tripped=False)
    monkeypatch.setattr(connected_rig, "SafetyThread", lambda *_: safety)
    monkeypatch.setattr(ConnectedRig, "_open", lambda self: None)
    stop: Any = SimpleNamespace(requested=False, reason="")
    rig = ConnectedRig(load_rig("emulated"), "product", Model(), tmp_path, stop, lambda line: None)
    memory: Any = SimpleNamespace(filter=SimpleNamespace(states=()))
    monkeypatch.setattr(rig, "_memory", lambda: memory)
    with pytest.raises(OSError, match="no further thread"):
        rig.connect()
    assert ended == ["l", "f", "r"]


@pytest.mark.parametrize(
    ("number", "cause"), [(errno.ENOSPC, Cause.DISK_FULL), (errno.EMFILE, Cause.LOOP_LOST)]
)
def test_a_loop_that_the_system_refuses_something_trips_for_that_and_not_for_the_software(
    monkeypatch: pytest.MonkeyPatch, number: int, cause: Cause
) -> None:
    board, told = Board.create(1), list[object]()
    pipe: Any = SimpleNamespace(send=told.append)
    process = LoopProcess(board, pipe)
    monkeypatch.setattr(process, "_serve", refusing(number))
    with pytest.raises(OSError, match=r"\[Errno"):
        process.run()
    assert Cause(int(board.words[Word.LOOP_TRIP])) is cause
    assert told == [Closed("")]
    os.close(board.fd)


def test_a_part_that_the_system_refuses_something_says_so_in_a_line_and_ends_with_its_number(
    capfd: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as ended:
        run_to_end("loop", lambda: refusing(errno.EMFILE)("/a"))
    assert ended.value.code == errno.EMFILE
    assert capfd.readouterr().err.startswith("loop: /a: too many open files; allow this")


def test_an_error_of_removing_does_not_hide_that_a_file_was_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Path, "unlink", refusing(errno.EIO))
    with replacing(tmp_path / "new") as partial:
        partial.write_text("whole")
    assert (tmp_path / "new").read_text() == "whole"
    with pytest.raises(KeyError), replacing(tmp_path / "other"):
        raise KeyError


def test_a_folder_is_used_although_the_file_that_tried_it_stays_there(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr(Path, "unlink", refusing(errno.EIO))
        prepare_directory(tmp_path / "run", ["one.mcap"])
    prepare_directory(tmp_path / "run", ["one.mcap"])


def test_nothing_is_deleted_where_nobody_knows_whether_a_campaign_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / JOURNAL).touch()
    monkeypatch.setattr("rig.runner.run_folder.journal.os.open", refusing(errno.EMFILE))
    with pytest.raises(OSError, match="Too many open files"):
        is_written(tmp_path)
    with pytest.raises(DirectoryError, match="too many open files"):
        prepare_directory(tmp_path, ["one.mcap"])
    assert (tmp_path / JOURNAL).exists()


def test_a_recording_that_cannot_be_begun_leaves_no_file_open(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(McapStream, "_begin", refusing(errno.ENOSPC))
    before = opened()
    with pytest.raises(OSError, match="No space left"):
        McapStream(tmp_path / "one.mcap", [], [], Any)  # type: ignore[arg-type]
    assert opened() == before


def test_a_file_that_cannot_be_read_now_is_not_blamed_on_its_path(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.configuration.reading.document.read_bounded", refusing(errno.EMFILE))
    sources = Sources()
    assert sources.read_bytes(tmp_path / "rig.yaml") is None
    (problem,) = sources.problems.found
    assert "ulimit -n" in str(problem)


@pytest.mark.usefixtures("no_threads")
def test_a_loop_that_gets_no_thread_makes_its_device_safe(monkeypatch: pytest.MonkeyPatch) -> None:
    done: list[str] = []
    driver = SimpleNamespace(
        open=lambda: done.append("open"),
        safe_state=lambda: done.append("safe"),
        close=lambda: done.append("close"),
        rate_hz=1000.0,
    )
    order: Any = MagicMock()
    order.driver.create_fast.return_value = driver
    monkeypatch.setattr(LoopProcess, "_orders", lambda self: iter([order]))
    monkeypatch.setattr(LoopProcess, "_run_segment", lambda *_: None)
    for name in ("pace", "interlock", "corrections_of"):
        monkeypatch.setattr(f"rig.supervisor.processes.loop_process.{name}", MagicMock())
    order.__class__ = Open
    board = Board.create(1)
    pipe = MagicMock()
    process = LoopProcess(board, pipe)
    monkeypatch.setattr(process, "_memory", MagicMock())
    monkeypatch.setattr(process, "_tend_null", lambda: None)
    monkeypatch.setattr(process, "_ended_by", Cause.OPERATOR_STOP, raising=False)
    process.run()
    os.close(board.fd)
    assert isinstance(pipe.send.call_args_list[0].args[0], OSError)
    assert done == ["open", "safe", "close"]
