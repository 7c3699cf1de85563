"""Setpoints are replaced ahead of the loop in time, or not at all."""

import numpy as np
import pytest

from rig.loop.board import Word
from rig.loop.wire.ahead import FILLED_TICKS, LEAST_AHEAD_TICKS, SetAhead, set_ahead

TICKS = 50_000


def taken(order: SetAhead, *, tick: int = 100, segment: int = 3, switch: int = 3) -> np.ndarray:
    """Return the setpoints after an order to a segment that rests at 0.1 m; (0,) if not taken."""
    words = np.zeros(64, np.int64)
    words[Word.SEGMENT], words[Word.SWITCH], words[Word.TICK] = segment, switch, tick
    setpoint, feedforward = np.full(TICKS, 0.1), np.full(TICKS, 9.0)
    if not set_ahead(order, setpoint, feedforward, words):
        assert np.all(setpoint == 0.1)
        return np.empty(0)
    end = order.first + order.values.size
    assert np.array_equal(feedforward[order.first : end], order.feedforward)
    assert np.all(feedforward[end : end + FILLED_TICKS] == 0.0)
    return setpoint


def order(first: int = 200, segment: int = 3, *, ends: bool = True) -> SetAhead:
    return SetAhead(segment, first, np.array([0.1, 0.11, 0.12]), np.ones(3), ends)


def test_what_is_laid_out_ends_at_rest_to_the_end_of_the_segment() -> None:
    setpoint = taken(order())
    assert np.array_equal(setpoint[199:203], [0.1, 0.1, 0.11, 0.12])
    assert np.all(setpoint[203:] == 0.12)


def test_a_motion_that_is_to_go_on_rests_for_longer_than_a_dead_supervisor_lives() -> None:
    setpoint = taken(order(ends=False))
    assert np.all(setpoint[203 : 203 + FILLED_TICKS] == 0.12)


@pytest.mark.parametrize(
    ("late", "why"),
    [
        (order(first=100 + LEAST_AHEAD_TICKS - 1), "the loop is too near"),
        (order(segment=2), "another segment runs"),
        (order(first=TICKS - 2), "it goes beyond the segment"),
    ],
)
def test_an_order_that_comes_too_late_changes_nothing(late: SetAhead, why: str) -> None:
    assert not taken(late).size, why


def test_an_order_is_not_taken_while_the_loop_is_to_switch() -> None:
    assert not taken(order(), switch=4).size
