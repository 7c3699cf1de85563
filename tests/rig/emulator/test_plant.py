from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from faults.bypass import NOMINAL_BYPASSES
from rig.emulator.plant import COMMAND_RANGE, EmulatedPlant
from rig.plant import Model
from rig.plant.parameters import NOMINAL
from rig.plant.sensors import DATA_SHEET
from rig.plant.simulation import simulate

Clock = Any


def position(plant: EmulatedPlant) -> float:
    return plant.truth.position


def test_looked_at_every_millisecond_the_plant_moves_exactly_as_the_simulation(
    clock: Clock, plant: EmulatedPlant
) -> None:
    command = 2.0 * np.sin(np.arange(200) / 20.0)
    expected = simulate(Model(), command, position=0.5 * NOMINAL.stroke_max)
    for k, volts in enumerate(command):
        assert position(plant) == expected["position"][k]
        plant.drive_valve(float(volts))
        clock.advance(1e-3)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.integers(1, 20_000_000), min_size=1, max_size=30))
def test_how_often_one_looks_does_not_change_the_motion(looks_ns: list[int]) -> None:
    now = [0]
    often, seldom = (EmulatedPlant(Model(), clock=lambda: now[0]) for _ in range(2))
    for plant in (often, seldom):
        plant.drive_valve(1.0)
    for look_ns in looks_ns:
        now[0] += look_ns
        often.catch_up()
    # A step of the integrator is good to half a micrometre (docs/decisions/0010-integrator.md), and
    # each look ends one step early.
    assert position(often) == pytest.approx(position(seldom), abs=0.5e-6 * (len(looks_ns) + 1))


def test_a_stall_of_the_host_is_caught_up_at_the_next_look(
    clock: Clock, plant: EmulatedPlant
) -> None:
    plant.drive_valve(0.5)
    clock.advance(5.0)
    plant.catch_up()
    assert plant.time_ns == clock()
    assert position(plant) > 0.31


def test_the_amplifier_saturates(clock: Clock, plant: EmulatedPlant) -> None:
    plant.drive_valve(1e6)
    clock.advance(0.1)
    assert plant.truth.spool == pytest.approx(COMMAND_RANGE * NOMINAL.valve_gain, rel=1e-3)


@pytest.mark.parametrize(("volts", "end"), [(-1.0, NOMINAL.stroke_min), (1.0, NOMINAL.stroke_max)])
def test_the_ram_comes_to_rest_on_its_end_stops(
    clock: Clock, plant: EmulatedPlant, volts: float, end: float
) -> None:
    plant.drive_valve(volts)
    clock.advance(20.0)
    assert position(plant) == pytest.approx(end, abs=1e-3)
    assert plant.truth.velocity == pytest.approx(0.0, abs=1e-6)


def test_an_unloaded_pump_lets_the_supply_pressure_collapse(
    clock: Clock, plant: EmulatedPlant
) -> None:
    plant.load_pump(False)
    clock.advance(0.05)
    assert plant.truth.supply_pressure < 0.5 * NOMINAL.supply_pressure
    clock.advance(2.0)
    assert plant.truth.supply_pressure == pytest.approx(NOMINAL.return_pressure, abs=1.0)
    plant.load_pump(True)
    clock.advance(2.0)
    assert plant.truth.supply_pressure == pytest.approx(NOMINAL.supply_pressure, rel=1e-6)


def test_a_rig_whose_pump_is_not_loaded_yet_does_not_move(clock: Clock) -> None:
    plant = EmulatedPlant(Model(), clock=clock, pump_loaded=False)
    start = position(plant)
    plant.drive_valve(5.0)
    clock.advance(1.0)
    assert position(plant) == pytest.approx(start, abs=1e-4)


def test_a_stuck_spool_stays_whatever_is_ordered_until_it_is_freed(
    clock: Clock, plant: EmulatedPlant
) -> None:
    plant.drive_valve(2.0)
    clock.advance(2e-3)
    plant.stick_spool(True)
    jammed = plant.truth.spool
    plant.drive_valve(0.0)
    clock.advance(0.5)
    assert plant.truth.spool == pytest.approx(jammed, rel=1e-9)
    plant.stick_spool(False)
    clock.advance(0.5)
    assert plant.truth.spool == pytest.approx(0.0, abs=1e-9)


def test_a_bypass_leaks_what_its_two_valves_pass_in_series(clock: Clock) -> None:
    plant = EmulatedPlant(Model(), bypass_valves=NOMINAL_BYPASSES, clock=clock)
    valve = NOMINAL_BYPASSES["external_leakage_1"]
    plant.set_bypass("external_leakage_1", ball=0.7, needle=0.4)
    assert plant.coefficients["external_leakage_1"] == valve.effective(0.4, 0.7)
    plant.set_bypass("external_leakage_1", ball=0.0, needle=0.4)
    assert plant.coefficients["external_leakage_1"] == 0.0


