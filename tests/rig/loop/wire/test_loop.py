"""The supervisor's side of a test says so if the loop does not do what it was ordered."""

import os
import time
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from control import PLAIN
from estimator.filters.registry import start_memory
from rig.loop.board import Board, Word
from rig.loop.interlocks.ladder import Action, Cause
from rig.loop.interlocks.passings import RungPassed, note_passing
from rig.loop.interlocks.trip import TripError
from rig.loop.wire import loop
from rig.loop.wire.following import skip_order
from rig.loop.wire.layout import Drive, wire_channels
from rig.loop.wire.loop import WireLoop
from rig.loop.wire.orders import Segment
from rig.plant import Model
from tests.waiting import PATIENCE_S

MODEL = Model()
MEMORY = start_memory("product", MODEL)
CHANNELS = wire_channels(MEMORY.filter.states, open_loop=False)
TICKS = 50


class LoopProcess:
    """A loop process that takes every order, and goes on with the segment that it runs."""

    def send(self, order: object) -> None:
        """Take an order, and do nothing about it."""

    def answer(self, timeout_s: float) -> Any:
        return None


@pytest.fixture
def board() -> Iterator[Board]:
    board = Board.create(len(CHANNELS))
    board.ring[0, CHANNELS.index("position_m")] = 0.1
    words = board.words
    words[Word.ROWS], words[Word.SWITCH], words[Word.SEGMENT] = 1, 3, 3
    words[Word.TICK] = TICKS
    words[Word.LOOP_BEAT] = time.monotonic_ns()
    yield board
    os.close(board.fd)


def skipping(board: Board) -> WireLoop:
    test = Segment(0, Drive.TRACK, MEMORY, MODEL.parameters, setpoint=np.zeros(TICKS))
    wire = WireLoop(
        board, LoopProcess(), test, start_position=None, settle_ticks=0, silence_s=PATIENCE_S
    )  # fmt: skip
    wire.ready()
    return wire


def test_a_skip_shortens_the_test_by_what_is_left_out(board: Board) -> None:
    wire = skipping(board)
    words = board.words
    order = skip_order(wire.number, 40, 5)
    words[Word.SKIPPED], words[Word.LEAD] = order, 30
    assert wire.skip_to(40, 5) == 10
    assert words[Word.SKIP] == order
    assert wire.ticks_left == TICKS - 30


def test_a_skip_to_what_was_reached_already_shortens_nothing(board: Board) -> None:
    wire = skipping(board)
    board.words[Word.SKIPPED] = skip_order(wire.number, 40, 5)
    assert wire.skip_to(40, 5) is None
    assert wire.ticks_left == TICKS


def test_a_loop_that_does_not_look_at_an_order_to_skip_is_an_error(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    wire = skipping(board)
    monkeypatch.setattr(loop, "ANSWER_S", 0.05)
    with pytest.raises(TripError, match=r"did not skip to setpoint 40 within 0\.05 s"):
        wire.skip_to(40, 5)


@pytest.mark.parametrize(("place", "blend"), [(1 << 22, 0), (0, 1 << 20), (-1, 0)])
def test_an_order_to_skip_that_does_not_fit_in_its_word_is_refused(place: int, blend: int) -> None:
    with pytest.raises(ValueError, match="cannot skip"):
        skip_order(1, place, blend)


def test_only_passings_of_the_test_are_told(board: Board) -> None:
    wire = skipping(board)
    for segment in (wire.number - 1, wire.number):
        note_passing(board.passing_log, segment, 7, 0, 1.5)
    assert wire.passed() == [RungPassed(wire.number, 7, 0, 1.5)]


@pytest.mark.parametrize("order", [WireLoop.position, WireLoop.safe_state])
def test_a_loop_that_does_not_switch_in_time_is_an_error(
    board: Board, order: Callable[[WireLoop], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "ANSWER_S", 0.05)
    test = Segment(0, Drive.TRACK, MEMORY, MODEL.parameters, setpoint=np.zeros(TICKS))
    wire = WireLoop(
        board, LoopProcess(), test,
        start_position=0.0, settle_ticks=TICKS, silence_s=PATIENCE_S,
    )  # fmt: skip
    why = r"runs segment 3, 0\.05 s after the order to switch to segment 4; end what else loads"
    with pytest.raises(TripError, match=why):
        order(wire)


def wired(board: Board) -> WireLoop:
    test = Segment(0, Drive.TRACK, MEMORY, MODEL.parameters, setpoint=np.zeros(TICKS))
    return WireLoop(
        board, LoopProcess(), test, start_position=0.0, settle_ticks=TICKS, silence_s=PATIENCE_S
    )


def test_a_loop_that_does_not_take_another_control_in_time_is_an_error(
    board: Board, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop, "ANSWER_S", 0.05)
    with pytest.raises(TripError, match=r"not taken another control within 0\.05 s"):
        wired(board).change(80.0, PLAIN)


def test_a_change_of_control_says_from_which_tick_it_holds_and_the_ram_is_held_by_it(
    board: Board,
) -> None:
    wire = wired(board)
    board.words[Word.CHANGED], board.words[Word.CHANGED_AT] = 1, 17
    assert wire.change(80.0, PLAIN) == 17
    assert wire.test.gain == 80.0


def test_a_loop_that_has_stopped_takes_no_other_control(board: Board) -> None:
    wire = wired(board)
    board.words[Word.ACTION], board.words[Word.ACTION_CAUSE] = Action.HOLD, Cause.LIMIT_LOW
    assert wire.change(80.0, PLAIN) is None
    assert wire.test.gain != 80.0
