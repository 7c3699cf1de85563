"""A law that takes over from another goes on from its command, and soon is on its own."""

from typing import Final

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from control.changing import (
    FADE_S,
    ChangeMemory,
    Moment,
    Steered,
    change_memory,
    changeable,
    forget_changes,
    offset_of_change,
)
from control.position_loop import COMMAND_LIMIT, proportional_command
from control.tracking import (
    PLAIN,
    PROPORTIONAL,
    TONE_NUMBERS,
    ControlLaw,
    ControlMemory,
    control_memory,
    tracking_command,
)
from rig.plant.integrator import TICK

NONE: Final = np.empty((0, TONE_NUMBERS))
FREE: Final = changeable(PLAIN).law
TONES: Final = np.array([[3.0, 1e-3, 2e-4, 0.01], [6.0, 1e-3, 2e-4, 0.01]])
LEAST_V: Final = 1e-9

laws = st.builds(
    ControlLaw,
    st.just(False),
    st.floats(-2.0, 2.0),
    st.floats(0.0, 2.0),
    st.floats(1e-3, 5.0),
    st.sampled_from([0.0, 20.0, 500.0]),
    st.floats(0.0, 10.0),
    st.floats(0.0, 1e-3),
    st.floats(0.0, 30.0),
)
steered = st.builds(
    Steered, st.floats(1.0, 500.0), laws, st.floats(-10.0, 10.0), st.sampled_from([NONE, TONES])
)
moments = st.builds(
    Moment,
    st.floats(0.1, 0.5),
    st.floats(0.1, 0.5),
    st.floats(0.0, 100.0),
    st.just(COMMAND_LIMIT),
    st.just(TICK),
)


def learnt(integral: float = 0.0, cosine: float = 0.0) -> ControlMemory:
    memory = control_memory()
    memory.kept[:] = integral, 0.3, 0.0
    memory.learnt[:2, 0] = cosine
    return memory


def command(at: Moment, law: Steered, memory: ControlMemory, offset: float = 0.0) -> float:
    return float(
        tracking_command(
            at.setpoint, at.position, law.ahead + offset, at.setpoint, at.time_s, law.gain,
            at.limit, at.period, law.law, law.tones, memory,
        )
    )  # fmt: skip


def offset(
    at: Moment, before: Steered, after: Steered, memory: ControlMemory, change: ChangeMemory
) -> float:
    return float(offset_of_change(at, before, after, memory, change))


@settings(max_examples=100)
@given(moments, steered, steered, st.floats(-5.0, 5.0), st.floats(-0.01, 0.01))
def test_at_the_tick_of_a_change_the_command_is_that_of_the_old_law(
    at: Moment, before: Steered, after: Steered, integral: float, cosine: float
) -> None:
    expected = command(at, before, learnt(integral, cosine))
    memory, change = learnt(integral, cosine), change_memory()
    change.state[0] = 1.0
    added = offset(at, before, after, memory, change)
    assert command(at, after, memory, added) == pytest.approx(expected, abs=LEAST_V)


@given(moments, steered)
def test_a_law_that_takes_over_from_the_thesis_s_does_too(at: Moment, after: Steered) -> None:
    before = Steered(50.0, PROPORTIONAL, 0.0, NONE)
    expected = proportional_command(at.setpoint, at.position, 50.0, COMMAND_LIMIT)
    memory, change = control_memory(), change_memory()
    change.state[0] = 1.0
    added = offset(at, before, after, memory, change)
    assert command(at, after, memory, added) == pytest.approx(expected, abs=LEAST_V)


@given(moments)
def test_the_thesis_s_law_that_can_take_over_is_the_same_bit_for_bit(at: Moment) -> None:
    after = Steered(50.0, FREE, 0.0, NONE)
    expected = proportional_command(at.setpoint, at.position, 50.0, COMMAND_LIMIT)
    assert command(at, after, control_memory()) == expected


AT: Final = Moment(0.31, 0.3, 1.0, COMMAND_LIMIT, TICK)
INTEGRATING: Final = ControlLaw(False, 0.1, 0.0, 1e-3, 50.0, 2.0, 5e-4, 3.0)


def taken_over(before: Steered, after: Steered, memory: ControlMemory) -> ChangeMemory:
    change = change_memory()
    change.state[0] = 1.0
    offset(AT, before, after, memory, change)
    return change