def test_the_return_throttle_blocks_the_line_by_its_needle_alone(clock: Clock) -> None:
    plant = EmulatedPlant(Model(), return_resistance=4e13, clock=clock)
    plant.set_bypass("return_blockage", ball=0.0, needle=1.0)
    assert plant.coefficients["return_blockage"] == pytest.approx(4e13)
    plant.set_bypass("return_blockage", ball=1.0, needle=0.0)
    assert plant.coefficients["return_blockage"] == 0.0


def test_a_bypass_that_there_is_not_is_refused(plant: EmulatedPlant) -> None:
    with pytest.raises(ValueError, match="no such bypass"):
        plant.set_bypass("leak", 1.0, 1.0)


def test_a_flow_meter_lags_behind_the_leak_that_it_measures(clock: Clock) -> None:
    plant = EmulatedPlant(Model(), bypass_valves=NOMINAL_BYPASSES, clock=clock)
    plant.set_bypass("external_leakage_1", ball=1.0, needle=1.0)
    clock.advance(1e-3)
    early = plant.reading().flow_1
    clock.advance(0.3)
    assert plant.reading().flow_1 > 3.0 * early


def test_a_transducer_that_the_rig_lacks_reads_not_a_number(clock: Clock) -> None:
    reading = EmulatedPlant(Model(), load_cell=False, clock=clock).reading()
    assert np.isnan(reading.load)
    assert np.isfinite(reading.pressure_1)


def test_the_same_seed_gives_the_same_noise(clock: Clock) -> None:
    first, second = (EmulatedPlant(Model(), seed=3, clock=clock).reading() for _ in range(2))
    assert first == second
    assert first != EmulatedPlant(Model(), seed=4, clock=clock).reading()


def test_a_delayed_command_moves_the_spool_later_by_the_delay_at_whatever_moment(
    clock: Clock,
) -> None:
    slow = EmulatedPlant(Model().with_effect("command_delay", value=0.0034), clock=clock)
    prompt = EmulatedPlant(Model(), clock=clock)
    for plant in (slow, prompt):
        plant.drive_valve(2.0)
    clock.advance(3.3e-3)
    assert slow.truth.spool == 0.0
    clock.advance(0.9e-3 + 0.1e-3)
    late = slow.truth.spool
    again = EmulatedPlant(Model(), clock=clock)
    again.drive_valve(2.0)
    clock.advance(0.9e-3)
    assert late == pytest.approx(again.truth.spool, abs=1e-8)
    assert prompt.truth.spool > late


def test_the_transducers_of_an_emulated_rig_have_the_effects_of_its_model(clock: Clock) -> None:
    model = Model().with_effect("pressure_1_bias", value=2.5e5)
    model = model.with_effect("pressure_2_gain", value=0.9).with_effect("position_gain", value=1.05)
    model = model.with_effect("pressure_lag", value=0.01)
    quiet = DATA_SHEET._replace(pressure_noise=0.0)
    plant = EmulatedPlant(model, quiet, clock=clock)
    clock.advance(0.5)
    truth, reading = plant.truth, plant.reading()
    assert reading.pressure_1 == pytest.approx(truth.pressure_1 + 2.5e5, rel=1e-6)
    assert reading.pressure_2 == pytest.approx(0.9 * truth.pressure_2, rel=1e-6)
    count = quiet.position_resolution
    assert reading.position == pytest.approx(1.05 * truth.position, abs=0.51 * count)
    assert plant.encoder_counts() == round(1.05 * truth.position / count)


def test_the_emulated_encoder_is_late_by_its_delay_and_behind_by_its_play(clock: Clock) -> None:
    late = EmulatedPlant(Model().with_effect("position_delay", value=0.01), clock=clock)
    loose = EmulatedPlant(Model().with_effect("position_backlash", value=1e-3), clock=clock)
    for plant in (late, loose):
        plant.drive_valve(3.0)
    clock.advance(0.2)
    before = late.truth.position
    clock.advance(0.01)
    count = DATA_SHEET.position_resolution
    assert late.reading().position == pytest.approx(before, abs=0.6 * count)
    assert loose.reading().position == pytest.approx(
        loose.truth.position - 0.5e-3, abs=0.51 * count
    )


def test_the_ripple_of_a_pump_falls_with_its_pressure(clock: Clock) -> None:
    model = Model().with_effect("supply_ripple", amplitude=3e5, frequency=100.0)
    plant = EmulatedPlant(model, clock=clock)

    def wander() -> float:
        seen = []
        for _ in range(40):
            clock.advance(1e-3)
            seen.append(plant.truth.supply_pressure)
        return float(np.ptp(seen))

    assert wander() == pytest.approx(2.0 * 3e5, rel=0.1)
    plant.load_pump(False)
    clock.advance(2.0)
    assert wander() < 1e3


def test_a_stuck_spool_stays_where_it_is_behind_a_play_too(clock: Clock) -> None:
    plant = EmulatedPlant(Model().with_effect("valve_hysteresis", value=1e-5), clock=clock)
    plant.drive_valve(2.0)
    clock.advance(0.2)
    plant.stick_spool(True)
    held = plant.truth.spool
    plant.drive_valve(-2.0)
    clock.advance(0.2)
    assert plant.truth.spool == pytest.approx(held, abs=1e-9)
