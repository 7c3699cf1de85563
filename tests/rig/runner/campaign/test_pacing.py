from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from hypothesis import given, strategies as st

from rig.runner.campaign.pacing import Lateness, Pacer
from rig.runner.campaign.stopping import StopFlag


class Clock:
    """A clock that only sleeping and working move on."""

    def __init__(self) -> None:
        self.now = 100.0
        self.naps: list[float] = []

    def monotonic(self) -> float:
        return self.now

    def sleep(self, duration: float) -> None:
        self.naps.append(duration)
        self.now += duration


@contextmanager
def paced_by(clock: Clock) -> Iterator[None]:
    """Let a clock take the place of the wall clock."""
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr("rig.runner.campaign.pacing.time", clock)
        yield


@given(work=st.lists(st.floats(0.0, 0.3), min_size=1, max_size=30))
def test_no_batch_is_early_and_no_delay_adds_up(work: list[float]) -> None:
    clock = Clock()
    with paced_by(clock):
        pacer = Pacer("real", StopFlag())
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
    with paced_by(clock):
        Pacer("fast", StopFlag()).wait_until(1e9)
    assert clock.naps == []


def test_a_wait_ends_when_a_stop_is_requested() -> None:
    stop = StopFlag()

    class Stopping(Clock):
        """A clock on which somebody asks for a stop while the pacer sleeps."""

        def sleep(self, duration: float) -> None:
            super().sleep(duration)
            stop.request("the operator")

    clock = Stopping()
    with paced_by(clock):
        Pacer("real", stop).wait_until(1e9)
    assert len(clock.naps) == 1
    assert clock.naps[0] <= 0.05


def test_limits_that_are_judged_late_are_said_once_and_again_when_they_are_in_time() -> None:
    now = [100.0]
    lateness = Lateness(lambda: now[0])
    said = []
    for wall_s, last_s in (
        (0.06, 0.05),
        (0.5, 0.1),
        (2.0, 0.9),
        (3.0, 1.5),
        (3.1, 2.8),
        (3.2, 3.1),
    ):
        now[0] = 100.0 + wall_s
        said.append(lateness.take(last_s))
    assert said[2].startswith("limits that the supervisor judges are judged 1.1 s late")
    assert said[4] == "limits that the supervisor judges are judged in time again"
    assert [bool(each) for each in said] == [False, False, True, False, True, False]
