"""The integrator is converged where forward Euler at the loop's period diverges."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from rig.plant import BRISTLE, KARNOPP, NO_FAULT, NOMINAL, Model, Parameters
from rig.plant.dynamics import PlantState, rates, slip_friction
from rig.plant.integrator import SUBSTEPS, TICK
from rig.plant.sensors import DATA_SHEET
from rig.plant.simulation import simulate

Array = NDArray[np.float64]

TIME = np.arange(3000) * TICK
HORIZON = 50

COMMANDS = {
    "the thesis's sine (section 3.2.1)": 3.0 * np.sin(2.0 * np.pi * TIME + 0.1),
    "creeping": 0.6 * np.sin(np.pi * TIME),
    "reversing at speed": 8.0 * np.sin(4.0 * np.pi * TIME),
    "steps": np.repeat(np.random.default_rng(1).uniform(-6.0, 6.0, 15), 200),
}
RIGS = {
    "bristle": NOMINAL,
    "karnopp": NOMINAL._replace(friction_law=KARNOPP),
    "leaking against a spring": NOMINAL._replace(
        spring_stiffness=6e5, spring_contact=0.31, external_leakage_1=5e-9, internal_leakage=4e-9
    ),
}

EACH_LAW = pytest.mark.parametrize("law", [BRISTLE, KARNOPP], ids=["bristle", "karnopp"])


def stacked(run: dict[str, Array]) -> Array:
    """Return a run as (ticks, 9), in the order of `PlantState`."""
    return np.stack([run[name] for name in PlantState._fields], axis=1)


def derivative(state: Array, command: float, parameters: Parameters) -> Array:
    return np.array(rates(*PlantState(*state), command, parameters, NO_FAULT))


def jacobian(field: Callable[[Array], Array], state: Array) -> Array:
    """Return the derivative of a field by central differences, scaled to each state."""
    scale = np.array([1e-6, 1e-3, 1e3, 1e3, 1e-6, 1e-5, 1e-9, 1e3, 1e3])
    columns = [
        (field(state + step) - field(state - step)) / (2.0 * scale[i])
        for i, step in enumerate(np.diag(scale))
    ]
    return np.stack(columns, axis=1)


def sliding(parameters: Parameters, position: float, command: float = 5.0) -> Array:
    """Return the state of a ram extending steadily through `position` (m)."""
    run = simulate(Model(parameters=parameters), np.full(400, command), position=0.01)
    state = stacked(run)[-1]
    state[4] = position
    return state


@pytest.mark.parametrize("rig", RIGS.values(), ids=RIGS.keys())
def test_a_finer_step_changes_short_runs_by_less_than_a_tenth_of_what_the_sensors_see(
    rig: Parameters,
) -> None:
    model = Model(parameters=rig)
    parted = []
    for command in COMMANDS.values():
        run = stacked(simulate(model, command))
        for start in range(100, TIME.size - HORIZON, 97):
            piece = command[start : start + HORIZON]
            coarse = stacked(simulate(model, piece, initial=run[start]))
            fine = stacked(simulate(model, piece, initial=run[start], substeps=16 * SUBSTEPS))
            parted.append(np.abs(coarse - fine).max(axis=0))
    resolution = {
        "pressure_1": DATA_SHEET.pressure_noise,
        "pressure_2": DATA_SHEET.pressure_noise,
        "position": DATA_SHEET.position_resolution,
        "spool": DATA_SHEET.spool_noise,
    }
    # Not every run: where a ram just about sticks or just escapes, any two integrations part, so
    # one horizon in ten may differ by more (docs/model.md).
    typical = dict(zip(PlantState._fields, np.quantile(parted, 0.9, axis=0), strict=True))
    assert all(typical[name] < 0.1 * limit for name, limit in resolution.items()), typical
    rare = dict(zip(PlantState._fields, np.quantile(parted, 0.98, axis=0), strict=True))
    assert all(rare[name] < limit for name, limit in resolution.items()), rare


@EACH_LAW
def test_each_halving_of_the_step_brings_stick_slip_runs_closer(law: float) -> None:
    model = Model(parameters=NOMINAL._replace(friction_law=law))
    command = COMMANDS["the thesis's sine (section 3.2.1)"]
    run = stacked(simulate(model, command))

    def pieces(substeps: int) -> Array:
        starts = range(100, TIME.size - HORIZON, 97)
        return np.array(
            [
                stacked(
                    simulate(model, command[k : k + HORIZON], initial=run[k], substeps=substeps)
                )
                for k in starts
            ]
        )[:, :, 2]

    exact = pieces(32 * SUBSTEPS)
    errors = [np.median(np.abs(pieces(n * SUBSTEPS) - exact).max(axis=1)) for n in (1, 2, 4)]
    assert errors[1] < 0.25 * errors[0]
    assert errors[2] < 0.25 * errors[1]


@EACH_LAW
def test_smooth_motion_is_integrated_to_fourth_order(law: float) -> None:
    model = Model(parameters=NOMINAL._replace(friction_law=law))
    start = sliding(model.parameters, 0.2)
    command = 5.0 + 3.0 * np.sin(40.0 * np.pi * TIME[:60])

    def pressures(substeps: int) -> Array:
        return stacked(simulate(model, command, initial=start, substeps=substeps))[:, 2:4]

    exact = pressures(96)
    errors = np.array([np.abs(pressures(n) - exact).max() for n in (4, 8, 16)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert (orders > 3.7).all(), errors


@EACH_LAW
def test_the_integrator_agrees_with_an_independent_one(law: float) -> None:
    model = Model(parameters=NOMINAL._replace(friction_law=law))
    start = sliding(model.parameters, 0.2)
    command = 6.0 + 2.0 * np.sin(20.0 * np.pi * TIME[:40])
    own = stacked(simulate(model, command, initial=start))
    state = start
    for k in range(command.size - 1):
        solution = solve_ivp(
            lambda _, y, u: derivative(y, u, model.parameters),
            (0.0, TICK),
            state,
            method="LSODA",
            args=(command[k],),
            rtol=1e-9,
            atol=1e-12,
        )
        state = solution.y[:, -1]
    assert own[-1, 2:4] == pytest.approx(state[2:4], abs=0.01 * DATA_SHEET.pressure_noise)
    assert own[-1, 4] == pytest.approx(state[4], abs=1e-3 * DATA_SHEET.position_resolution)


@pytest.mark.parametrize(("position", "growth"), [(0.303, 1.11), (0.02, 1.36)])
def test_forward_euler_at_the_loops_period_amplifies_the_oil_column(
    position: float, growth: float
) -> None:
    rig = NOMINAL._replace(friction_law=KARNOPP)
    state = sliding(rig, position)
    state[:2] = 0.0  # valve at null: no orifice damps the column
    linear = jacobian(lambda y: derivative(y, 0.0, rig), state)
    factors = np.abs(1.0 + TICK * np.linalg.eigvals(linear))
    assert factors.max() == pytest.approx(growth, abs=0.01)


@pytest.mark.parametrize("position", [0.303, 0.02])
def test_the_integrator_damps_the_oil_column_as_the_oil_does(position: float) -> None:
    rig = NOMINAL._replace(friction_law=KARNOPP)
    model = Model(parameters=rig)
    state = sliding(rig, position)

    def one_tick(y: Array) -> Array:
        return stacked(simulate(model, np.full(2, 5.0), initial=y))[1]

    # The bristle-free Karnopp state is a direction, not a number to differentiate by.
    states = [0, 1, 2, 3, 4, 5, 7, 8]
    tick = np.linalg.eigvals(jacobian(one_tick, state)[np.ix_(states, states)])
    linear = jacobian(lambda y: derivative(y, 5.0, rig), state)[np.ix_(states, states)]
    exact = np.exp(TICK * np.linalg.eigvals(linear))
    assert np.abs(tick).max() < 1.0 + 1e-6
    assert np.sort(np.abs(tick)) == pytest.approx(np.sort(np.abs(exact)), abs=2e-3)


def test_forward_euler_at_the_loops_period_diverges_as_a_simulation_and_ours_does_not() -> None:
    rig = NOMINAL._replace(friction_law=KARNOPP)
    start = sliding(rig, 0.1)
    command = np.full(80, 5.0)
    steady = stacked(simulate(Model(parameters=rig), command, initial=start))
    start[2] += 1e4
    ours = stacked(simulate(Model(parameters=rig), command, initial=start))
    euler = start.copy()
    for u in command[1:]:
        euler = euler + TICK * derivative(euler, u, rig)
    assert np.abs(euler[2:4] - steady[-1, 2:4]).max() > 1e6
    assert np.abs(ours[-1, 2:4] - steady[-1, 2:4]).max() < 1e3


def test_the_bristles_keep_to_their_level_at_full_speed_where_they_relax_within_a_step() -> None:
    run = simulate(Model(), np.full(500, 10.0), position=0.05)
    velocity, deflection = run["velocity"][-1], run["friction_state"][-1]
    level = slip_friction(velocity, 1.0, NOMINAL)
    relaxations = NOMINAL.bristle_stiffness * velocity / level * TICK / SUBSTEPS
    assert relaxations > 2.8  # beyond the stability of Runge-Kutta
    assert NOMINAL.bristle_stiffness * deflection == pytest.approx(level, rel=1e-4)
