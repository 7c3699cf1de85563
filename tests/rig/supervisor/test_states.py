from contextlib import suppress
from dataclasses import replace
from itertools import product
from typing import Any

import pytest
from hypothesis import given, strategies as st

from rig.supervisor.states import (
    TRANSITIONS,
    VALVE_ENABLED,
    Conditions,
    Event,
    Guard,
    IllegalTransition,
    State,
    Transition,
    next_state,
)

GOOD = Conditions(estop_closed=True, valve_enabled=True, homed=True)
FAILING: dict[str, dict[str, Any]] = {
    "emergency stop closed": {"estop_closed": False},
    "valve enabled": {"valve_enabled": False},
    "homed": {"homed": False},
    "not homed": {"homed": True},
    "nothing stands against motion": {"standing": "pressure_1_Pa is above its limit"},
    "trip confirmed": {"unconfirmed": "bypass shut"},
}
KNOWN = {(row.state, row.event) for row in TRANSITIONS}


TABLE = """
off: connect -> connecting
connecting: connected -> disarmed
connecting: connection failed -> off
disarmed: arm -> arming, emergency stop closed, nothing stands against motion
disarmed: disconnect -> off
arming: reset pressed -> armed, emergency stop closed, valve enabled, homed
arming: reset pressed -> not homed, emergency stop closed, valve enabled, not homed
arming: disarm -> disarmed
not homed: home -> homing, nothing stands against motion
not homed: disarm -> disarmed
homing: homed -> armed, homed
homing: homing failed -> not homed
homing: hold -> not homed
armed: home -> homing, nothing stands against motion
armed: count lost -> not homed
armed: position -> positioning, homed, nothing stands against motion
armed: run -> running, homed, nothing stands against motion
armed: hold -> holding
armed: disarm -> disarmed
positioning: positioned -> armed
positioning: hold -> holding
running: done -> armed
running: hold -> holding
holding: release -> armed, homed, nothing stands against motion
holding: count lost -> not homed
holding: disarm -> disarmed
ramping down: at rest -> disarmed
tripped: acknowledge -> disarmed, emergency stop closed, trip confirmed
tripped: disconnect -> off
"""
"""All transitions but ramping down and trip, which most states have, as somebody read them off the
safety concept: a row or a guard that is lost in the code is missed here."""
DRIVEN = {"not homed", "homing", "armed", "positioning", "running", "holding", "ramping down"}


def test_the_table_is_the_one_that_the_safety_concept_asks_for() -> None:
    rows = {
        ", ".join((f"{row.state.value}: {row.event.value} -> {row.to.value}", *names))
        for row in TRANSITIONS
        if row.event not in (Event.RAMP_DOWN, Event.TRIP)
        for names in [[guard.name for guard in row.guards]]
    }
    assert rows == set(TABLE.split("\n")) - {""}
    ramped = {row.state.value for row in TRANSITIONS if row.event is Event.RAMP_DOWN}
    tripping = {row.state for row in TRANSITIONS if row.event is Event.TRIP}
    assert ramped == DRIVEN - {"ramping down"}
    assert tripping == set(State) - {State.OFF}
    assert {state.value for state in VALVE_ENABLED} == DRIVEN


def test_before_the_rig_has_reported_nothing_is_enabled_or_closed() -> None:
    assert Conditions() == Conditions(False, False, False, "", "")


def conditions_of(row: Transition) -> Conditions:
    return replace(GOOD, homed="not homed" not in [guard.name for guard in row.guards])


@pytest.mark.parametrize("row", TRANSITIONS, ids=lambda row: f"{row.state.name}-{row.event.name}")
def test_every_row_of_the_table_leads_where_it_says(row: Transition) -> None:
    assert next_state(row.state, row.event, conditions_of(row)) is row.to


@pytest.mark.parametrize(
    ("row", "guard"),
    [(row, guard) for row in TRANSITIONS for guard in row.guards],
    ids=lambda part: (
        part.name if hasattr(part, "holds") else f"{part.state.name}-{part.event.name}"
    ),
)
def test_no_row_is_taken_while_one_of_its_guards_fails(row: Transition, guard: Guard) -> None:
    conditions = replace(conditions_of(row), **FAILING[guard.name])
    with suppress(IllegalTransition):
        assert next_state(row.state, row.event, conditions) is not row.to


@pytest.mark.parametrize(
    ("state", "event"),
    [pair for pair in product(State, Event) if pair not in KNOWN],
    ids=lambda part: part.name,
)
def test_what_is_not_in_the_table_is_refused(state: State, event: Event) -> None:
    with pytest.raises(IllegalTransition) as refusal:
        next_state(state, event, GOOD)
    assert repr(event.value) in str(refusal.value)
    assert state.value in str(refusal.value)


def test_a_refusal_names_the_guard_that_failed() -> None:
    with pytest.raises(IllegalTransition, match="emergency stop is open"):
        next_state(State.DISARMED, Event.ARM, Conditions())
    with pytest.raises(IllegalTransition, match="pump lost: remove the cause"):
        next_state(State.ARMED, Event.RUN, replace(GOOD, standing="pump lost"))
    with pytest.raises(IllegalTransition, match="not confirmed: bypass shut"):
        next_state(State.TRIPPED, Event.ACKNOWLEDGE, replace(GOOD, unconfirmed="bypass shut"))


@pytest.mark.parametrize("state", [state for state in State if state is not State.OFF])
def test_a_trip_is_taken_in_every_connected_state_whatever_the_conditions(state: State) -> None:
    assert next_state(state, Event.TRIP, Conditions(standing="x", unconfirmed="y")) is State.TRIPPED


CONDITIONS = st.builds(
    Conditions,
    estop_closed=st.booleans(),
    valve_enabled=st.booleans(),
    homed=st.booleans(),
    standing=st.sampled_from(["", "a limit"]),
    unconfirmed=st.sampled_from(["", "bypass shut"]),
)


@given(st.lists(st.tuples(st.sampled_from(Event), CONDITIONS), max_size=40))
def test_the_valve_is_enabled_only_by_the_reset_button_with_the_chain_closed(
    happenings: list[tuple[Event, Conditions]],
) -> None:
    after = State.OFF
    for event, conditions in happenings:
        before = after
        try:
            after = next_state(before, event, conditions)
        except IllegalTransition:
            continue
        if after in VALVE_ENABLED and before not in VALVE_ENABLED:
            assert before is State.ARMING
            assert event is Event.RESET_PRESSED
            assert conditions.estop_closed
            assert conditions.valve_enabled


@given(st.lists(st.tuples(st.sampled_from(Event), CONDITIONS), max_size=40))
def test_a_test_runs_only_on_a_homed_rig_with_nothing_against_it(
    happenings: list[tuple[Event, Conditions]],
) -> None:
    after = State.OFF
    for event, conditions in happenings:
        before = after
        try:
            after = next_state(before, event, conditions)
        except IllegalTransition:
            continue
        if after in (State.RUNNING, State.POSITIONING) and before is not after:
            assert conditions.homed
            assert not conditions.standing


def test_every_state_can_be_left_for_off() -> None:
    reaching = {State.OFF}
    for _ in State:
        reaching |= {row.state for row in TRANSITIONS if row.to in reaching}
    assert reaching == set(State)
