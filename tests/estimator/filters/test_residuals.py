"""The moving average of absolute residuals (section 4.4)."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from estimator.filters.residuals import (
    THESIS_WINDOW,
    moving_average_absolute,
    moving_average_step,
    start_moving_average,
)

Array = NDArray[np.float64]

RESIDUALS = arrays(
    np.float64, st.integers(0, 60), elements=st.floats(-1e7, 1e7) | st.just(float("nan"))
)


def windowed_means(residual: Array, n: int) -> Array:
    windows = [np.abs(residual[max(0, k - n + 1) : k + 1]) for k in range(residual.size)]
    kept = [window[~np.isnan(window)] for window in windows]
    return np.array([window.mean() if window.size else np.nan for window in kept])


@given(residual=RESIDUALS, n=st.integers(1, 25))
def test_each_value_is_the_mean_absolute_of_the_last_n_that_are_not_nan(
    residual: Array, n: int
) -> None:
    averages = moving_average_absolute(residual, n)
    np.testing.assert_allclose(averages, windowed_means(residual, n), rtol=1e-12, atol=1e-300)


@given(residual=RESIDUALS, n=st.integers(1, 25))
def test_sample_by_sample_it_is_the_same_to_the_last_bit(residual: Array, n: int) -> None:
    memory = start_moving_average(n)
    streamed = np.array([moving_average_step(memory, value) for value in residual])
    assert streamed.tobytes() == moving_average_absolute(residual, n).tobytes()


def test_residuals_of_both_signs_do_not_cancel() -> None:
    residual = 2e5 * np.sign(np.sin(np.arange(100.0) + 0.5))
    np.testing.assert_allclose(moving_average_absolute(residual, 10), 2e5)


@pytest.mark.parametrize("burst", [1e300, np.inf])
def test_a_diverged_filter_is_forgotten_once_it_leaves_the_window(burst: float) -> None:
    residual = np.full(100, 1.25)
    residual[7] = burst
    averages = moving_average_absolute(residual, 20)
    assert np.all(averages[7:27] > 1e200)
    np.testing.assert_array_equal(averages[27:], 1.25)


def test_the_thesis_averages_four_seconds() -> None:
    residual = np.concatenate([np.zeros(5000), np.ones(4000)])
    averages = moving_average_absolute(residual)
    assert THESIS_WINDOW == 4000
    np.testing.assert_allclose(averages[5000:], np.arange(1, 4001) / 4000)


@pytest.mark.parametrize("n", [0, -3])
def test_an_empty_window_is_refused(n: int) -> None:
    with pytest.raises(ValueError, match=f"window of {n} samples"):
        moving_average_absolute(np.ones(3), n)


def test_three_residuals_at_once_are_refused() -> None:
    with pytest.raises(ValueError, match=r"shape \(5, 3\)"):
        moving_average_absolute(np.ones((5, 3)))
