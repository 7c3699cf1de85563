"""Whatever start, dropout, stroke end or valve: finite estimates, D above zero, and it recovers."""

import numpy as np
import pytest
from hypothesis import example, given, settings, strategies as st
from numpy.typing import NDArray

from estimator.filters.product_model import STATE_COUNT
from estimator.filters.registry import FilterRun, run_filter
from rig.io.simulated import simulated_rig
from rig.plant import NOMINAL, Model
from rig.plant.sensors import DATA_SHEET
from rig.plant.simulation import simulate
from tests.estimator.product_starts import from_start

Array = NDArray[np.float64]

TO_LITRES = 6e4 * np.sqrt(0.5 * NOMINAL.supply_pressure)


def sampled(command: Array, seed: int = 1, model: Model | None = None) -> tuple[Array, Array]:
    """Return readings (position, p1, p2, spool, supply) of a rig in open loop, and its truth."""
    truth = simulate(model or Model(), command, position=0.3)
    noise = simulated_rig(Model(), seed).noise(command.size)
    true = np.column_stack([truth[name] for name in ("position", "pressure_1", "pressure_2",
                                                     "spool", "velocity")])  # fmt: skip
    readings = true + np.array([0.0, 3e4, 3e4, 1e-6, 0.0]) * noise[:, :5]
    readings[:, 0] = np.round(true[:, 0] / 3e-5) * 3e-5
    readings[:, 1:3] = np.clip(readings[:, 1:3], 0.0, DATA_SHEET.pressure_max)
    readings[:, 4] = NOMINAL.supply_pressure + 3e4 * noise[:, 4]
    return readings, true


def sine(ticks: int, volts: float = 3.0, hertz: float = 0.5) -> Array:
    return volts * np.sin(2.0 * np.pi * hertz * np.arange(ticks) * 1e-3)


def filtered(command: Array, readings: Array, model: Model | None = None) -> FilterRun:
    time_s = np.arange(command.size, dtype=np.float64) * 1e-3
    return run_filter(time_s, command, readings, model or Model())


@pytest.fixture(scope="module")
def motion() -> tuple[Array, Array, Array, Array]:
    """Command, readings, truth and the states of the filter that starts right."""
    command = sine(10000)
    readings, truth = sampled(command)
    return command, readings, truth, filtered(command, readings).states


LOW = np.array([-4e-4, 0.0, 0.0, 0.0, -1.0, -0.1, -8e3, 0.0, 0.0, 0.0, -2e-5])
HIGH = np.array([4e-4, 1.38e7, 1.38e7, 0.6069, 1.0, 0.1, 8e3, 3e-8, 3e-8, 3e-8, 2e-5])

places = st.lists(st.floats(0.0, 1.0), min_size=STATE_COUNT, max_size=STATE_COUNT)


@settings(max_examples=12)
@given(places, st.sampled_from([1e-12, 1e-6, 1.0, 1e4]))
@example([0.9375, 0.0, 0.390625, 0.0, 0.140625, 0.375, 0.1875, 0.5, 0.0, 0.5, 0.25], 1e-12)
@example([0.61, 0.0, 0.89, 0.0, 0.0, 0.41, 0.25, 0.25, 0.0, 0.0, 0.08], 1e-12)
def test_it_recovers_from_any_start(
    motion: tuple[Array, Array, Array, Array], place: list[float], variance: float
) -> None:
    """After 10 s position and pressures are right; leaks, traded for a null bias, come right.

    A filter that is sure of a wrong start takes both external leaks and a null bias for each other,
    and forgets them over tens of seconds.
    """
    command, readings, truth, right = motion
    x = LOW + (HIGH - LOW) * np.array(place)
    run = from_start(x, variance * np.eye(STATE_COUNT), command, readings)
    assert np.isfinite(run.states).all()
    assert run.least_variance.min() > 0.0
    last = run.states[9000:]
    assert np.abs(last[:, 3] - truth[9000:, 0]).max() < 3e-5
    assert np.abs(last[:, 1:3] - truth[9000:, 1:3]).max() < 2e5
    leaks = np.abs(run.states[:, 7:10] - right[:, 7:10]).max(axis=1) * TO_LITRES
    assert leaks[9000:].max() < max(leaks[4000:5000].max(), 0.06)


@settings(max_examples=30)
@given(places, st.lists(st.sampled_from([0.0, 1e-300, 1e-12, 1e4]), min_size=STATE_COUNT,
                        max_size=STATE_COUNT))  # fmt: skip
def test_variances_of_zero_are_no_harm(
    motion: tuple[Array, Array, Array, Array], place: list[float], variances: list[float]
) -> None:
    command, readings, truth, _ = motion
    x = LOW + (HIGH - LOW) * np.array(place)
    run = from_start(x, np.diag(variances), command[:3000], readings[:3000])
    assert np.isfinite(run.states).all()
    assert run.least_variance.min() >= 0.0
    assert np.abs(run.states[2000:, 3] - truth[2000:3000, 0]).max() < 3e-5


@pytest.mark.parametrize("name", ["x", "factors"])
@pytest.mark.parametrize("value", [np.nan, np.inf, 1e200])
def test_what_is_not_finite_is_started_anew_and_counted(
    motion: tuple[Array, Array, Array, Array], name: str, value: float
) -> None:
    command, readings, truth, right = motion
    x, factors = right[0].copy(), np.eye(STATE_COUNT) * 1e-12
    if name == "x":
        x[4] = value
    else:
        factors[4, 1] = value
    run = from_start(x, factors, command[:3000], readings[:3000])
    assert run.resets == 1
    assert np.isfinite(run.states[1:]).all()
    assert run.least_variance.min() > 0.0
    assert np.abs(run.states[2000:, 3] - truth[2000:3000, 0]).max() < 3e-5


