"""Rigs in lanes move and measure as each does alone."""

from typing import Final

import numpy as np
import pytest
from numpy.typing import NDArray

from control.position_loop import COMMAND_LIMIT, POSITION_GAIN
from rig.lanes import LANES
from rig.loop.lane_ticks import LANE_READINGS
from rig.plant import KARNOPP, NO_FAULT, NOMINAL, REMEMBERING, FaultInput, Parameters
from rig.plant.added_terms import AddedTerm, fields_of
from rig.plant.dynamics import PlantState, rest_state
from rig.plant.integrator import TICK, advance
from rig.plant.sensors import DATA_SHEET
from tools.simulated.drawn_rigs import drawn_rig
from tools.simulated.lanes import SimulatedLanes

Array = NDArray[np.float64]

SILENT: Final = DATA_SHEET._replace(pressure_noise=0.0, spool_noise=0.0, supply_pressure_noise=0.0)
TICKS: Final = 3000
ONSET: Final = 1000
STATES: Final = ("position", "pressure_1", "pressure_2", "spool", "supply_pressure")
TERMS: Final = (
    (),
    (
        AddedTerm("force balance", "position", "wave", False, 200.0, 0.02, 0.3),
        AddedTerm("force balance", "position", "bump", True, 300.0, 0.3, 0.05),
        AddedTerm("spool", "command", "x |x|", False, 1e-7),
    ),
    (
        AddedTerm("spool", "command", "hinge", False, 1e-6, 0.5),
        AddedTerm(
            "force balance",
            "velocity",
            "table",
            False,
            1.0,
            knots=((-0.3, -90.0), (0.0, 0.0), (0.05, 40.0), (0.4, 60.0)),
        ),
        AddedTerm(
            "flow, chamber 1",
            "pressure 1",
            "table",
            False,
            1.0,
            knots=tuple((1e6 * k, -1e-8 * k * k) for k in range(9)),
        ),
    ),
    (
        AddedTerm("flow, chamber 1", "pressure difference", "|x|", True, 1e-12),
        AddedTerm("leak across the piston", "velocity", "x^2", False, 1e-8),
        AddedTerm("valve edges", "spool opening", "bump", False, 2e-6, 0.0, 1e-5),
    ),
    (),
)


def unlike_rigs(law: float = 0.0) -> list[Parameters]:
    """Return rigs with air, springs, droop, terms and other friction, each in some lanes."""
    rng = np.random.default_rng(5)
    return [
        drawn_rig(rng)._replace(
            friction_law=law,
            entrained_air=0.005 * (lane % 2),
            spring_stiffness=2e4 * (lane % 3 == 0),
            supply_droop=1e12 * (lane % 4 == 1),
            return_back_pressure=1e12 * (lane % 4 == 2),
            valve_deadband=3e-6 * (lane % 4 == 3),
            valve_underlap_leakage=3e-6 * (lane % 5 == 1),
            valve_flow_asymmetry=0.1 * (lane % 3 == 1),
            valve_rate_limit=0.05 if lane % 4 == 1 else 1e3,
            constant_force=500.0 * (lane % 2),
            payload_mass=50.0 * (lane % 3 == 2),
            stop_high=0.5 if lane % 5 == 2 else 5.0,
            **fields_of(TERMS[lane % len(TERMS)]),
        )
        for lane in range(LANES)
    ]


def unlike_motions() -> tuple[Array, Array]:
    """Return slow and fast sines, steps, open loops, a stroke end that is struck, a standstill."""
    t = np.arange(TICKS) * TICK
    closed = [
        0.3 + 0.15 * np.sin(2.0 * t),
        np.where(np.sin(5.0 * t) > 0.0, 0.15, 0.45),
        np.full(TICKS, 0.4),
        0.3 + 0.02 * np.sin(20.0 * t),
        np.full(TICKS, 0.62),
    ]
    opened = [3.0 * np.sin(5.0 * t), 8.0 * np.sin(9.0 * t), np.where(t < 1.0, -9.0, 9.0)]
    setpoint = np.stack([(closed + opened)[lane % 8] for lane in range(LANES)], axis=1)
    is_open = np.array([1.0 if lane % 8 >= len(closed) else 0.0 for lane in range(LANES)])
    return setpoint, np.tile(is_open, (TICKS, 1))


def alone(
    rig: Parameters, state: Array, setpoint: Array, is_open: bool, fault: FaultInput
) -> Array:
    """Return the states (ticks, 9) of one rig by the plant's own step."""
    states = np.empty((setpoint.size, state.size))
    for k, asked in enumerate(setpoint):
        states[k] = state
        counts = np.floor(state[4] / SILENT.position_resolution + 0.5)
        error = asked - counts * SILENT.position_resolution
        command = asked if is_open else POSITION_GAIN * error
        command = min(max(command, -COMMAND_LIMIT), COMMAND_LIMIT)
        advance(state, command, rig, tuple(fault))
    return states


