"""What goes on after a failure tells of it, once, and does not keep a program from its end."""

import pytest

from rig.surviving import MOST_TOLD, Surviving


def test_a_failure_is_counted_each_time_and_told_once_with_its_place() -> None:
    told: list[str] = []
    survives = Surviving("the reader", told.append)
    for _ in range(3):
        with survives:
            raise OverflowError("cannot convert\nfloat infinity")
    assert survives.count == 3
    assert len(told) == 1
    assert told[0].startswith(
        "the reader goes on after a failure: OverflowError: cannot convert float infinity"
    )
    assert "(test_surviving.py:" in told[0]


def test_failures_without_end_fill_no_log() -> None:
    told: list[str] = []
    survives = Surviving("the reader", told.append)
    for number in range(3 * MOST_TOLD):
        with survives:
            raise ValueError(number)
    assert survives.count == 3 * MOST_TOLD
    assert len(told) == MOST_TOLD


def test_it_goes_on_where_nobody_can_be_told() -> None:
    def full(line: str) -> None:
        raise OSError("no space left")

    survives = Surviving("the reader", full)
    with survives:
        raise ValueError
    assert survives.count == 1


@pytest.mark.parametrize("error", [KeyboardInterrupt, SystemExit])
def test_what_ends_the_program_is_not_held_back(error: type[BaseException]) -> None:
    with pytest.raises(error), Surviving("the reader", print):
        raise error
