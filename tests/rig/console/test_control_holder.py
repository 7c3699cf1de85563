"""One operator at a time; that somebody takes over is asked for, and shown to all."""

import pytest

from rig.console.visitors import ControlHolder, NotInControl, Visitor

ANNA, BEN = Visitor(1, "Anna", 9.9), Visitor(2, "Ben", 9.9)


@pytest.fixture
def told() -> list[str]:
    return []


@pytest.fixture
def control(told: list[str]) -> ControlHolder:
    return ControlHolder(told.append, lambda: 5_000_000)


def test_nobody_may_act_before_taking_control(control: ControlHolder) -> None:
    with pytest.raises(NotInControl, match="nobody has control"):
        control.require(ANNA)
    control.take(ANNA)
    control.require(ANNA)


def test_who_has_control_keeps_it_until_it_is_taken_over(
    control: ControlHolder, told: list[str]
) -> None:
    control.take(ANNA)
    control.take(ANNA)
    with pytest.raises(NotInControl, match="Anna has control"):
        control.take(BEN)
    with pytest.raises(NotInControl, match="Anna has control"):
        control.require(BEN)
    control.take(BEN, over=True)
    with pytest.raises(NotInControl, match="Ben has control"):
        control.require(ANNA)
    assert told == ["Anna takes control", "Ben takes over from Anna"]
    assert control.content() == {"number": 2, "name": "Ben", "since_ms": 5}


def test_control_is_given_up_by_who_has_it_only(control: ControlHolder, told: list[str]) -> None:
    control.take(ANNA)
    control.release(BEN)
    control.require(ANNA)
    control.release(ANNA)
    assert control.content()["number"] is None
    assert told[-1] == "Anna gives control up"
