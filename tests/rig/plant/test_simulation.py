"""A run is repeatable, starts where it is to start, and refuses inputs that do not fit."""

import numpy as np
import pytest

from rig.plant import FAULT_COLUMNS, NO_FAULT, NOMINAL, Model
from rig.plant.dynamics import PlantState, rest_state
from rig.plant.simulation import simulate

COMMAND = 3.0 * np.sin(np.arange(400) * 0.02)


def test_the_same_run_twice_gives_the_same_bits() -> None:
    first, second = simulate(Model(), COMMAND), simulate(Model(), COMMAND)
    assert list(first) == list(PlantState._fields)
    assert all((first[name] == second[name]).all() for name in first)


def test_a_run_continued_is_the_run_in_one_piece() -> None:
    whole = simulate(Model(), COMMAND)
    middle = np.array([whole[name][200] for name in PlantState._fields])
    rest = simulate(Model(), COMMAND[200:], initial=middle)
    assert all((whole[name][200:] == rest[name]).all() for name in whole)


def test_a_run_starts_at_rest_where_asked() -> None:
    run = simulate(Model(), COMMAND, position=0.2)
    start = rest_state(NOMINAL, 0.2)
    assert [run[name][0] for name in PlantState._fields] == start.tolist()
    assert simulate(Model(), np.zeros(50), position=0.2)["position"] == pytest.approx(0.2)


def test_a_fault_acts_from_the_tick_it_is_injected_at() -> None:
    faults = np.tile(NO_FAULT, (COMMAND.size, 1))
    faults[150:, FAULT_COLUMNS.index("external_leakage_1")] = 5e-9
    healthy, leaking = simulate(Model(), COMMAND), simulate(Model(), COMMAND, faults=faults)
    assert (healthy["pressure_1"][:151] == leaking["pressure_1"][:151]).all()
    assert (healthy["pressure_1"][151:] > leaking["pressure_1"][151:])[:5].all()


def test_a_fault_table_of_another_length_is_refused() -> None:
    with pytest.raises(ValueError, match="does not match 400 ticks of 8 coefficients"):
        simulate(Model(), COMMAND, faults=np.zeros((399, 8)))


def test_a_state_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="the plant has 9 states"):
        simulate(Model(), COMMAND, initial=np.zeros(6))
