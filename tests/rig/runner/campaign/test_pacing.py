import pytest
from hypothesis import given, strategies as st

from rig.runner.campaign.pacing import Pacer
from rig.runner.campaign.stopping import StopFlag


class Clock:
    """A clock that only sleeping and working move on."""

    def __init__(self) -> None:
        self.now = 100.0
        self.naps: list[float] = []

    def time(self) -> float:
        return self.now

    def sleep(self, duration: float) -> None:
        self.naps.append(duration)
        self.now += duration


@given(work=st.lists(st.floats(0.0, 0.3), min_size=1, max_size=30))
def test_no_batch_is_early_and_no_delay_adds_up(work: list[float]) -> None:
    clock = Clock()
    pacer = Pacer("real", StopFlag(), clock.time, clock.sleep)
    pacer.start()
    latest = 0.0
    for number, duration in enumerate(work, start=1):
        clock.now += duration
        due = number * 0.05
        pacer.wait_until(due)
        latest = max(latest + duration, due)
        assert clock.now - 100.0 == pytest.approx(latest)


def test_as_fast_as_it_can_never_waits() -> None:
    clock = Clock()
    Pacer("fast", StopFlag(), clock.time, clock.sleep).wait_until(1e9)
    assert clock.naps == []


def test_a_wait_ends_when_a_stop_is_requested() -> None:
    clock, stop = Clock(), StopFlag()

    def sleep(duration: float) -> None:
        clock.sleep(duration)
        stop.request("the operator")

    Pacer("real", stop, clock.time, sleep).wait_until(1e9)
    assert len(clock.naps) == 1
    assert clock.naps[0] <= 0.05
