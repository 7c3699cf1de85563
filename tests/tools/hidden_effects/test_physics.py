"""The independent rig: that it is one, that it is integrated well, and that it behaves."""

import ast
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from tools.hidden_effects import physics
from tools.hidden_effects.recordings import at_rest
from tools.hidden_effects.rig_values import TABLE, RigValues

pytestmark = pytest.mark.long

Array = NDArray[np.float64]
SIMULATOR = (
    "physics", "rig_values", "menu", "forms", "off_menu", "motions", "recordings", "sizes",
    "drawn_trials",
)  # fmt: skip
FOLDER = Path(physics.__file__).parent


def ran(
    values: RigValues,
    command: Array,
    states: Array | None = None,
    steps: int = physics.STEPS,
    gain: float = 0.0,
) -> tuple[Array, Array]:
    """Return readings without noise and states; with a gain, `command` is the setpoint."""
    n = len(command)
    start = at_rest(values, 0.3) if states is None else states.copy()
    closed = gain > 0.0
    setpoint, feed = (command, np.zeros(n)) if closed else (np.zeros(n), command)
    quiet = np.zeros((n, 3))
    return physics.run(
        values, setpoint, feed, np.full(n, gain), 0, 0, quiet, np.zeros(n), start, steps
    )


@pytest.mark.parametrize("module", SIMULATOR)
def test_the_simulator_imports_nothing_of_the_product(module: str) -> None:
    tree = ast.parse((FOLDER / f"{module}.py").read_text())
    imported = {
        name
        for node in ast.walk(tree)
        for name in (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import)
            else [node.module or ""]
            if isinstance(node, ast.ImportFrom)
            else []
        )
    }
    own = {name for name in imported if name.startswith("tools.")}
    assert all(name.startswith("tools.hidden_effects") for name in own)
    assert {name.split(".")[0] for name in imported}.isdisjoint(
        ("rig", "control", "estimator", "faults")
    )


@pytest.mark.parametrize("volts", [4.0, -0.6])
@pytest.mark.parametrize(
    "values",
    [
        TABLE,
        TABLE._replace(underlap=1e-5, tank_rise=5e12, pump_droop=5e12, leak_across=5e-9),
        TABLE._replace(spring=5e4, spring_contact=0.25, air=0.02, ram_mass=60.0),
    ],
    ids=["nothing hidden", "valve and lines", "spring and air"],
)
def test_it_is_integrated_as_radau_does(values: RigValues, volts: float) -> None:
    # From standstill through presliding and break-away into sliding, and by release into stopping.
    command = np.r_[np.full(60, volts), np.zeros(60)]
    _, found = ran(values, command)

    def rates(time: float, states: Array, reference: float) -> Array:
        out = np.empty(len(states))
        physics.slopes(values, time, reference, states, out)
        return out

    states, exact = at_rest(values, 0.3), []
    for part in range(2):
        span = (0.06 * part, 0.06 * (part + 1))
        solved = solve_ivp(
            rates, span, states, method="Radau", rtol=1e-8, atol=1e-10,
            t_eval=np.linspace(*span, 61), args=(values.spool_per_volt * command[60 * part],),
        )  # fmt: skip
        exact.append(solved.y[:, :60].T)
        states = solved.y[:, -1]
    difference = np.abs(found - np.concatenate(exact)).max(axis=0)
    assert difference[physics.POSITION] < 1e-7
    assert difference[physics.SPOOL] < 1e-10
    assert difference[[physics.P1, physics.P2]].max() < 500.0
    assert np.ptp(found[:, physics.POSITION]) > 1e-5


def test_halving_the_step_changes_nothing_that_a_sensor_shows() -> None:
    time = np.arange(400) * physics.TICK
    command = 4.0 * np.sin(2.0 * np.pi * 5.0 * time)
    _, coarse = ran(TABLE, command)
    _, fine = ran(TABLE, command, steps=2 * physics.STEPS)
    assert np.abs(coarse - fine)[:, physics.POSITION].max() < 1e-6
    assert np.abs(coarse - fine)[:, [physics.P1, physics.P2]].max() < 3e3


