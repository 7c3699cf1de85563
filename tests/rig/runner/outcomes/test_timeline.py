"""Times of a test whose segments end early, and of its motion as it is laid out."""

import pytest

from rig.runner.outcomes.timeline import Timeline


def test_without_a_skip_both_times_are_equal() -> None:
    assert Timeline().laid_s(3.0) == Timeline().test_s(3.0) == 3.0


def test_after_a_skip_the_motion_is_ahead() -> None:
    timeline = Timeline()
    timeline.skip(2.0, 10.0)
    timeline.skip(5.0, 20.0)
    assert [timeline.laid_s(each) for each in (1.0, 2.0, 4.0, 5.0, 6.0)] == [1, 10, 12, 20, 21]
    assert [timeline.test_s(each) for each in (1.0, 10.0, 12.0, 20.0, 21.0)] == [1, 2, 4, 5, 6]


@pytest.mark.parametrize(("laid_s", "test_s"), [(2.5, 2.0), (9.9, 2.0), (15.0, 5.0)])
def test_what_was_left_out_is_when_that_was_done(laid_s: float, test_s: float) -> None:
    timeline = Timeline()
    timeline.skip(2.0, 10.0)
    timeline.skip(5.0, 20.0)
    assert timeline.test_s(laid_s) == test_s
