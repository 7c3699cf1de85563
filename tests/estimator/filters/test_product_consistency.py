"""Where rig and noise are as modelled, the filter's errors are what it says they are."""

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import chi2

from estimator.filters.product_model import DYNAMIC, STATE_COUNT, predict_product
from estimator.filters.product_noise import product_noise
from rig.plant import NOMINAL
from rig.plant.sensors import DATA_SHEET
from tests.estimator.product_reference import process_noise
from tests.estimator.product_starts import Steps, from_start

Array = NDArray[np.float64]

RUNS = 100
TICKS = 300
ERROR = 1e-3
"""Chance of either sum to leave its bounds if all is right; it is that of a seed, here fixed."""
NOISE = product_noise(DATA_SHEET, NOMINAL)
INITIAL = np.array(NOISE.initial)


def drawn(rng: np.random.Generator) -> tuple[Steps, Array]:
    """Return a run on a rig that is the filter's model with its noise, and its last true state."""
    command = 3.0 * np.sin(2.0 * np.pi * rng.uniform(1.0, 2.0) * np.arange(TICKS) * 1e-3)
    expected = np.zeros(STATE_COUNT)
    expected[1:4] = 6.9e6, 6.9e6, 0.3
    x = expected + INITIAL * rng.standard_normal(STATE_COUNT)
    noise = np.sqrt(np.diag(process_noise(NOISE)))
    deviation = np.sqrt([NOISE.position, NOISE.pressure, NOISE.pressure, NOISE.spool])
    readings, rows = np.full((TICKS, 5), np.nan), np.empty((DYNAMIC, STATE_COUNT))
    for k in range(1, TICKS):
        predict_product(x, command[k - 1], NOMINAL.supply_pressure, NOMINAL, rows)
        x = x + noise * rng.standard_normal(STATE_COUNT)
        readings[k, :4] = x[[3, 1, 2, 0]] + deviation * rng.standard_normal(4)
    return from_start(expected, np.diag(INITIAL**2), command, readings), x


@pytest.fixture(scope="module")
def runs() -> list[tuple[Steps, Array]]:
    rng = np.random.default_rng(3)
    return [drawn(rng) for _ in range(RUNS)]


def within_bounds(total: float, degrees: int) -> bool:
    low, high = chi2.ppf([0.5 * ERROR, 1.0 - 0.5 * ERROR], degrees)
    return bool(low < total < high)


def normalised_error(run: Steps, truth: Array) -> float:
    """Return e^T P^-1 e of the last tick (NEES)."""
    deviation = np.sqrt(np.diag(run.covariance))
    error = (truth - run.states[-1]) / deviation
    correlation = run.covariance / np.outer(deviation, deviation)
    return float(error @ np.linalg.solve(correlation, error))


def test_errors_are_as_large_as_the_covariance_says(runs: list[tuple[Steps, Array]]) -> None:
    total = sum(normalised_error(run, truth) for run, truth in runs)
    assert within_bounds(total, STATE_COUNT * RUNS)


def squares(runs: list[tuple[Steps, Array]]) -> tuple[float, int]:
    """Return the sum of squared innovations over their variances (NIS), and their number."""
    return sum(run.squares for run, _ in runs), sum(run.readings for run, _ in runs)


def test_innovations_are_as_large_as_expected(runs: list[tuple[Steps, Array]]) -> None:
    total, number = squares(runs)
    assert number > 0.99 * 4 * (TICKS - 1) * RUNS
    assert within_bounds(total, number)


def test_a_noise_wrong_by_a_tenth_would_be_noticed(runs: list[tuple[Steps, Array]]) -> None:
    """Of its standard deviation; the bounds are that narrow."""
    total, number = squares(runs)
    assert not within_bounds(1.21 * total, number)
