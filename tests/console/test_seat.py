"""One operator at a time; that somebody takes over is asked for, and told to all."""

import pytest

from rig.console.seat import Seat, SeatTaken
from rig.console.visitors import Visitor

ANNA, BEN = Visitor(1, "Anna", 9.9), Visitor(2, "Ben", 9.9)


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def seat(told: list[str]) -> Seat:
    return Seat(told.append, lambda: 5_000_000)


def test_nobody_may_act_before_taking_control(seat: Seat) -> None:
    with pytest.raises(SeatTaken, match="nobody has control"):
        seat.require(ANNA)
    seat.take(ANNA)
    seat.require(ANNA)


def test_who_has_control_keeps_it_until_it_is_taken_over(seat: Seat, told: list[str]) -> None:
    seat.take(ANNA)
    seat.take(ANNA)
    with pytest.raises(SeatTaken, match="Anna has control"):
        seat.take(BEN)
    with pytest.raises(SeatTaken, match="Anna has control"):
        seat.require(BEN)
    seat.take(BEN, over=True)
    with pytest.raises(SeatTaken, match="Ben has control"):
        seat.require(ANNA)
    assert told == ["Anna takes control", "Ben takes over from Anna"]
    assert seat.content() == {"number": 2, "name": "Ben", "since_ms": 5}


def test_control_is_given_up_by_who_has_it_only(seat: Seat, told: list[str]) -> None:
    seat.take(ANNA)
    seat.release(BEN)
    seat.require(ANNA)
    seat.release(ANNA)
    assert seat.content()["number"] is None
    assert told[-1] == "Anna gives control up"
