from collections.abc import Iterator
from dataclasses import dataclass

import pytest

from rig.configuration.rigs.rig import Rig, load_rig
from rig.emulator.instruments import Instruments
from rig.emulator.modbus.io_node import IoNode
from rig.emulator.plant import EmulatedPlant
from rig.emulator.record import Record
from rig.emulator.running import EmulatorThread
from rig.emulator.script.fault_script import Script
from rig.plant import Model


class ManualClock:
    """A clock that advances only when the test advances it."""

    def __init__(self) -> None:
        self.now_ns = 1_000_000_000

    def __call__(self) -> int:
        return self.now_ns

    def advance(self, seconds: float) -> None:
        self.now_ns += round(1e9 * seconds)


@dataclass
class Bench:
    """An emulated I/O node and its plant, which both read a clock that the test advances."""

    clock: ManualClock
    plant: EmulatedPlant
    instruments: Instruments
    record: Record
    node: IoNode

    def events(self) -> list[str]:
        return [event["event"] for event in self.record.events]


@pytest.fixture
def clock() -> ManualClock:
    return ManualClock()


@pytest.fixture
def plant(clock: ManualClock) -> EmulatedPlant:
    return EmulatedPlant(Model(), clock=clock)


@pytest.fixture
def bench(clock: ManualClock, plant: EmulatedPlant) -> Bench:
    instruments, record = Instruments(plant), Record(clock=clock)
    node = IoNode(instruments, plant.drive_valve, record)
    return Bench(clock, plant, instruments, record, node)


@pytest.fixture(scope="session")
def simulated() -> Rig:
    return load_rig("simulated")


@pytest.fixture
def emulator(simulated: Rig) -> Iterator[EmulatorThread]:
    with EmulatorThread(simulated, script=Script(attentive=True)) as running:
        yield running
