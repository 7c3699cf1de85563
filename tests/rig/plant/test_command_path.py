"""Delay, play and ripple lie between the loop's command and the plant, and do what they say."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from rig.plant import NOMINAL, Model, Parameters
from rig.plant.command_effects import LONGEST_DELAY_TICKS, command_path
from rig.plant.dynamics import PlantState
from rig.plant.integrator import SUBSTEPS, TICK
from rig.plant.simulation import simulate

Array = NDArray[np.float64]

TIME = np.arange(300) * TICK
COMMAND = 3.0 * np.sin(2.0 * np.pi * 5.0 * TIME) + np.where(TIME > 0.1, 1.0, 0.0)


def run(parameters: Parameters, command: Array = COMMAND, **options: float) -> dict[str, Array]:
    return simulate(Model(parameters=parameters), command, position=0.3, **options)  # type: ignore[arg-type]


@given(st.integers(0, LONGEST_DELAY_TICKS))
def test_a_delay_of_whole_ticks_is_the_command_of_that_many_ticks_ago(ticks: int) -> None:
    late = np.concatenate([np.zeros(ticks), COMMAND[: COMMAND.size - ticks]])
    delayed, shifted = run(NOMINAL._replace(command_delay=ticks * TICK)), run(NOMINAL, late)
    for state in PlantState._fields:
        assert np.array_equal(delayed[state], shifted[state]), state


@given(st.floats(0.01, 0.99), st.integers(0, LONGEST_DELAY_TICKS - 1))
def test_a_delay_of_a_part_of_a_tick_lets_the_spool_start_that_much_later(
    part: float, ticks: int
) -> None:
    """A step of u moves it by k_sp u (1 - e^-a (cos b + a/b sin b)) after the delay (eq. 2.5)."""
    delay = (ticks + part) * TICK
    found = run(NOMINAL._replace(command_delay=delay), np.full(60, 2.0))["spool"]
    since = np.maximum(np.arange(60) * TICK - delay, 0.0)
    a = NOMINAL.valve_damping * NOMINAL.valve_natural_frequency
    b = NOMINAL.valve_natural_frequency * np.sqrt(1.0 - NOMINAL.valve_damping**2)
    step = 1.0 - np.exp(-a * since) * (np.cos(b * since) + a / b * np.sin(b * since))
    assert found == pytest.approx(2.0 * NOMINAL.valve_gain * step, abs=2e-8)


@given(st.floats(1e-7, 2e-5))
def test_a_valve_with_play_follows_by_at_most_its_half_width_and_rests_where_it_was_left(
    half: float,
) -> None:
    rising = np.linspace(0.0, 2.0, 100)
    command = np.concatenate([rising, np.full(100, 2.0), np.full(100, 2.0 - half / 3e-5)])
    spool = run(NOMINAL._replace(valve_hysteresis=half), command)["spool"]
    top = 2.0 * NOMINAL.valve_gain - half
    assert spool[199] == pytest.approx(top, abs=1e-9)
    # Back by more than half the play and less than all of it: the spool does not notice.
    assert half < NOMINAL.valve_gain * half / 3e-5 + half < 2.0 * half
    assert spool[-1] == pytest.approx(top, abs=1e-9)


def test_a_path_starts_where_the_spool_stands_as_near_as_the_play_allows() -> None:
    rig = NOMINAL._replace(valve_hysteresis=1e-5)
    assert command_path(rig, spool=4e-6)[1] == 4e-6
    assert command_path(rig, spool=4e-5)[1] == 1e-5


@given(st.floats(10.0, 400.0), st.floats(-3.0, 3.0), st.floats(-1.0, 1.0))
def test_the_supply_at_a_valve_at_null_is_a_sine_of_the_ripples_amplitude_and_phase(
    frequency: float, phase: float, start: float
) -> None:
    rig = NOMINAL._replace(
        supply_ripple=4e5, supply_ripple_frequency=frequency, supply_ripple_phase=phase
    )
    found = run(rig, np.zeros(200), start_s=start)["supply_pressure"][20:]
    time = start + np.arange(20, 200) * TICK
    expected = 4e5 * np.sin(2.0 * np.pi * frequency * time + phase)
    # Whatever the line began with is gone after ten of its time constants.
    assert found - 13.8e6 == pytest.approx(expected, abs=4e5 * 1e-4)


DYNAMIC = {
    "valve_deadband": NOMINAL._replace(valve_deadband=1e-5),
    "valve_underlap_leakage": NOMINAL._replace(valve_underlap_leakage=1e-5),
    "valve_flow_asymmetry": NOMINAL._replace(valve_flow_asymmetry=0.2),
    "valve_hysteresis": NOMINAL._replace(valve_hysteresis=1e-5),
    "valve_rate_limit": NOMINAL._replace(valve_rate_limit=2e-2),
    "command_delay": NOMINAL._replace(command_delay=0.0034),
    "supply_ripple": NOMINAL._replace(supply_ripple=5e5),
    "constant_force": NOMINAL._replace(constant_force=3e3),
    "payload_mass": NOMINAL._replace(payload_mass=200.0),
    "end_stop": NOMINAL._replace(stop_stiffness=3e6, stop_low=0.29, stop_high=0.31),
    "a long underlap": NOMINAL._replace(valve_underlap_leakage=5e-5, return_back_pressure=5e12),
    "every lap": NOMINAL._replace(
        valve_underlap_leakage=5e-6, valve_deadband=5e-6, valve_flow_asymmetry=-0.2
    ),
}
MOVING = np.arange(1500) * TICK
MOTIONS = (
    4.0 * np.sin(4.0 * np.pi * MOVING),
    np.repeat(np.random.default_rng(3).uniform(-5.0, 5.0, 15), 100),
)


@pytest.mark.parametrize("rig", DYNAMIC.values(), ids=DYNAMIC.keys())
def test_each_halving_of_the_step_brings_a_rig_with_the_effect_closer(rig: Parameters) -> None:
    """Over 30 ms from all along two motions, typically: where a ram just sticks, runs part."""
    model, horizon = Model(parameters=rig), 30
    parted = []
    for command in MOTIONS:
        states = np.stack(list(simulate(model, command, position=0.3).values()), axis=1)
        for start in range(40, command.size - horizon, 83):
            piece, at_s = command[start : start + horizon], start * TICK
            runs = [
                np.stack(
                    [
                        found[name]
                        for name in ("pressure_1", "pressure_2")
                        for found in [
                            simulate(
                                model,
                                piece,
                                initial=states[start],
                                substeps=fineness * SUBSTEPS,
                                start_s=at_s,
                            )
                        ]
                    ]
                )
                for fineness in (1, 2, 4, 32)
            ]
            parted.append([np.abs(run - runs[-1]).max() for run in runs[:-1]])
    coarse, middle, fine = np.median(parted, axis=0)
    assert coarse < 3e3  # a tenth of the transducers' noise
    assert middle < 0.5 * coarse + 1.0
    assert fine < 0.5 * middle + 1.0
    assert np.quantile(parted, 0.9, axis=0)[0] < 1.5e4
