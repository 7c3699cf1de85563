"""What is judged of a cylinder that blocking valves lock while its servovalve is a little open."""

from rig.loop.interlocks.check_tolerances import locked_tolerances
from rig.loop.interlocks.ladder import Action, Cause

from .samples_by_hand import NOTHING, TOL, Judge

OPEN_V = 2.0
"""Command at which the tolerance of the valve's null does not explain a ram that stands."""
TICKS = 1000


def test_a_ram_that_stands_against_the_valves_flow_is_expected_only_when_locked() -> None:
    locked, usual = Judge(tol=locked_tolerances(TOL)), Judge()
    assert set(locked.steps(TICKS, command=OPEN_V)) == {NOTHING}
    found = usual.steps(TICKS, command=OPEN_V)
    assert (Action.TRIP, Cause.ENCODER_FROZEN, "position_m") in found


def test_one_that_moves_against_the_flow_trips_though_locked() -> None:
    judge = Judge(tol=locked_tolerances(TOL))
    judge.steps(100, command=OPEN_V)
    found = [judge.step(position_m=0.3 - 2e-4 * k, command=OPEN_V) for k in range(200)]
    assert (Action.TRIP, Cause.POSITION_AGAINST_FLOW, "position_m") in found


def test_the_loop_goes_on_unlocked_with_nothing_owed_by_the_time_before() -> None:
    locked = Judge(tol=locked_tolerances(TOL))
    locked.steps(TICKS, command=OPEN_V)
    assert max(locked.evidence.high_m, locked.evidence.low_m) < 1e-4
