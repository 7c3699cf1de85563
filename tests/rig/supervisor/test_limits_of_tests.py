"""What a test on hardware does about a limit that the loop does not judge."""

from types import SimpleNamespace
from typing import Any

import pytest

from control import Constant
from rig.loop import Action, Cause, TripError
from rig.plant import Model
from rig.runner.campaign.bench import plain_test
from rig.supervisor.session import HardwareTest


class Rig:
    """As much of a connected rig as a limit needs; it keeps what it is told."""

    def __init__(self) -> None:
        self.told: list[str] = []
        self.trips: list[Cause] = []
        self.safety = SimpleNamespace(trip=self.trips.append, tripped=False)

    def note(self, who: str, text: str) -> None:
        self.told.append(f"{who}: {text}")

    def say(self, text: str) -> None:
        self.told.append(text)

    def tripped(self) -> TripError:
        return TripError("tripped")


def limited(action: Action) -> tuple[Rig, HardwareTest, str]:
    rig: Any = Rig()
    wire: Any = SimpleNamespace(channels=("time_s",))
    test = HardwareTest(rig, wire, plain_test("a", Constant(0.3), 5.0, 0.3, 1.0), Model())
    with pytest.raises(TripError) as caught:
        test.limited(action, "oil_temperature_K 340 K above 338 K at 3.000 s: hold")
    return rig, test, str(caught.value)


@pytest.mark.parametrize("action", [Action.HOLD, Action.RAMP_DOWN])
def test_a_hold_or_a_ramp_down_ends_the_test_by_the_usual_way_out(action: Action) -> None:
    rig, _, message = limited(action)
    assert message == "oil_temperature_K 340 K above 338 K at 3.000 s: hold"
    assert rig.told == [f"limit: {message}", message]
    assert not rig.trips


def test_a_trip_is_the_safety_threads_with_a_cause_of_its_own() -> None:
    rig, _, message = limited(Action.TRIP)
    assert rig.trips == [Cause.TEST_LIMIT]
    assert message == "tripped"
