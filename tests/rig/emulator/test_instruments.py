from math import isnan
from typing import Any

import pytest

from rig.channels import Kind, names_of
from rig.emulator.instruments import CARRIED, CHANNELS, STEADY, Instruments, rails
from rig.emulator.plant import EmulatedPlant
from rig.io.signals import FAST_INPUTS
from rig.plant.sensors import DATA_SHEET, Reading

Clock = Any


@pytest.fixture
def instruments(plant: EmulatedPlant) -> Instruments:
    return Instruments(plant)


def test_channels_are_the_signals_of_the_transducers() -> None:
    assert (*FAST_INPUTS[: len(Reading._fields)], *names_of(Kind.CARRIED)) == CHANNELS
    assert STEADY.keys() == set(CARRIED)
    assert len(rails(DATA_SHEET)) == len(CHANNELS)


def test_a_frozen_channel_holds_while_the_others_go_on(
    instruments: Instruments, clock: Clock
) -> None:
    instruments.freeze("pressure_1_Pa", True)
    first = instruments.read()
    clock.advance(0.01)
    second = instruments.read()
    assert first.pressure_1 == second.pressure_1
    assert first.pressure_2 != second.pressure_2
    instruments.freeze("pressure_1_Pa", False)
    assert instruments.read().pressure_1 != first.pressure_1


@pytest.mark.parametrize(
    ("reads", "expected"),
    [("zero", 0.0), ("low", DATA_SHEET.pressure_min), ("high", DATA_SHEET.pressure_max)],
)
def test_a_failed_sensor_reads_zero_or_one_of_its_rails(
    instruments: Instruments, reads: Any, expected: float
) -> None:
    instruments.fail("pressure_2_Pa", reads)
    assert instruments.read().pressure_2 == expected
    instruments.mend("pressure_2_Pa")
    assert instruments.read().pressure_2 != expected


def test_a_failed_sensor_may_read_no_number(instruments: Instruments) -> None:
    instruments.fail("load_N", "nan")
    assert isnan(instruments.read().load)


def test_a_drifting_sensor_goes_away_at_its_rate(instruments: Instruments, clock: Clock) -> None:
    instruments.fail("position_m", "drift", rate_per_s=0.1)
    before = instruments.read().position
    clock.advance(2.0)
    assert instruments.read().position - before == pytest.approx(0.2, abs=1e-3)


@pytest.mark.parametrize(
    ("reads", "expected"), [("zero", 0.0), ("low", 223.15), ("high", 423.15), ("drift", 315.15)]
)
def test_a_carried_transducer_fails_like_any_other(
    instruments: Instruments, clock: Clock, reads: Any, expected: float
) -> None:
    instruments.fail("tank_temperature_K", reads, rate_per_s=1.0)
    clock.advance(2.0)
    instruments.read()
    assert instruments.read_carried()["tank_temperature_K"] == pytest.approx(expected)
    instruments.freeze("tank_temperature_K", True)
    instruments.mend("tank_temperature_K")
    assert instruments.read_carried()["tank_temperature_K"] == pytest.approx(expected)
    instruments.freeze("tank_temperature_K", False)
    assert instruments.read_carried()["tank_temperature_K"] == 313.15
