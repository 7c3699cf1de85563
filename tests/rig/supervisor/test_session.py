"""A test on the hardware ends with the ram held, or else with the motion brought to rest."""

from typing import Any, cast

import pytest

from rig.loop.interlocks.ladder import Action, Cause
from rig.loop.interlocks.trip import LoopStoppedError, TripError
from rig.supervisor.session import HardwareTest


class Session:
    """What a test asks of the session at its end; keeps it.

    Attributes:
        ends: whether the test was completed, for each end.
    """

    def __init__(self) -> None:
        self.ends: list[bool] = []

    def end_test(self, *, completed: bool) -> None:
        self.ends.append(completed)

    def stopped(self, error: LoopStoppedError) -> TripError:
        return TripError(f"stopped: {error}")


class Wire:
    """A loop whose test is over, and which holds the ram unless something `fails`."""

    channels = ()
    fails: Exception | None = None

    def safe_state(self) -> None:
        if self.fails is not None:
            raise self.fails


def ended_early(session: Session, wire: Wire) -> HardwareTest:
    test = HardwareTest(cast("Any", session), cast("Any", wire), cast("Any", None))
    test.end_early()
    return test


def test_a_test_whose_ram_is_held_is_completed() -> None:
    session = Session()
    test = ended_early(session, Wire())
    test.safe_state()
    test.safe_state()
    assert session.ends == [True]


@pytest.mark.parametrize(
    ("failure", "why"),
    [
        (TripError("the loop still runs segment 3"), "still runs segment 3"),
        (LoopStoppedError(Action.HOLD, Cause.STALE_SAMPLE), "stopped: hold"),
    ],
)
def test_a_ram_that_the_loop_does_not_hold_is_brought_to_rest(failure: Exception, why: str) -> None:
    session, wire = Session(), Wire()
    wire.fails = failure
    with pytest.raises(TripError, match=why):
        ended_early(session, wire).safe_state()
    assert session.ends == [False]
