"""Steps on the factors U and D are the textbook's on P, and D never turns negative."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, strategies as st
from numba import njit
from numpy.typing import NDArray

from estimator.filters import ud

Array = NDArray[np.float64]

SIZE = 7
seeds = st.integers(0, 2**32 - 1)
indices = st.integers(0, SIZE - 1)


@njit(error_model="numpy")
def corrected(x: Array, factors: Array, index: int, measured: float, variance: float) -> float:
    square: float = ud.correct(x, factors, index, measured, variance, np.empty(SIZE))
    return square


@njit(error_model="numpy")
def raised(factors: Array, size: int, vector: Array, weight: float) -> None:
    ud.add_rank_one(factors, size, vector, weight)


@njit(error_model="numpy")
def all_noisier(factors: Array, variances: Array) -> None:
    ud.add_noises(factors, variances, np.empty((SIZE + 1, SIZE)))


def noisier(factors: Array, index: int, variance: float) -> None:
    all_noisier(factors, variance * np.eye(SIZE)[index])


@njit(error_model="numpy")
def forgotten(factors: Array, index: int, variance: float) -> None:
    ud.forget(factors, index, variance, np.empty(SIZE))


@njit(error_model="numpy")
def variance_of(factors: Array, index: int) -> float:
    variance: float = ud.variance_of(factors, index)
    return variance


def random_factors(rng: np.random.Generator, known: bool = False) -> Array:
    """Return factors of a random P; `known` makes some of its variances zero."""
    factors = np.tril(rng.standard_normal((SIZE, SIZE)), -1)
    d = rng.uniform(0.1, 3.0, SIZE)
    if known:
        d[rng.integers(0, 2, SIZE) == 0] = 0.0
    return factors + np.diag(d)


def agrees(factors: Array, expected: Array) -> bool:
    return bool(np.allclose(ud.dense_covariance(factors), expected, rtol=1e-9, atol=1e-9))


def is_sound(factors: Array) -> bool:
    return bool(np.isfinite(factors).all() and np.diag(factors).min() >= 0.0)


@given(seeds, indices, st.booleans())
def test_a_measurement_corrects_as_kalman_has_it(seed: int, index: int, known: bool) -> None:
    rng = np.random.default_rng(seed)
    factors, x = random_factors(rng, known), rng.standard_normal(SIZE)
    P, h = ud.dense_covariance(factors), np.eye(SIZE)[index]
    measured, variance = float(rng.standard_normal()), float(rng.uniform(0.1, 1.0))
    expected = P[index, index] + variance
    assert variance_of(factors, index) == pytest.approx(P[index, index])
    state = x + P @ h / expected * (measured - x[index])
    innovation = measured - x[index]
    square = corrected(x, factors, index, measured, variance)
    assert x == pytest.approx(state, abs=1e-9)
    assert agrees(factors, P - np.outer(P @ h, P @ h) / expected)
    assert square == pytest.approx(innovation**2 / expected)
    assert is_sound(factors)


@given(seeds, st.integers(1, SIZE), st.booleans())
def test_a_direction_gains_variance(seed: int, size: int, known: bool) -> None:
    rng = np.random.default_rng(seed)
    factors, vector = random_factors(rng, known), np.zeros(SIZE)
    vector[:size] = rng.standard_normal(size)
    weight = float(rng.choice([0.0, 1e-6, 1.0, 1e6]))
    expected = ud.dense_covariance(factors) + weight * np.outer(vector, vector)
    raised(factors, size, vector.copy(), weight)
    assert np.allclose(ud.dense_covariance(factors), expected, rtol=1e-9, atol=1e-9 * (1 + weight))
    assert is_sound(factors)


@given(seeds, indices, st.booleans(), st.sampled_from([0.0, 1e-9, 2.0]))
def test_white_noise_adds_to_one_variance(
    seed: int, index: int, known: bool, variance: float
) -> None:
    factors = random_factors(np.random.default_rng(seed), known)
    expected = ud.dense_covariance(factors)
    expected[index, index] += variance
    noisier(factors, index, variance)
    assert agrees(factors, expected)
    assert is_sound(factors)


@given(seeds, indices, st.booleans())
def test_white_noises_of_the_last_states_add_to_theirs(seed: int, first: int, known: bool) -> None:
    rng = np.random.default_rng(seed)
    factors = random_factors(rng, known)
    variances = rng.choice([0.0, 1e-9, 0.5, 2.0], SIZE - first)
    expected = ud.dense_covariance(factors) + np.diag([*[0.0] * first, *variances])
    all_noisier(factors, variances)
    assert agrees(factors, expected)
    assert is_sound(factors)


@given(seeds, indices, st.booleans())
def test_what_is_forgotten_leaves_the_others_as_they_were(
    seed: int, index: int, known: bool
) -> None:
    factors = random_factors(np.random.default_rng(seed), known)
    expected = ud.dense_covariance(factors)
    expected[index] = expected[:, index] = 0.0
    expected[index, index] = 0.3
    forgotten(factors, index, 0.3)
    assert agrees(factors, expected)
    assert is_sound(factors)


@pytest.mark.parametrize("step", [noisier, forgotten])
def test_a_tiny_variance_is_not_lost_beside_a_huge_one(
    step: Callable[[Array, int, float], None],
) -> None:
    factors = np.diag([1e-30, 1e30, 1.0, 1e-12, 1e12, 0.0, 1.0])
    step(factors, 3, 1e-12)
    assert np.diag(factors)[[0, 1, 4]] == pytest.approx([1e-30, 1e30, 1e12])
    assert is_sound(factors)


@given(seeds, st.booleans())
def test_rows_are_orthogonalised_by_their_weights(seed: int, known: bool) -> None:
    rng = np.random.default_rng(seed)
    rows, weights = rng.standard_normal((SIZE, SIZE + 3)), rng.uniform(0.1, 2.0, SIZE + 3)
    if known:
        weights[rng.integers(0, 2, SIZE + 3) == 0] = 0.0
    expected = (rows * weights) @ rows.T
    factors = np.zeros((SIZE, SIZE))
    ud.orthogonalise(rows, weights, factors, SIZE)
    assert agrees(factors, expected)
    assert is_sound(factors)
