"""The product filter's prediction is stable, its Jacobian right, and its covariance sound."""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.typing import NDArray

from estimator.product import (
    initial_covariance,
    product_noise,
    product_step,
    start_product,
)
from estimator.product_model import STATE_COUNT, STATES, predict_product
from rig.io.simulated import simulated_rig
from rig.plant import NOMINAL, Model
from rig.plant.sensors import DATA_SHEET
from rig.plant.simulation import simulate

Array = NDArray[np.float64]

NOISE = product_noise(DATA_SHEET, NOMINAL)
SCALE = np.array([1e-5, 1e6, 1e6, 0.1, 0.1, 1e-2, 1e3, 1e-9, 1e-9, 1e-9, 1e-6])


def predicted(x: Array, command: float) -> Array:
    moved = x.copy()
    predict_product(moved, command, NOMINAL, np.empty((6, STATE_COUNT)))
    return moved


def jacobian(x: Array, command: float) -> Array:
    rows = np.empty((6, STATE_COUNT))
    predict_product(x.copy(), command, NOMINAL, rows)
    return np.vstack([rows, np.eye(STATE_COUNT)[6:]])


def differences(x: Array, command: float) -> Array:
    """Return the Jacobian by central differences, extrapolated once (Richardson)."""
    columns = []
    for j in range(STATE_COUNT):
        estimates = []
        for size in (1e-4, 5e-5):
            step = np.zeros(STATE_COUNT)
            step[j] = size * SCALE[j]
            ahead, behind = predicted(x + step, command), predicted(x - step, command)
            estimates.append((ahead - behind) / (2.0 * step[j]))
        columns.append((4.0 * estimates[1] - estimates[0]) / 3.0)
    return np.array(columns).T


def scaled(matrix: Array) -> Array:
    return matrix * SCALE[None, :] / SCALE[:, None]


states = st.builds(
    lambda sign, spool, p1, p2, x, v, w, load, leaks, bias: np.array(
        [sign * spool, p1, p2, x, v, w, load, *leaks, bias]
    ),
    st.sampled_from([-1.0, 1.0]),
    st.floats(2e-5, 2e-4),
    st.floats(3e6, 7e6),
    st.floats(7.2e6, 1.1e7),
    st.floats(0.05, 0.55),
    st.floats(-0.5, 0.5),
    st.floats(-0.01, 0.01),
    st.floats(-5e3, 5e3),
    st.tuples(*[st.floats(0.0, 2e-8)] * 3),
    st.floats(-5e-6, 5e-6),
)


def holding(sign: float) -> float:
    """Return a command that keeps the spool on its side."""
    return 3.0 * sign


def agrees(found: Array, expected: Array) -> bool:
    return bool(np.allclose(scaled(found), scaled(expected), rtol=2e-4, atol=1e-7))


@given(states)
def test_the_jacobian_is_the_derivative_of_the_prediction(x: Array) -> None:
    command = holding(np.sign(x[0]))
    assert agrees(jacobian(x, command), differences(x, command))


@given(states, st.data())
def test_an_entry_wrong_by_one_per_cent_would_be_noticed(x: Array, data: Any) -> None:
    command = holding(np.sign(x[0]))
    right = jacobian(x, command)
    rows, columns = np.nonzero(np.abs(scaled(right)[:6]) > 1e-4)
    k = data.draw(st.integers(0, rows.size - 1))
    wrong = right.copy()
    wrong[rows[k], columns[k]] *= 1.01
    assert not agrees(wrong, differences(x, command))


@pytest.mark.parametrize("position", [0.02, 0.15, 0.3, 0.59])
def test_the_prediction_does_not_grow_where_forward_euler_does(position: float) -> None:
    x = np.zeros(STATE_COUNT)
    x[1:4] = 6.9e6, 6.9e6, position
    growth = np.abs(np.linalg.eigvals(scaled(jacobian(x, 0.0)))).max()
    assert growth < 1.0 + 1e-6


