"""What the tolerant controller sends to the valve: laws that hold at any pressures and leaks."""

from math import isnan, nan, sqrt

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numpy.typing import NDArray

from control.position_loop import COMMAND_LIMIT
from control.tolerant import BLEND_S, FALSE_ALARM_FLOW, TOLERANT_STATE, tolerant_command
from rig.plant import NOMINAL
from rig.plant.dynamics import signed_root, valve_conductance, valve_flows
from rig.plant.integrator import TICK
from rig.plant.parameters import LITRE_PER_MINUTE

Array = NDArray[np.float64]
Leaks = tuple[float, float, float]

SUPPLY = NOMINAL.supply_pressure
HALF_SUPPLY = 0.5 * SUPPLY
FRICTION_DROP = 1.5 * NOMINAL.coulomb / NOMINAL.piston_area
NOTHING: Leaks = (0.0, 0.0, 0.0)
IGNORED: Leaks = (
    FALSE_ALARM_FLOW / sqrt(HALF_SUPPLY),
    FALSE_ALARM_FLOW / sqrt(HALF_SUPPLY),
    FALSE_ALARM_FLOW / sqrt(FRICTION_DROP),
)
"""Coefficients up to which a leak may be a false alarm, and nothing is done."""
GREATEST = 4.0 * LITRE_PER_MINUTE / sqrt(FRICTION_DROP)

commands = st.floats(-COMMAND_LIMIT, COMMAND_LIMIT)
pressures = st.floats(0.0, SUPPLY)
coefficients = st.floats(0.0, GREATEST)
leaks = st.tuples(coefficients, coefficients, coefficients)
real_leaks = st.tuples(st.floats(1e-12, GREATEST), coefficients, coefficients)


def settled(command: float, leaks: Leaks, p1: float, p2: float) -> float:
    """Return the command when the compensation is fully in use: one tick of BLEND_S."""
    state = np.zeros(TOLERANT_STATE)
    return tolerant_command(command, leaks, p1, p2, NOMINAL, COMMAND_LIMIT, BLEND_S, state)


def over_time(command: float, leaks: Leaks, ticks: int, state: Array) -> Array:
    """Return the commands of `ticks` milliseconds at the pressures of a lightly loaded ram."""
    return np.array(
        [
            tolerant_command(command, leaks, 8e6, 6e6, NOMINAL, COMMAND_LIMIT, TICK, state)
            for _ in range(ticks)
        ]
    )


@given(commands, pressures, pressures)
def test_without_a_confirmed_leak_the_command_is_untouched(
    command: float, p1: float, p2: float
) -> None:
    assert settled(command, NOTHING, p1, p2) == command
    assert settled(command, IGNORED, p1, p2) == command


@given(commands, real_leaks, st.floats(0.1 * SUPPLY, 0.9 * SUPPLY), st.floats(-0.8, 0.8))
def test_a_leaking_ram_moves_as_fast_as_a_healthy_one(
    command: float, made_up_for: Leaks, p1: float, load: float
) -> None:
    """Whatever the chambers have drained to; up to what leaks at a drop within the noise."""
    p2 = min(max(p1 - load * SUPPLY, 0.05 * SUPPLY), 0.95 * SUPPLY)
    confirmed = tuple(made_up_for[i] + IGNORED[i] for i in range(3))
    sent = settled(command, (confirmed[0], confirmed[1], confirmed[2]), p1, p2)
    if abs(sent) == COMMAND_LIMIT:
        return
    conductance, gain = valve_conductance(NOMINAL), NOMINAL.valve_gain
    q1, q2 = valve_flows(gain * sent, p1, p2, SUPPLY, 0.0, conductance)
    lost_1 = made_up_for[0] * sqrt(p1)
    lost_2 = made_up_for[1] * sqrt(p2)
    across = made_up_for[2] * signed_root(p1 - p2)
    leaking = 0.5 * (q1 - lost_1 - across + q2 + lost_2 - across)
    drop = SUPPLY - np.sign(command) * (p1 - p2)
    healthy = conductance * gain * command * sqrt(0.5 * drop)
    rounded_off = sqrt(2e4) * (0.5 * (made_up_for[0] + made_up_for[1]) + made_up_for[2])
    assert leaking == pytest.approx(healthy, abs=rounded_off + 1e-12)


