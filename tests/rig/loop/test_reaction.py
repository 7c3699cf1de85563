"""What the loop does about a fault follows from the newest decision, while that is fresh."""

from math import nan

import numpy as np
import pytest
from hypothesis import given, strategies as st

from estimator.filters.registry import FILTERS
from faults.campaign import OnFault
from rig.loop.decided import DECIDED, Decided, no_decision
from rig.loop.reaction import STALE_S, Reaction, react, reaction_memory, tolerating
from rig.plant.parameters import NOMINAL

COEFFICIENT = 4e-9


def decision(
    at_s: float = 10.0, confirmed: bool = True, leak: float = COEFFICIENT
) -> np.ndarray[tuple[int], np.dtype[np.float64]]:
    row = np.zeros(len(DECIDED))
    row[Decided.AT_S], row[Decided.CONFIRMED], row[Decided.PRESENT + 1] = at_s, confirmed, leak
    return row


def test_every_choice_of_a_campaign_is_one_of_the_loop() -> None:
    assert [choice.name for choice in OnFault] == [reaction.name for reaction in Reaction]


def test_the_pressures_are_where_the_compensation_looks_for_them() -> None:
    for chosen in FILTERS.values():
        assert chosen.states[1:3] == ("pressure_1_Pa", "pressure_2_Pa")


@pytest.mark.parametrize("asked", Reaction)
def test_nothing_is_done_before_the_first_decision_or_without_a_fault(asked: Reaction) -> None:
    healthy = decision(confirmed=False, leak=0.0)
    for row in (no_decision(), healthy):
        assert react(int(asked), row, 10.1, reaction_memory()) == Reaction.IGNORE


@pytest.mark.parametrize("asked", Reaction)
def test_a_confirmed_leak_is_met_as_asked(asked: Reaction) -> None:
    assert react(int(asked), decision(), 10.1, reaction_memory()) == asked


def test_a_fault_whose_size_is_not_known_cannot_be_tolerated() -> None:
    unknown = decision(leak=0.0)
    assert react(int(Reaction.TOLERATE), unknown, 10.1, reaction_memory()) == Reaction.IGNORE
    assert react(int(Reaction.HOLD), unknown, 10.1, reaction_memory()) == Reaction.HOLD


@pytest.mark.parametrize("asked", [Reaction.TOLERATE, Reaction.HOLD, Reaction.TRIP])
def test_a_stale_decision_is_not_acted_upon(asked: Reaction) -> None:
    late_s = 10.0 + STALE_S + 1e-3
    assert react(int(asked), decision(), late_s, reaction_memory()) == Reaction.IGNORE


@given(rows=st.lists(st.booleans(), min_size=1, max_size=20), lag=st.floats(0.0, 5.0))
def test_a_hold_stays_and_tolerance_ends_with_the_leak(rows: list[bool], lag: float) -> None:
    holds, tolerates = reaction_memory(), reaction_memory()
    held = False
    for leaking in rows:
        row = decision(confirmed=leaking, leak=COEFFICIENT * leaking)
        acts = leaking and 10.0 + lag - 10.0 <= STALE_S
        held = held or acts
        assert react(int(Reaction.HOLD), row, 10.0 + lag, holds) == Reaction.HOLD * held
        assert react(int(Reaction.TOLERATE), row, 10.0 + lag, tolerates) == acts


@given(command=st.floats(-10.0, 10.0), asked=st.sampled_from(Reaction))
def test_with_nothing_confirmed_the_command_is_the_proportional_one_bit_for_bit(
    command: float, asked: Reaction
) -> None:
    memory, row = reaction_memory(), decision(confirmed=False, leak=0.0)
    x = np.full(11, nan)
    react(int(asked), row, 10.1, memory)
    given_back = tolerating(command, int(asked), row, x, NOMINAL, 10.0, 1e-3, memory)
    assert np.float64(given_back).tobytes() == np.float64(command).tobytes()
    assert memory.acted[1] == 0.0


def test_what_is_added_for_a_leak_is_reported_as_compensation() -> None:
    memory, row, x = reaction_memory(), decision(), np.full(11, 7e6)
    for _ in range(1000):
        react(int(Reaction.TOLERATE), row, 10.1, memory)
        command = tolerating(1.0, int(Reaction.TOLERATE), row, x, NOMINAL, 10.0, 1e-3, memory)
    assert abs(memory.acted[1]) > 0.01
    assert command == 1.0 + memory.acted[1]
