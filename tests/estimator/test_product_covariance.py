"""The product filter's sparse covariance is that of the textbook's dense equations."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numba import njit
from numpy.typing import NDArray

from estimator.product import _correct, _mirror, _predict_covariance
from estimator.product_model import DYNAMIC, STATE_COUNT

Array = NDArray[np.float64]

seeds = st.integers(0, 2**32 - 1)


def random_covariance(rng: np.random.Generator) -> Array:
    root = rng.standard_normal((STATE_COUNT, STATE_COUNT))
    return np.asarray(root @ root.T)


def random_jacobian(rng: np.random.Generator) -> Array:
    jacobian = rng.standard_normal((DYNAMIC, STATE_COUNT))
    for row in (0, 5):
        kept = jacobian[row, [0, 5]]
        jacobian[row] = 0.0
        jacobian[row, [0, 5]] = kept
    return jacobian


@njit(error_model="numpy")
def predicted(covariance: Array, jacobian: Array, product: Array) -> None:
    _predict_covariance(covariance, jacobian, product)
    _mirror(covariance)


@njit(error_model="numpy")
def corrected(
    x: Array, covariance: Array, index: int, measured: float, variance: float, gain: Array
) -> None:
    _correct(x, covariance, index, measured, variance, gain)
    _mirror(covariance)


@given(seeds)
def test_it_is_predicted_by_the_whole_transition_matrix(seed: int) -> None:
    rng = np.random.default_rng(seed)
    covariance, jacobian = random_covariance(rng), random_jacobian(rng)
    transition = np.vstack([jacobian, np.eye(STATE_COUNT)[DYNAMIC:]])
    expected = transition @ covariance @ transition.T
    predicted(covariance, jacobian, np.zeros((DYNAMIC, STATE_COUNT)))
    assert covariance == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert np.array_equal(covariance, covariance.T)


@given(seeds, st.integers(0, STATE_COUNT - 1))
def test_a_measurement_corrects_as_kalman_has_it(seed: int, index: int) -> None:
    rng = np.random.default_rng(seed)
    covariance, x = random_covariance(rng), rng.standard_normal(STATE_COUNT)
    measured, variance = float(rng.standard_normal()), float(rng.uniform(0.1, 1.0))
    h = np.eye(STATE_COUNT)[index]
    gain = covariance @ h / (h @ covariance @ h + variance)
    state = x + gain * (measured - x[index])
    expected = (np.eye(STATE_COUNT) - np.outer(gain, h)) @ covariance
    corrected(x, covariance, index, measured, variance, np.zeros(STATE_COUNT))
    assert x == pytest.approx(state, rel=1e-9, abs=1e-9)
    assert covariance == pytest.approx(expected, rel=1e-9, abs=1e-9)
    assert np.array_equal(covariance, covariance.T)
