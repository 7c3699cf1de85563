"""The emulated rig is wired as its file says, right or wrong."""

from dataclasses import replace

import pytest

from rig.configuration.rigs.rig import Rig
from rig.emulator.addresses import endpoints_of
from rig.emulator.application import Emulator
from rig.emulator.instruments import Instruments
from rig.emulator.plant import EmulatedPlant
from rig.emulator.record import Record
from rig.io.wiring import Wiring
from rig.plant import Model
from tests.rig.emulator.conftest import ManualClock


def moved(clock: ManualClock, wiring: Wiring | None = None) -> Instruments:
    plant = EmulatedPlant(Model(), clock=clock)
    plant.drive_valve(1.0)
    clock.advance(0.05)
    return Instruments(plant, wiring)


def test_readings_stand_where_they_are_wired_to(clock: ManualClock) -> None:
    right = moved(clock).read()
    wrong = moved(clock, Wiring("normal", "inverted", "inverted", "swapped")).read()
    assert wrong.position == -right.position
    assert wrong.spool == -right.spool
    assert (wrong.pressure_1, wrong.pressure_2) == (right.pressure_2, right.pressure_1)
    assert wrong.supply_pressure == right.supply_pressure


def test_an_inverted_encoder_counts_down_from_where_it_was_switched_on(
    clock: ManualClock,
) -> None:
    right = moved(clock).encoder_counts()
    assert moved(clock, Wiring(encoder="inverted")).encoder_counts() == -right != 0


@pytest.mark.parametrize(("valve", "sign"), [("normal", 1.0), ("inverted", -1.0)])
def test_an_inverted_valve_gets_the_opposite_of_the_output(
    simulated: Rig, clock: ManualClock, valve: str, sign: float
) -> None:
    rig = replace(simulated, wiring=Wiring(valve=valve))  # type: ignore[arg-type]
    emulator = Emulator(rig, endpoints_of(rig, {}, None), Record(clock=clock), clock=clock)
    emulator.node._valve(0.5, clock.now_ns)
    clock.advance(0.05)
    assert sign * emulator.plant.truth.spool > 0.0


def test_the_ram_rests_where_it_is_asked_to(clock: ManualClock) -> None:
    assert EmulatedPlant(Model(), clock=clock, position=0.1).truth.position == 0.1
