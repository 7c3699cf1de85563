"""Linear algebra of the workflow: least squares within bounds, block sums, robust cost."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from scipy.optimize import lsq_linear

from estimator.gap.prediction.linear import (
    HUBER,
    Column,
    Linear,
    assemble,
    bounded_least_squares,
    cost_of,
)

NUMBERS = st.floats(-3.0, 3.0, allow_subnormal=False)


@given(
    arrays(np.float64, (9, 3), elements=NUMBERS),
    arrays(np.float64, 9, elements=NUMBERS),
    arrays(np.float64, 3, elements=st.floats(0.05, 4.0)),
)
def test_least_squares_within_bounds_reach_what_a_reference_reaches(
    jacobian: np.ndarray, residual: np.ndarray, reach: np.ndarray
) -> None:
    jacobian = jacobian + np.vstack([np.eye(3), np.zeros((6, 3))]) * 4.0
    lower, upper = -0.5 * reach, reach
    found = bounded_least_squares(jacobian.T @ jacobian, jacobian.T @ residual, lower, upper)
    wanted = lsq_linear(jacobian, -residual, (lower, upper), tol=1e-12)
    assert np.all((found >= lower - 1e-9) & (found <= upper + 1e-9))
    cost = 0.5 * np.sum((jacobian @ found + residual) ** 2)
    assert cost == pytest.approx(wanted.cost, rel=1e-5, abs=1e-8)


def test_a_direction_that_nothing_shows_is_left_alone() -> None:
    matrix = np.diag([2.0, 0.0])
    found = bounded_least_squares(
        matrix, np.array([-1.0, 0.0]), np.full(2, -np.inf), np.full(2, np.inf)
    )
    assert found == pytest.approx([0.5, 0.0])


@given(st.floats(-50.0, 50.0))
def test_an_outlier_costs_less_than_its_square_but_never_less_than_a_smaller_one(
    innovation: float,
) -> None:
    near, far = (float(cost_of(np.array([abs(innovation) + more]))[0]) for more in (0.0, 0.1))
    assert near <= innovation**2 + 1e-9
    assert far > near
    assert near == pytest.approx(innovation**2) or abs(innovation) > HUBER


def test_a_model_that_is_unstable_costs_much_and_not_an_error() -> None:
    cost = cost_of(np.array([1e181, 1e308]))
    assert cost[0] == pytest.approx(2e181 * HUBER)
    assert cost[1] == np.inf


def drawn(seed: int, correlated: int = 1) -> Linear:
    """Return the linearisation of noise with two columns, of a step of (0.3, -0.2) in it."""
    rng = np.random.default_rng(seed)
    columns = [Column(name, {}, 1.0) for name in "ab"]
    changes = np.repeat(rng.standard_normal((4000 // correlated, 2, 2)), correlated, axis=0)
    noise = np.repeat(rng.standard_normal((4000 // correlated, 2)), correlated, axis=0)
    base = noise - changes @ np.array([0.3, -0.2])
    blocks = [slice(k, k + 200) for k in range(0, 4000, 200)]
    used = [np.ones(base.shape, dtype=bool)]
    each = [[changes[:, :, i]] for i in (0, 1)]
    with ThreadPoolExecutor(1) as pool:
        return assemble(columns, [base], each, used, [blocks], pool)


def test_steps_are_found_and_the_gain_is_what_the_squares_lose() -> None:
    linear = drawn(1)
    steps, gain = linear.solve(["a", "b"])
    assert steps == pytest.approx([0.3, -0.2], abs=0.05)
    assert gain == pytest.approx(8000 * 0.13, rel=0.2)
    assert linear.solve(["a"])[1] < gain


def test_standard_errors_hold_for_noise_that_is_correlated_within_blocks() -> None:
    misses, errors = [], []
    for seed in range(60):
        linear = drawn(seed, correlated=10)
        steps, _ = linear.solve(["a", "b"])
        misses.append(steps - [0.3, -0.2])
        errors.append(linear.errors(["a", "b"], steps))
    scatter = np.sqrt(np.mean(np.square(misses)))
    assert np.mean(errors) == pytest.approx(scatter, rel=0.25)
    # Ten samples that are one tell as much as one: errors by the count would be a third of it.
    assert np.mean(errors) > 2.0 / np.sqrt(8000)
