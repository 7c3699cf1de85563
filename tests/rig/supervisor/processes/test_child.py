"""A process of the session is heard to its end, whatever fails of what it says."""

import os
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rig.loop.board import Board
from rig.supervisor.processes.child import Child, ChildError, News, NoAnswerError
from tests.rig.supervisor.processes import talking_part

PATIENCE_S = 60.0


@pytest.fixture
def board() -> Iterator[Board]:
    board = Board.create(1)
    yield board
    os.close(board.fd)


def begun(board: Board, folder: Path, hear: Callable[[News], None]) -> Child:
    return Child("part", talking_part.__name__, board, folder / "log", hear)


def test_news_that_nobody_can_take_cost_no_answer(board: Board, tmp_path: Path) -> None:
    heard: list[str] = []

    def fails(news: News) -> None:
        heard.append(news.text)
        raise OSError("the screen is gone \x1b[2J")

    child = begun(board, tmp_path, fails)
    try:
        assert child.ask("something \x1b]0;else\x07", PATIENCE_S) == "something \x1b]0;else\x07"
        assert child.ask("more", PATIENCE_S) == "more"
    finally:
        child.end()
    assert heard == ["first", "second"]
    log = (tmp_path / "log").read_text()
    assert "hearing the part process goes on after a failure: OSError: the screen is gone" in log
    # `cat` may show the log: nothing in it moves a terminal's cursor or gives it a title.
    assert "gone \\u001b[2J" in log
    assert "something \\u001b]0;else\\u0007" in log
    assert "\x1b" not in log


def test_an_answer_that_cannot_be_read_is_an_error_with_its_reason(
    board: Board, tmp_path: Path
) -> None:
    child = begun(board, tmp_path, lambda news: None)
    try:
        with pytest.raises(NoAnswerError, match="part process: did not answer within 0 s"):
            child.answer(0.0)
        with pytest.raises(ChildError, match="sent what cannot be read: LookupError") as unreadable:
            child.ask("strange", PATIENCE_S)
        assert not isinstance(unreadable.value, NoAnswerError)
        assert child.ask("more", PATIENCE_S) == "more"
    finally:
        child.end()


def test_a_process_that_ends_is_known_to_have_ended(board: Board, tmp_path: Path) -> None:
    child = begun(board, tmp_path, lambda news: None)
    child.ask("something", PATIENCE_S)
    child.ask("more", PATIENCE_S)
    child.send("go")
    with pytest.raises(ChildError, match="ended with exit code 0"):
        child.answer(PATIENCE_S)
    until = time.monotonic() + PATIENCE_S
    while child.exit_code is None:
        assert time.monotonic() < until
    child.end()


@pytest.mark.parametrize("late", ["a word", ValueError("late")], ids=["answer", "exception"])
def test_what_comes_late_is_not_taken_for_the_answer_to_the_last_order(
    board: Board, tmp_path: Path, late: object
) -> None:
    child = begun(board, tmp_path, lambda news: None)
    try:
        child.send(late)
        assert child.last_answer(7, int, PATIENCE_S) == 7
    finally:
        child.end()


def test_a_process_that_was_asked_for_nothing_is_not_waited_for(
    board: Board, tmp_path: Path
) -> None:
    child = begun(board, tmp_path, lambda news: None)
    os.kill(child._process.pid, signal.SIGSTOP)  # as busy as one that begins on a busy machine
    before = time.monotonic()
    child.end(grace_s=20.0)
    assert time.monotonic() - before < 10.0
    assert child.exit_code == -signal.SIGKILL
