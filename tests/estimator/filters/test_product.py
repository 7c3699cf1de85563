"""The product filter's prediction is stable, its Jacobian right, its steps are the textbook's."""

from typing import Any

import numpy as np
import pytest
from hypothesis import assume, given, strategies as st
from numpy.typing import NDArray

from estimator.filters.product_model import STATE_COUNT, STATES, predict_product
from estimator.filters.product_noise import product_noise
from estimator.filters.registry import FilterRun, run_filter
from rig.io.simulated import simulated_rig
from rig.plant import NOMINAL, Model, Parameters
from rig.plant.sensors import DATA_SHEET
from rig.plant.simulation import simulate
from tests.estimator.product_reference import DenseFilter

Array = NDArray[np.float64]

SUPPLY = NOMINAL.supply_pressure
SCALE = np.array([1e-5, 1e6, 1e6, 0.1, 0.1, 1e-2, 1e3, 1e-9, 1e-9, 1e-9, 1e-6])


def predicted(x: Array, command: float, par: Parameters = NOMINAL) -> Array:
    moved = x.copy()
    predict_product(moved, command, SUPPLY, par, np.empty((6, STATE_COUNT)))
    return moved


def jacobian(x: Array, command: float, par: Parameters = NOMINAL) -> Array:
    rows = np.empty((6, STATE_COUNT))
    predict_product(x.copy(), command, SUPPLY, par, rows)
    return np.vstack([rows, np.eye(STATE_COUNT)[6:]])


def differences(x: Array, command: float, par: Parameters = NOMINAL) -> Array:
    """Return the Jacobian by central differences, extrapolated once (Richardson)."""
    columns = []
    for j in range(STATE_COUNT):
        estimates = []
        for size in (1e-4, 5e-5):
            step = np.zeros(STATE_COUNT)
            step[j] = size * SCALE[j]
            ahead, behind = predicted(x + step, command, par), predicted(x - step, command, par)
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


@given(states, st.sampled_from([0.0, 0.005, 0.05]))
def test_the_jacobian_is_the_derivative_of_the_prediction(x: Array, air: float) -> None:
    command, par = holding(np.sign(x[0])), NOMINAL._replace(entrained_air=air)
    assert agrees(jacobian(x, command, par), differences(x, command, par))


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
    predict_product(moved, command, par.supply_pressure, par, np.empty((6, STATE_COUNT)))
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


def filtered(command: Array, readings: Array) -> FilterRun:
    time_s = np.arange(command.size, dtype=np.float64) * 1e-3
    return run_filter(time_s, command, readings, Model())


@pytest.fixture(scope="module")
def sound() -> FilterRun:
    return filtered(*measured(20000, 1))


def test_a_sound_rig_has_no_leaks_and_no_bias(sound: FilterRun) -> None:
    last = sound.states[15000:].mean(axis=0)
    leaks = last[7:10] * 6e4 * np.sqrt(6.9e6)
    assert np.abs(leaks).max() < 0.05
    assert abs(last[STATES.index("null_bias_m")]) < 1e-6


def test_it_is_the_textbook_filter_in_factors() -> None:
    """States, covariance and innovation variances, with gaps, no spool and a dry chamber."""
    command, readings = measured(1500, 4)
    readings[300:500, 3] = np.nan
    readings[600:620] = np.nan
    readings[800:900, 2] = 1e4
    run = filtered(command, readings)
    dense = DenseFilter(readings[0], NOMINAL, product_noise(DATA_SHEET, NOMINAL))
    for k in range(1, command.size):
        dense.predict(command[k - 1], SUPPLY)
        assert run.outputs[k, 6] == pytest.approx(dense.P[3, 3] + dense.noise.position, rel=1e-9)
        dense.correct(readings[k])
        deviation = np.sqrt(np.diag(dense.P))
        assert np.abs((run.states[k] - dense.x) / deviation).max() < 1e-7
    assert np.abs((run.covariance - dense.P) / np.outer(deviation, deviation)).max() < 1e-7
    assert run.reset_times_s.size == 0


def test_missing_readings_are_skipped_and_recovered_from() -> None:
    command, readings = measured(4000, 2)
    gap = readings.copy()
    gap[1500:1600] = np.nan
    run, whole = filtered(command, gap), filtered(command, readings)
    assert np.isfinite(run.states).all()
    assert np.isnan(run.outputs[1500:1600, :6]).all()
    assert run.states[-1, 1:4] == pytest.approx(whole.states[-1, 1:4], rel=0.01)


OUT_OF_RANGE = [(0, 0.7), (0, -0.05), (1, 2.07e7), (1, -6e5), (2, np.inf), (3, 4e-4), (3, -np.inf)]


@pytest.mark.parametrize(("column", "value"), OUT_OF_RANGE)
def test_readings_out_of_range_count_as_missing(column: int, value: float) -> None:
    command, readings = measured(400, 2)
    wrong, missing = readings.copy(), readings.copy()
    wrong[200:300, column], missing[200:300, column] = value, np.nan
    assert np.array_equal(filtered(command, wrong).states, filtered(command, missing).states)


def test_a_dry_chamber_teaches_nothing_about_leaks() -> None:
    command, readings = measured(4000, 3)
    dry = readings.copy()
    dry[2000:2400, 2] = 1e4
    run = filtered(command, dry)
    leak_1, leak_2 = run.states[3500, 7] * 6e4 * 2627, run.states[3500, 8] * 6e4 * 2627
    assert abs(leak_1) < 0.3
    assert abs(leak_2) < 0.3


def innovations_at_low_supply(assumed: float, sampled: bool) -> float:
    """Return the rms of pressure innovations, Pa, on a rig with 10 MPa."""
    ticks = 6000
    command = 3.0 * np.sin(np.pi * np.arange(ticks) * 1e-3)
    truth = simulate(Model(parameters=NOMINAL._replace(supply_pressure=10e6)), command)
    columns = [truth[name] for name in ("position", "pressure_1", "pressure_2", "spool")]
    supply = np.full(ticks, 10e6 if sampled else np.nan)
    supply[2000:3000] = np.nan
    model = Model(parameters=NOMINAL._replace(supply_pressure=assumed))
    readings = np.column_stack([*columns, supply])
    run = run_filter(np.arange(ticks, dtype=np.float64) * 1e-3, command, readings, model)
    return float(np.sqrt(np.mean(run.innovation[1000:, 1:] ** 2)))


def test_a_measured_supply_pressure_is_the_one_it_predicts_with() -> None:
    """For a second the transducer gives nothing: its last reading holds."""
    known = innovations_at_low_supply(10e6, sampled=False)
    assert innovations_at_low_supply(13.8e6, sampled=True) == pytest.approx(known, rel=0.02)
    assert innovations_at_low_supply(13.8e6, sampled=False) > 1.2 * known