@pytest.mark.parametrize("law", [0.0, KARNOPP])
def test_every_lane_follows_the_plant_from_wherever_it_is(law: float) -> None:
    """Over five ticks at a time: sticking and slipping multiplies rounding errors without end."""
    rigs, (setpoint, is_open) = unlike_rigs(law), unlike_motions()
    leak = NO_FAULT._replace(internal_leakage=2e-9)
    faults = [leak if lane % 2 else NO_FAULT for lane in range(LANES)]
    courses = [
        alone(rigs[i], rest_state(rigs[i], 0.3), setpoint[:, i], bool(is_open[0, i]), faults[i])
        for i in range(LANES)
    ]
    lanes = SimulatedLanes(rigs, range(LANES), [0.3] * LANES, faults=faults, sensors=SILENT)
    columns = [PlantState._fields.index(name) for name in STATES]
    scale = np.array([3e-5, 1e4, 1e4, 1e-6, 1e4])
    for first in range(0, TICKS - 5, 97):
        part = slice(first, first + 5)
        lanes.plant[:] = np.stack([course[first] for course in courses], axis=1)
        found = lanes.advance(setpoint[part], is_open[part])[:, : len(STATES)]
        expected = np.stack([course[part][:, columns] for course in courses], axis=2)
        expected[:, 0] = np.floor(expected[:, 0] / 3e-5 + 0.5) * 3e-5
        expected[:, 1:3] = np.maximum(expected[:, 1:3], 0.0)
        assert np.abs((found - expected) / scale[:, None]).max() < 1e-3


def run(rigs: list[Parameters], seeds: list[int], batch: int) -> Array:
    setpoint, is_open = unlike_motions()
    leaks = [NO_FAULT._replace(external_leakage_1=1e-9)] * LANES
    lanes = SimulatedLanes(
        rigs, seeds, [0.3] * LANES, faults=leaks, onsets=list(range(0, 100 * LANES, 100))
    )
    batches = range(0, TICKS, batch)
    parts = [lanes.advance(setpoint[k : k + batch], is_open[k : k + batch]) for k in batches]
    return np.concatenate(parts)


def test_a_lane_knows_neither_its_neighbours_nor_the_batches() -> None:
    rigs, seeds = unlike_rigs(), list(range(LANES))
    first = run(rigs, seeds, 3000)
    assert np.array_equal(first, run(rigs, seeds, 701))
    others = [rigs[0], *(rig._replace(supply_leakage=1e-9) for rig in rigs[1:])]
    assert np.array_equal(first[:, :, 0], run(others, [0, *range(50, 49 + LANES)], 3000)[:, :, 0])


def test_a_fault_acts_from_its_onset_on() -> None:
    rigs = [NOMINAL] * LANES
    leaking = NO_FAULT._replace(external_leakage_1=1e-8)
    faults = [NO_FAULT, *[leaking] * (LANES - 1)]
    lanes = SimulatedLanes(
        rigs, [0] * LANES, [0.3] * LANES, faults=faults, onsets=[ONSET] * LANES, sensors=SILENT
    )
    setpoint = np.full((2000, LANES), 0.3)
    pressure = lanes.advance(setpoint, np.zeros_like(setpoint))[:, 1]
    assert np.array_equal(pressure[: ONSET + 1, 0], pressure[: ONSET + 1, 1])
    assert (pressure[ONSET + 1 :, 1] < pressure[ONSET + 1 :, 0]).all()


def test_sensors_are_as_noisy_as_their_data_sheets_say() -> None:
    rigs = [NOMINAL] * LANES
    setpoint = np.full((4000, LANES), 0.3)
    readings = SimulatedLanes(rigs, range(LANES), [0.3] * LANES).advance(setpoint, 0.0 * setpoint)
    spread = readings[2000:].std(axis=0)
    noise = {"pressure_1_Pa": 3e4, "pressure_2_Pa": 3e4, "spool_m": 1e-6, "supply_pressure_Pa": 3e4}
    for name, sigma in noise.items():
        assert spread[LANE_READINGS.index(name)] == pytest.approx(np.full(LANES, sigma), rel=0.1)
    counts = readings[:, 0] / DATA_SHEET.position_resolution
    assert counts == pytest.approx(np.round(counts), abs=1e-6)


def test_what_does_not_fit_the_lanes_is_refused() -> None:
    with pytest.raises(ValueError, match="rigs: 1 given"):
        SimulatedLanes([NOMINAL], [0], [0.3])
    mixed = [NOMINAL._replace(friction_law=KARNOPP), *[NOMINAL] * (LANES - 1)]
    with pytest.raises(ValueError, match="friction law"):
        SimulatedLanes(mixed, range(LANES), [0.3] * LANES)


@pytest.mark.parametrize("field", REMEMBERING)
def test_rigs_in_lanes_with_a_memory_are_refused(field: str) -> None:
    rigs = [NOMINAL] * (LANES - 1) + [NOMINAL._replace(**{field: 1e-5})]
    with pytest.raises(ValueError, match=f"rigs: {field} of rig {LANES - 1}"):
        SimulatedLanes(rigs, range(LANES), [0.3] * LANES)