def test_full_command_moves_the_oil_that_the_thesis_needs() -> None:
    _, found = ran(TABLE, np.full(400, 10.0))
    litres = found[-1, physics.SPEED] * TABLE.ram_area * 6e4
    assert 22.0 < litres < 26.6


def test_it_stands_still_when_nothing_is_asked() -> None:
    readings, found = ran(TABLE, np.zeros(500))
    assert np.ptp(found[:, physics.POSITION]) < 1e-9
    assert np.all(readings[:, 1] == readings[0, 1])


def test_it_breaks_away_at_its_stiction_and_slides_with_less() -> None:
    _, found = ran(TABLE, np.full(2000, 0.05))
    force = TABLE.ram_area * (found[:, physics.P1] - found[:, physics.P2])
    assert force.max() == pytest.approx(TABLE.break_away, rel=0.05)
    _, found = ran(TABLE, np.full(600, 4.0))
    speed = found[-1, physics.SPEED]
    level = TABLE.sliding + TABLE.drag * speed
    slip = (TABLE.break_away - TABLE.sliding) * np.exp(-speed / TABLE.stribeck)
    force = TABLE.ram_area * (found[-1, physics.P1] - found[-1, physics.P2])
    assert force == pytest.approx(level + slip, rel=1e-3)


def test_a_stroke_end_holds_it_with_full_supply_pressure() -> None:
    _, found = ran(TABLE, np.full(1500, 10.0))
    depth = TABLE.ram_area * TABLE.pump_pressure / TABLE.stop_stiffness
    assert found[-1, physics.POSITION] - TABLE.stroke_high == pytest.approx(depth, rel=0.2)


def test_closed_chambers_keep_their_oil() -> None:
    # Struck with the valve shut: what one chamber loses in volume is what the other gains.
    states = at_rest(TABLE, 0.3)
    states[physics.SPEED] = 0.05
    _, found = ran(TABLE, np.zeros(200), states)
    for pressure, side in ((physics.P1, 1.0), (physics.P2, -1.0)):
        start = 0.3 if side > 0.0 else 0.3069
        volume = TABLE.dead_volume + TABLE.ram_area * (
            start + side * (found[:, physics.POSITION] - 0.3)
        )
        oil = volume * np.exp(found[:, pressure] / TABLE.oil_stiffness)
        assert np.ptp(oil) / oil[0] < 1e-6


def test_a_restart_goes_on_as_the_run_did() -> None:
    time = np.arange(300) * physics.TICK
    command = np.rint(3e6 * np.sin(2.0 * np.pi * 3.0 * time)) * 1e-6
    values = TABLE._replace(dead_time=4.3e-3)
    _, whole = ran(values, command)
    quiet = np.zeros((300, 3))
    _, again = physics.run(
        values, np.zeros(300), command, np.zeros(300), 120, 0, quiet, np.zeros(300),
        whole[120].copy(), physics.STEPS,
    )  # fmt: skip
    assert again[120:] == pytest.approx(whole[120:], rel=1e-9, abs=1e-12)


def test_a_leak_that_opens_changes_nothing_before_and_is_one_that_was_there_after() -> None:
    wave = 2.0 * np.sin(0.012 * np.arange(200))
    opens = 100
    tight, _ = ran(TABLE, wave)
    opening = TABLE._replace(opens_at=1e-3 * opens + 1e-9, opening_leak_1=4e-9)
    leaking, truth = ran(opening, wave)
    assert np.array_equal(tight[: opens + 1, :4], leaking[: opens + 1, :4])
    assert np.abs(tight[-50:, 2] - leaking[-50:, 2]).min() > 1e4
    always, _ = ran(TABLE._replace(leak_1=4e-9), wave[opens:], truth[opens])
    # The spool's reference is where it was; the rest is the same rig.
    assert np.abs(always[:, 2] - leaking[opens:, 2]).max() < 500.0