def recovered(found: FilterRun, truth: Array, since: int) -> bool:
    """Return whether all was finite, and position and pressures are right since a tick."""
    position = found.states[since:, 3] - truth[since:, 0]
    pressures = found.states[since:, 1:3] - np.maximum(truth[since:, 1:3], 0.0)
    return bool(
        np.isfinite(found.states).all()
        and np.linalg.eigvalsh(scaled(found.covariance)).min() > 0.0
        and np.abs(position).max() < 6e-5
        and np.abs(pressures).max() < 3e5
    )


def scaled(covariance: Array) -> Array:
    deviation = np.sqrt(np.diag(covariance))
    return np.asarray(covariance / np.outer(deviation, deviation))


COLUMNS = [[0], [1], [2], [3], [1, 2], [0, 1, 2], [0, 1, 2, 3, 4]]


@pytest.mark.parametrize("columns", COLUMNS)
def test_sensors_that_fail_for_seconds_are_outlived(columns: list[int]) -> None:
    command = sine(8000)
    readings, truth = sampled(command)
    readings[2000:5000, columns] = np.nan
    assert recovered(filtered(command, readings), truth, 6000)


def test_a_minute_without_any_sensor_is_outlived() -> None:
    command = sine(64000)
    readings, truth = sampled(command)
    readings[2000:62000] = np.nan
    assert recovered(filtered(command, readings), truth, 63000)


def test_a_saturated_valve_and_both_stroke_ends_are_outlived() -> None:
    """10 V drive the ram into each end; it stays there for a second or more."""
    command = 10.0 * np.sign(sine(12000, 1.0, 0.2))
    command[9000:] = sine(3000, 2.0, 1.0)
    readings, truth = sampled(command)
    assert truth[:, 0].max() > NOMINAL.stroke_max
    assert truth[:, 0].min() < NOMINAL.stroke_min
    assert recovered(filtered(command, readings), truth, 10500)


def test_a_pressure_that_reads_its_full_scale_for_long_is_outlived() -> None:
    command = sine(6000)
    readings, truth = sampled(command)
    readings[2000:4000, 1] = DATA_SHEET.pressure_max
    assert recovered(filtered(command, readings), truth, 5000)


def test_commands_that_are_missing_are_outlived() -> None:
    command = sine(4000)
    readings, truth = sampled(command)
    command[1000:2000] = np.nan
    assert recovered(filtered(command, readings), truth, 3000)


def test_a_spike_is_no_divergence() -> None:
    command = sine(4000)
    readings, truth = sampled(command)
    readings[2000, 1] = 2e7
    found = filtered(command, readings)
    assert found.reset_times_s.size == 0
    assert recovered(found, truth, 2500)


@pytest.mark.long
def test_ten_minutes_leave_it_as_sound_as_ten_seconds() -> None:
    command = sine(600_000)
    readings, truth = sampled(command)
    found = filtered(command, readings)
    assert recovered(found, truth, 1000)
    assert found.reset_times_s.size == 0
    assert np.abs(found.states[5000:, 7:10]).max() * TO_LITRES < 0.25


EXTREMES = [
    {"valve_damping": 1.0},
    {"valve_damping": 2.0},
    {"valve_natural_frequency": 5000.0},
    {"valve_natural_frequency": 50.0},
    {"moving_mass": 1.0},
    {"moving_mass": 1000.0},
    {"line_volume_1": 1e-6, "line_volume_2": 1e-6},
    {"bulk_modulus": 2.5e9},
    {"bulk_modulus": 5e7},
    {"supply_pressure": 1e6},
    {"supply_pressure": 3.5e7},
]


@pytest.mark.parametrize("changed", EXTREMES, ids=str)
def test_a_model_at_the_edge_of_the_plausible_keeps_it_finite(changed: dict[str, float]) -> None:
    """Filter and rig need not even agree: the rig is the nominal one."""
    command = sine(4000)
    readings, _ = sampled(command)
    found = filtered(command, readings, Model(parameters=NOMINAL._replace(**changed)))
    assert np.isfinite(found.states).all()
    assert np.linalg.eigvalsh(scaled(found.covariance)).min() > 0.0


def test_a_filter_that_is_lost_starts_anew_once(
    motion: tuple[Array, Array, Array, Array],
) -> None:
    """A leak taken for certain that is not there: no reading pulls it back within a window."""
    command, readings, _, right = motion
    x = right[0].copy()
    x[7] = 2e-7
    run = from_start(x, 1e-30 * np.eye(STATE_COUNT), command, readings)
    assert run.resets == 1
    assert np.abs(run.states[2000:, 7:10] - right[2000:, 7:10]).max() * TO_LITRES < 0.2


def test_a_wrong_model_is_not_cured_by_resets() -> None:
    """The supply at 60 % and unmeasured: resets come when it begins, then at most every 10 s."""
    model = Model(parameters=NOMINAL._replace(supply_pressure=8.3e6))
    command = sine(25_000, 5.0, 2.0)
    readings, _ = sampled(command, model=model)
    readings[:, 4] = np.nan
    resets = filtered(command, readings).reset_times_s
    assert 1 <= resets.size <= 3
    assert np.isfinite(filtered(command, readings).states).all()