@given(commands, pressures, pressures)
def test_the_loops_gain_rises_by_3_db_at_most(command: float, p1: float, p2: float) -> None:
    """Drained chambers ask for a larger opening, never for more than sqrt 2 of it."""
    barely = IGNORED[0] * (1.0 + 1e-12)
    sent = settled(command, (barely, 0.0, 0.0), p1, p2)
    greatest = min(sqrt(2.0) * abs(command), COMMAND_LIMIT)
    assert abs(command) - 1e-9 <= abs(sent) <= greatest + 1e-9


@given(commands, leaks, pressures, pressures)
def test_exchanging_the_chambers_reverses_the_command(
    command: float, confirmed: Leaks, p1: float, p2: float
) -> None:
    mirrored = (confirmed[1], confirmed[0], confirmed[2])
    assert settled(-command, mirrored, p2, p1) == -settled(command, confirmed, p1, p2)


@given(commands, real_leaks, coefficients, pressures, pressures)
def test_a_larger_leak_is_made_up_for_by_a_larger_command(
    command: float, confirmed: Leaks, more: float, p1: float, p2: float
) -> None:
    k_1, k_2, k_12 = (k + i for k, i in zip(confirmed, IGNORED, strict=True))
    some = settled(command, (k_1, k_2, k_12), p1, p2) - 1e-9
    assert settled(command, (k_1 + more, k_2, k_12), p1, p2) >= some
    assert settled(command, (k_1, k_2 + more, k_12), p1, p2) <= some + 2e-9
    towards = settled(command, (k_1, k_2, k_12 + more), p1, p2) - some
    assert towards >= 0.0 if p1 > p2 else towards <= 2e-9


@given(commands, leaks, pressures, pressures)
def test_the_command_stays_within_its_limit(
    command: float, confirmed: Leaks, p1: float, p2: float
) -> None:
    assert abs(settled(command, confirmed, p1, p2)) <= COMMAND_LIMIT


def test_the_compensation_comes_and_goes_without_a_bump() -> None:
    state = np.zeros(TOLERANT_STATE)
    leak = 2.0 * LITRE_PER_MINUTE / sqrt(HALF_SUPPLY)
    blend = round(BLEND_S / TICK)
    before = over_time(1.0, NOTHING, 10, state)
    comes = over_time(1.0, (leak, 0.0, 0.0), 2 * blend, state)
    goes = over_time(1.0, NOTHING, blend + 10, state)
    course = np.concatenate([before, comes, goes])
    made_up = comes[-1] - 1.0
    assert made_up > 0.3
    assert np.abs(np.diff(course)).max() < 1.1 * made_up / blend
    np.testing.assert_array_equal(before, 1.0)
    np.testing.assert_array_equal(goes[-9:], 1.0)


def test_a_changed_estimate_is_taken_over_without_a_bump() -> None:
    state = np.zeros(TOLERANT_STATE)
    small, large = (flow * LITRE_PER_MINUTE / sqrt(HALF_SUPPLY) for flow in (0.5, 2.0))
    first = over_time(1.0, (small, 0.0, 0.0), 2000, state)
    course = over_time(1.0, (large, 0.0, 0.0), 4000, state)
    assert np.abs(np.diff(course)).max() < 2e-3 * (course[-1] - first[-1])


@pytest.mark.parametrize("missing", ["command", "p1", "p2", "leak"])
def test_what_is_not_known_leaves_the_proportional_command(missing: str) -> None:
    values = {"command": 1.0, "p1": 8e6, "p2": 6e6, "leak": 1e-8}
    state = np.zeros(TOLERANT_STATE)

    def sent(**changed: float) -> float:
        at = values | changed
        confirmed = (at["leak"], 1e-8, 0.0)
        return tolerant_command(
            at["command"], confirmed, at["p1"], at["p2"], NOMINAL, COMMAND_LIMIT, TICK, state
        )

    for _ in range(1000):
        sent()
    assert abs(sent() - 1.0) > 0.01
    unknown = sent(**{missing: nan})
    assert isnan(unknown) if missing == "command" else unknown == 1.0
    assert abs(sent() - 1.0) < 0.01
    assert np.isfinite(state).all()
