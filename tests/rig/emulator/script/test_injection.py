from typing import Any

import pytest

from rig.emulator.record import Record
from rig.emulator.script.fault_script import fault_from
from rig.emulator.script.injection import Injection

Clock = Any


class Noted:
    """An emulated rig whose only part is an emergency stop, which takes note of who presses it."""

    def __init__(self) -> None:
        self.acting: list[Any] = []
        self.node: Any = self

    def press_estop(self, pressed: bool) -> None:
        if pressed:
            self.acting.append("estop")
        else:
            self.acting.remove("estop")


@pytest.fixture
def effects() -> Noted:
    return Noted()


@pytest.fixture
def injection(effects: Any, clock: Clock) -> Injection:
    return Injection(effects, Record(clock=clock), clock)


def after(clock: Clock, injection: Injection, seconds: float) -> None:
    clock.advance(seconds)
    injection.tend()


def test_a_scripted_fault_begins_at_its_time_and_ends_after_it(
    injection: Injection, effects: Noted, clock: Clock
) -> None:
    injection.script([fault_from({"fault": "estop", "at": "2 s", "for": "1 s"})])
    after(clock, injection, 1.999)
    assert effects.acting == []
    after(clock, injection, 0.001)
    assert len(effects.acting) == 1
    after(clock, injection, 1.0)
    assert effects.acting == []


def test_a_fault_after_enable_waits_for_the_first_time_the_valve_is_enabled(
    injection: Injection, effects: Noted, clock: Clock
) -> None:
    injection.script([fault_from({"fault": "estop", "after": "enable", "at": "1 s"})])
    after(clock, injection, 100.0)
    assert effects.acting == []
    injection.valve_enabled()
    after(clock, injection, 0.5)
    injection.valve_enabled()
    after(clock, injection, 0.5)
    assert len(effects.acting) == 1


def test_a_fault_asked_for_begins_at_once_and_lasts_until_it_is_cleared(
    injection: Injection, effects: Noted, clock: Clock
) -> None:
    number = injection.inject(fault_from({"fault": "estop"}))
    assert len(effects.acting) == 1
    after(clock, injection, 1e6)
    assert len(effects.acting) == 1
    assert injection.clear(number) == 1
    assert effects.acting == []
    assert injection.clear(number) == 0


def test_times_of_a_fault_asked_for_count_from_then(
    injection: Injection, effects: Noted, clock: Clock
) -> None:
    after(clock, injection, 50.0)
    injection.inject(fault_from({"fault": "estop", "at": "1 s"}))
    assert effects.acting == []
    after(clock, injection, 1.0)
    assert len(effects.acting) == 1


def test_clearing_all_takes_those_that_wait_along(
    injection: Injection, effects: Noted, clock: Clock
) -> None:
    injection.inject(fault_from({"fault": "estop"}))
    injection.inject(fault_from({"fault": "estop", "at": "1 s"}))
    assert injection.clear() == 2
    after(clock, injection, 2.0)
    assert effects.acting == []
