"""Compiled scores and noise variances are those of the regression of one rig."""

import numpy as np
import pytest
from numpy.typing import NDArray

from estimator.accounts.regression import Regression
from estimator.accounts.sums import FaultProducts
from estimator.leak_lanes.scoring import first_nuisance, fit_nuisances, nuisance_belief, score

Array = NDArray[np.float64]

BLOCKS = 60
NUISANCES = 7
SHAPES = 6
LEAST = 0.25


@pytest.fixture
def columns() -> tuple[Array, Array, Array]:
    """Return nuisances (rows, 7), faults with shift (rows, 6), and missing flow with a fault."""
    random = np.random.default_rng(7)
    nuisances = random.normal(size=(2 * BLOCKS, NUISANCES)) * np.logspace(-1, 3, NUISANCES)
    shapes = np.abs(random.normal(size=(2 * BLOCKS, SHAPES)))
    missing = nuisances @ random.normal(size=NUISANCES) + random.normal(size=2 * BLOCKS)
    missing[BLOCKS:] += 0.8 * shapes[BLOCKS:, 1]
    return nuisances, shapes, missing


def test_the_noise_variance_and_the_nuisances_are_those_of_the_regression(
    columns: tuple[Array, Array, Array],
) -> None:
    f, _, y = columns
    expected = Regression(f.T @ f, f.T @ y, float(y @ y), y.size, LEAST)
    variance, used = fit_nuisances(f.T @ f, f.T @ y, float(y @ y), float(y.size), LEAST)
    assert variance == pytest.approx(expected.variance, rel=1e-9)
    assert 8.0 + y.size - used - 1.0 == pytest.approx(expected.freedom, rel=1e-9)
    sizes, covariance = expected.nuisances()
    mean, spread = nuisance_belief(f.T @ f, f.T @ y, variance)
    np.testing.assert_allclose(mean, sizes, rtol=1e-7)
    np.testing.assert_allclose(spread, covariance, rtol=1e-7, atol=1e-12)
    first = first_nuisance(f.T @ f, f.T @ y, variance)
    assert first == pytest.approx((sizes[0], covariance[0, 0]), rel=1e-7)


def test_the_scores_are_those_of_the_regression(columns: tuple[Array, Array, Array]) -> None:
    f, u, y = columns
    onsets = range(0, 2 * BLOCKS - 8, 2)
    squares = np.array([u[k:].T @ u[k:] for k in onsets])
    crossed = np.array([u[k:].T @ f[k:] for k in onsets])
    products = np.array([u[k:].T @ y[k:] for k in onsets])
    regression = Regression(f.T @ f, f.T @ y, float(y @ y), y.size, LEAST)
    nothing = np.zeros(len(squares))
    given = FaultProducts(squares, crossed, products, nothing, nothing)
    expected = regression.score(crossed, given, regression.variance)
    found = np.empty((4, len(squares), SHAPES - 1))
    score(
        np.ascontiguousarray(crossed.T), squares, products, f.T @ f, f.T @ y, float(y @ y),
        regression.freedom, regression.variance, LEAST, found,
    )  # fmt: skip
    for ours, theirs in zip(
        found,
        (expected.coefficient, expected.information, expected.explained, expected.variance),
        strict=True,
    ):
        np.testing.assert_allclose(ours, theirs, rtol=1e-6, atol=1e-9)