def test_the_offset_fades_with_its_time_constant_and_ends_at_nothing() -> None:
    before, after = Steered(50.0, FREE, 0.0, NONE), Steered(80.0, FREE, 0.0, NONE)
    memory, change = control_memory(), change_memory()
    change.state[0] = 1.0
    found = [offset(AT, before, after, memory, change) for _ in range(round(10.0 * FADE_S / TICK))]
    assert found[0] == pytest.approx(-0.3)
    assert found[round(FADE_S / TICK)] == pytest.approx(-0.3 * np.exp(-1.0), rel=0.01)
    for _ in range(round(10.0 * FADE_S / TICK)):
        offset(AT, before, after, memory, change)
    assert change.state.tolist() == [0.0, 0.0]


def test_a_change_during_another_s_fading_starts_from_the_command_there_is() -> None:
    first, second = Steered(50.0, FREE, 0.0, NONE), Steered(80.0, FREE, 0.0, NONE)
    memory, change = control_memory(), change_memory()
    change.state[0] = 1.0
    for _ in range(100):
        offset(AT, first, second, memory, change)
    expected = command(AT, second, control_memory(), float(change.state[1]))
    change.state[0] = 1.0
    third = Steered(20.0, FREE, 0.0, NONE)
    added = offset(AT, second, third, memory, change)
    assert command(AT, third, memory, added) == pytest.approx(expected, abs=LEAST_V)


def test_an_integral_keeps_what_it_has_learnt() -> None:
    memory = learnt(integral=0.7)
    before, after = Steered(50.0, INTEGRATING, 0.0, NONE), Steered(80.0, INTEGRATING, 0.0, NONE)
    taken_over(before, after, memory)
    assert memory.kept[0] == 0.7


def test_what_a_null_is_changed_by_is_taken_from_the_integral_and_needs_no_offset() -> None:
    memory = learnt(integral=0.7)
    before = Steered(50.0, INTEGRATING, 0.0, NONE)
    change = taken_over(before, before._replace(law=INTEGRATING._replace(null_V=0.6)), memory)
    assert memory.kept[0] == pytest.approx(0.2)
    assert abs(change.state[1]) < LEAST_V


def test_an_integral_that_is_taken_away_becomes_an_offset_that_fades() -> None:
    memory = learnt(integral=0.7)
    without = INTEGRATING._replace(integral_rate=0.0)
    before, after = Steered(50.0, INTEGRATING, 0.0, NONE), Steered(50.0, without, 0.0, NONE)
    change = taken_over(before, after, memory)
    assert memory.kept[0] == 0.0
    assert change.state[1] == pytest.approx(0.7, rel=0.01)


def test_corrections_stay_with_their_frequency_within_the_new_limit() -> None:
    memory = learnt()
    memory.learnt[0], memory.learnt[1] = (3e-3, 4e-3), (6e-3, 8e-3)
    law = Steered(50.0, FREE, 0.0, TONES)
    fewer = np.array([[6.0, 2e-3, 1e-4, 0.005], [9.0, 2e-3, 1e-4, 0.005]])
    taken_over(law, law._replace(tones=fewer), memory)
    assert memory.learnt[0] == pytest.approx([3e-3, 4e-3])
    assert not memory.learnt[1:].any()


def test_laws_that_are_both_at_the_same_limit_need_no_offset() -> None:
    far = AT._replace(position=0.9)
    memory, change = control_memory(), change_memory()
    change.state[0] = 1.0
    before, after = Steered(50.0, FREE, 0.0, NONE), Steered(80.0, FREE, 0.0, NONE)
    assert offset(far, before, after, memory, change) == 0.0


def test_a_ram_of_unknown_position_is_not_driven_by_what_is_left_of_a_change() -> None:
    lost = AT._replace(position=np.nan)
    memory, change = control_memory(), change_memory()
    change.state[:] = 1.0, 2.0
    before, after = Steered(50.0, FREE, 0.0, NONE), Steered(80.0, FREE, 0.0, NONE)
    added = offset(lost, before, after, memory, change)
    assert command(lost, after, memory, added) == 0.0


def test_a_motion_that_begins_knows_nothing_of_changes() -> None:
    change = change_memory()
    change.state[:] = 1.0, 2.0
    forget_changes(change)
    assert not change.state.any()
