"""What the emulated blocking valves let pass."""

from math import inf, sqrt

from rig.configuration.rigs.blocking import BlockingValves
from rig.configuration.rigs.rig import load_rig
from rig.emulator.addresses import endpoints_of
from rig.emulator.application import Emulator
from rig.emulator.blocking_valves import conductance
from rig.emulator.record import Record
from tests.rig.io.conftest import ManualClock

VALVES = BlockingValves(0.2, 1.7e-9, 1e7)


def test_one_lets_everything_pass_when_open_and_half_of_its_data_sheets_leak_when_shut() -> None:
    assert conductance(0.0, VALVES) == inf
    assert conductance(1.0, VALVES) * sqrt(1e7) == 0.5 * VALVES.leak
    passed = [conductance(0.1 * tenths, VALVES) for tenths in range(11)]
    assert passed == sorted(passed, reverse=True)


def test_one_without_a_leak_still_lets_something_pass_as_the_plant_needs() -> None:
    assert 0.0 < conductance(1.0, BlockingValves(0.2, 0.0, 1e7)) * sqrt(1e7) < 1e-10


def test_shutting_both_locks_the_cylinder_against_the_servovalve() -> None:
    clock = ManualClock()
    rig = load_rig("locked")
    emulator = Emulator(rig, endpoints_of(rig), Record(clock=clock), clock=clock)
    for valve in ("blocking_1", "blocking_2"):
        emulator.bypass.valves.order_blocking(valve, True)
    for _ in range(30):
        clock.advance(0.01)
        emulator.tend()
    locked = emulator.plant.truth.position
    emulator.plant.drive_valve(10.0)
    clock.advance(0.5)
    emulator.tend()
    assert abs(emulator.plant.truth.position - locked) < 1e-4

    emulator.bypass.valves.order_blocking("blocking_1", False)
    emulator.bypass.valves.order_blocking("blocking_2", False)
    for _ in range(50):
        clock.advance(0.01)
        emulator.tend()
    assert emulator.plant.truth.position - locked > 0.05
