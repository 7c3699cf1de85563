"""Over which stretches of a motion a figure is computed."""

from math import inf

import pytest

from control import Constant, Sequence, Sine, Steps, Stretch
from faults.stretches import has_step, stretches_of

SLOW = Sine(0.3, 0.05, 0.5)
SEGMENTS = Sequence(
    (
        Stretch(SLOW, 5.0, "slow"),
        Stretch(Steps((0.3, 0.2), 2.0), 4.0, "steps", blend_s=1.0),
        Stretch(SLOW, 4.0, "slow", blend_s=2.0),
    )
)


def test_a_part_of_a_cycle_is_no_cycle() -> None:
    assert stretches_of(SLOW, 5.0, "", "cycle") == ((0.0, 2.0), (2.0, 4.0))
    assert stretches_of(SLOW, 1.9, "", "cycle") == ()
    assert stretches_of(Constant(0.3), 5.0, "", "cycle") == ()


@pytest.mark.parametrize("frequency", [0.3, 0.7, 1.1, 3.0])
@pytest.mark.parametrize("cycles", [1, 4, 13])
def test_cycles_whose_duration_is_rounded_to_ticks_are_all_there(
    frequency: float, cycles: int
) -> None:
    duration_s = round(cycles / frequency, 3)
    found = stretches_of(Sine(0.3, 0.05, frequency), duration_s, "", "cycle")
    assert len(found) == cycles
    assert found[-1][1] == pytest.approx(duration_s, abs=1e-3)


def test_segments_and_their_cycles_begin_after_the_blend() -> None:
    assert stretches_of(SEGMENTS, 16.0, "", "segment") == ((0.0, 5.0), (6.0, 10.0), (12.0, 16.0))
    assert stretches_of(SEGMENTS, 16.0, "slow", "segment") == ((0.0, 5.0), (12.0, 16.0))
    cycles = ((0.0, 2.0), (2.0, 4.0), (12.0, 14.0), (14.0, 16.0))
    assert stretches_of(SEGMENTS, 16.0, "", "cycle") == cycles
    assert stretches_of(SEGMENTS, 16.0, "steps", "cycle") == ()


def test_a_test_is_one_stretch_and_has_segments_only_if_they_are_written() -> None:
    assert stretches_of(SEGMENTS, 16.0, "", "test") == ((0.0, inf),)
    assert stretches_of(SLOW, 5.0, "", "segment") == ()


def test_steps_are_jumps_within_a_segment() -> None:
    assert stretches_of(SEGMENTS, 16.0, "steps", "step") == ((6.0, 10.0),)
    assert has_step(SEGMENTS, 16.0, "")
    assert has_step(SEGMENTS, 16.0, "steps")
    assert not has_step(SEGMENTS, 16.0, "slow")
    assert not has_step(Steps((0.3, 0.3), 2.0), 5.0, "")