@given(states)
def test_the_units_of_the_prediction_hold(x: Array) -> None:
    """A rig measured in other units of length, mass and time is predicted alike.

    Dimensional similarity: an equation that dropped an area, a density or a square root would not
    scale. One tick stays one millisecond, so that time is not scaled.
    """
    length, mass = 10.0, 7.0
    pressure = mass / length
    unit = np.array([length, pressure, pressure, length, length, length, mass * length,
                     *[length**3 / pressure**0.5] * 3, length])  # fmt: skip
    par = NOMINAL._replace(
        piston_area=NOMINAL.piston_area * length**2,
        moving_mass=NOMINAL.moving_mass * mass,
        stroke_min=NOMINAL.stroke_min * length,
        stroke_max=NOMINAL.stroke_max * length,
        line_volume_1=NOMINAL.line_volume_1 * length**3,
        line_volume_2=NOMINAL.line_volume_2 * length**3,
        bulk_modulus=NOMINAL.bulk_modulus * pressure,
        density=NOMINAL.density * mass / length**3,
        supply_pressure=NOMINAL.supply_pressure * pressure,
        return_pressure=NOMINAL.return_pressure * pressure,
        area_gradient=NOMINAL.area_gradient * length,
        valve_gain=NOMINAL.valve_gain * length,
    )
    assume(abs(x[1] - x[2]) > 1e6)
    command = holding(np.sign(x[0]))
    moved = x * unit
    predict_product(moved, command, par, np.empty((6, STATE_COUNT)))
    # The smoothing of roots near zero drop, 10 kPa wide, is the one scale that is not the rig's.
    assert moved == pytest.approx(predicted(x, command) * unit, rel=2e-4, abs=1e-9)


def measured(ticks: int, seed: int) -> tuple[Array, Array]:
    """Return commands and readings (position, p1, p2, spool) of a sound rig in a sine."""
    command = 3.0 * np.sin(np.pi * np.arange(ticks) * 1e-3)
    truth = simulate(Model(), command)
    noise = simulated_rig(Model(), seed).noise(ticks)
    readings = np.column_stack(
        [
            np.round(truth["position"] / 3e-5) * 3e-5,
            truth["pressure_1"] + 3e4 * noise[:, 1],
            truth["pressure_2"] + 3e4 * noise[:, 2],
            truth["spool"] + 1e-6 * noise[:, 3],
        ]
    )
    return command, readings


def filtered(command: Array, readings: Array) -> tuple[Array, Array, Array]:
    """Return states, outputs and the last covariance."""
    x, covariance = np.zeros(STATE_COUNT), initial_covariance(Model())
    work = np.zeros((13, STATE_COUNT))
    start_product(x, *readings[0], command[0], NOMINAL)  # type: ignore[call-arg]
    states_, outputs = np.empty((command.size, STATE_COUNT)), np.full((command.size, 9), np.nan)
    states_[0] = x
    for k in range(1, command.size):
        product_step(  # type: ignore[call-arg]
            x, covariance, command[k - 1], *readings[k], NOMINAL, NOISE, work, outputs[k]
        )
        states_[k] = x
    return states_, outputs, covariance


@pytest.fixture(scope="module")
def sound() -> tuple[Array, Array, Array]:
    return filtered(*measured(20000, 1))


def test_innovations_stay_within_what_the_filter_expects(
    sound: tuple[Array, Array, Array],
) -> None:
    """On a rig as modelled the model-error budget is not used up: their ratio is below one."""
    _, outputs, _ = sound
    settled = outputs[2000:]
    ratio = np.mean(settled[:, :3] ** 2 / settled[:, 6:9], axis=0)
    assert np.all(ratio > 0.3)
    assert np.all(ratio < 1.1)


def test_the_covariance_stays_symmetric_and_positive(sound: tuple[Array, Array, Array]) -> None:
    covariance = scaled_covariance(sound[2])
    assert np.array_equal(sound[2], sound[2].T)
    assert np.linalg.eigvalsh(covariance).min() > 0.0


def scaled_covariance(covariance: Array) -> Array:
    return covariance / np.outer(SCALE, SCALE)


def test_a_sound_rig_has_no_leaks_and_no_bias(sound: tuple[Array, Array, Array]) -> None:
    states_, _, _ = sound
    last = states_[15000:].mean(axis=0)
    leaks = last[7:10] * 6e4 * np.sqrt(6.9e6)
    assert np.abs(leaks).max() < 0.05
    assert abs(last[STATES.index("null_bias_m")]) < 1e-6


def test_missing_readings_are_skipped_and_recovered_from() -> None:
    command, readings = measured(4000, 2)
    gap = readings.copy()
    gap[1500:1600] = np.nan
    states_, outputs, _ = filtered(command, gap)
    whole, _, _ = filtered(command, readings)
    assert np.isfinite(states_).all()
    assert np.isnan(outputs[1500:1600, :6]).all()
    assert states_[-1, 1:4] == pytest.approx(whole[-1, 1:4], rel=0.01)


def test_a_dry_chamber_teaches_nothing_about_leaks() -> None:
    command, readings = measured(4000, 3)
    dry = readings.copy()
    dry[2000:3000, 2] = 1e4
    states_, _, covariance = filtered(command, dry)
    leak_1, leak_2 = states_[3500, 7] * 6e4 * 2627, states_[3500, 8] * 6e4 * 2627
    assert abs(leak_1) < 0.3
    assert abs(leak_2) < 0.3
    assert np.linalg.eigvalsh(scaled_covariance(covariance)).min() > 0.0
