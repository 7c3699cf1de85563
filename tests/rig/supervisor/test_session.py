"""A test on the hardware ends with the ram held, or else with the motion brought to rest."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, cast

import pytest

from rig.loop.interlocks.ladder import Action, Cause
from rig.loop.interlocks.trip import LoopStoppedError, TripError
from rig.plant import Model
from rig.supervisor.session import HardwareTest
from rig.supervisor.states import Event, State


class ConnectedRig:
    """What a test asks of the rig at its end; keeps it.

    Attributes:
        ends: events for the state machine, "ramp down" for a motion that is brought to rest, and
            "field safe" for slow drivers in their safe state.
    """

    configured = SimpleNamespace(injectable=(), blocking_valves=None)
    safety = SimpleNamespace(tripped=False)
    state = State.RUNNING

    def __init__(self) -> None:
        self.ends: list[Event | str] = []

    def note(self, who: str, text: str) -> None:
        """Take no note of what is told."""

    def say(self, text: str) -> None:
        """Show it to nobody."""

    def write(self, outputs: Mapping[str, float]) -> None:
        """Have the valves where they shall be."""

    def handle(self, event: Event) -> None:
        self.ends.append(event)

    def ramp_down(self) -> None:
        self.ends.append("ramp down")

    def make_field_safe(self) -> None:
        self.ends.append("field safe")

    @contextmanager
    def reporting_stops(self) -> Iterator[None]:
        try:
            yield
        except LoopStoppedError as error:
            raise TripError(f"stopped: {error}") from None


class Wire:
    """A loop whose test is over, and which holds the ram unless something `fails`."""

    channels = ()
    fails: Exception | None = None

    def safe_state(self) -> None:
        if self.fails is not None:
            raise self.fails


def ended_early(rig: ConnectedRig, wire: Wire) -> HardwareTest:
    test = HardwareTest(cast("Any", rig), cast("Any", wire), cast("Any", None), Model())
    test.end_early()
    return test


@pytest.mark.parametrize(
    ("action", "ends"),
    [(Action.HOLD, [Event.DONE]), (Action.RAMP_DOWN, ["ramp down", "field safe"])],
)
def test_after_its_last_sample_a_test_ends_as_its_limit_asks(
    action: Action, ends: list[Event | str]
) -> None:
    rig = ConnectedRig()
    test = ended_early(rig, Wire())
    with pytest.raises(TripError, match="settling"):
        test.limited(action, "settling of the step from 1.000 s 2 s above 1 s at 3.000 s")
    test.safe_state()
    assert rig.ends == ends


def test_a_test_whose_ram_is_held_is_completed() -> None:
    rig = ConnectedRig()
    test = ended_early(rig, Wire())
    test.safe_state()
    test.safe_state()
    assert rig.ends == [Event.DONE]


@pytest.mark.parametrize(
    ("failure", "why"),
    [
        (TripError("the loop still runs segment 3"), "still runs segment 3"),
        (LoopStoppedError(Action.HOLD, Cause.STALE_SAMPLE), "stopped: hold"),
    ],
)
def test_a_ram_that_the_loop_does_not_hold_is_brought_to_rest(failure: Exception, why: str) -> None:
    rig, wire = ConnectedRig(), Wire()
    wire.fails = failure
    with pytest.raises(TripError, match=why):
        ended_early(rig, wire).safe_state()
    # Nobody waits for a recorder that hangs until bypasses are shut and the pump is unloaded.
    assert rig.ends == ["ramp down", "field safe"]
