"""The state machine of CiA 408 servovalves."""

import pytest
from hypothesis import given, strategies as st

from rig.io.can.ds408 import (
    FAULT,
    FULL_SCALE,
    TRANSITIONS,
    WALK,
    DriveState,
    R,
    Transition,
    after_fault,
    after_word,
    keeping_word,
    next_state,
    to_increments,
    to_share,
    words_towards,
)

STATES = st.sampled_from(DriveState)
WORDS = st.integers(0, 0xFFFF)
COMMANDED = [transition for transition in TRANSITIONS if transition.word != FAULT]
FAULTS = [transition for transition in TRANSITIONS if transition.word == FAULT]


def word_of(pattern: str) -> int:
    return int(pattern.replace("x", "0").replace("^", "1"), 2)


@pytest.mark.parametrize("transition", COMMANDED, ids=str)
def test_each_transition_is_made_by_its_control_word(transition: Transition) -> None:
    word = word_of(transition.word)
    assert after_word(transition.source, word, word & ~R) is transition.target


@pytest.mark.parametrize("transition", FAULTS, ids=str)
def test_each_state_falls_to_its_fault_state(transition: Transition) -> None:
    assert after_fault(transition.source) is transition.target
    assert not transition.target.ready


@given(state=STATES, word=WORDS, previous=WORDS)
def test_no_word_makes_a_transition_that_the_table_lacks(
    state: DriveState, word: int, previous: int
) -> None:
    reached = after_word(state, word, previous)
    assert reached is state or (state, reached) in {(t.source, t.target) for t in COMMANDED}


@pytest.mark.parametrize("state", DriveState)
def test_no_word_makes_two_transitions_of_one_state(state: DriveState) -> None:
    for word in range(16):
        for previous in range(16):
            leaving = [t for t in COMMANDED if t.source is state]
            assert sum(t.made_by(word, previous) for t in leaving) <= 1


@given(state=STATES, word=WORDS)
def test_a_fault_is_not_reset_by_a_bit_that_was_set_before(state: DriveState, word: int) -> None:
    if not state.ready:
        assert not after_word(state, word | R, word | R).ready


@given(
    events=st.lists(st.one_of(WORDS, st.sampled_from([0, 1, 3, 7, 8, 9, 11]), st.just(FAULT))),
)
def test_a_valve_is_never_active_without_the_whole_walk(events: list[int | str]) -> None:
    state, previous = DriveState.INIT, 0
    passed = [state]
    for event in events:
        if isinstance(event, str):
            state = after_fault(state)
            assert state is not DriveState.ACTIVE
            assert not state.ready
        else:
            state = after_word(state, event, previous)
            previous = event
        if state is not passed[-1]:
            passed.append(state)
        if state is DriveState.ACTIVE:
            assert passed[-2] is DriveState.HOLD
        if state is DriveState.HOLD:
            before = passed[-2]
            assert before in (DriveState.DISABLED, DriveState.ACTIVE, DriveState.FAULT_HOLD)


@pytest.mark.parametrize("target", WALK)
@pytest.mark.parametrize(
    "state", [state for state in DriveState if state is not DriveState.FAULT_REACTION]
)
def test_the_words_towards_a_target_lead_there_one_state_at_a_time(
    state: DriveState, target: DriveState
) -> None:
    word = keeping_word(state)
    for _ in range(5):
        if state is target:
            break
        expected = next_state(state, target)
        for following in words_towards(state, target):
            state, word = after_word(state, following, word), following
        assert state is expected
    assert state is target


def test_a_fault_reaction_has_to_end_by_itself() -> None:
    assert next_state(DriveState.FAULT_REACTION, DriveState.DISABLED) is DriveState.FAULT_REACTION


@pytest.mark.parametrize("state", DriveState)
def test_a_state_stays_under_its_keeping_word(state: DriveState) -> None:
    assert after_word(state, keeping_word(state), keeping_word(state)) is state


@given(share=st.floats(-1.0, 1.0))
def test_a_setpoint_survives_the_bus_to_half_an_increment(share: float) -> None:
    assert to_share(to_increments(share)) == pytest.approx(share, abs=0.5 / FULL_SCALE)


@pytest.mark.parametrize("share", [1.001, -1.001, float("nan"), float("inf")])
def test_a_setpoint_beyond_full_stroke_is_refused(share: float) -> None:
    with pytest.raises(ValueError, match="not between -1 and 1"):
        to_increments(share)
