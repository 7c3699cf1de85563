import numpy as np
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray

from rig.report.panel import limits_of

Array = NDArray[np.float64]


@given(arrays(np.float64, st.integers(2, 50), elements=st.floats(-1e3, 1e3)))
def test_an_axis_shows_the_middle_of_a_signal(values: Array) -> None:
    limits = limits_of([values], least=0.1)
    assert limits is not None
    low, high = limits
    assert high - low >= 0.1
    assert low <= float(np.quantile(values, 0.005))
    assert high >= float(np.quantile(values, 0.995))


def test_an_axis_leaves_room_around_an_ordinary_signal() -> None:
    low, high = limits_of([np.linspace(5.0, 9.0, 100)]) or (0.0, 0.0)
    assert 4.0 < low < 5.0
    assert 9.0 < high < 10.0


def test_a_filter_that_diverges_does_not_flatten_the_rest() -> None:
    values = np.append(np.linspace(5.0, 9.0, 1000), [1e12, -1e12, np.inf, np.nan])
    low, high = limits_of([values]) or (0.0, 0.0)
    assert -1.0 < low < 5.0
    assert 9.0 < high < 15.0


def test_noise_alone_does_not_fill_an_axis_of_flow() -> None:
    low, high = limits_of([np.array([-0.002, 0.0, 0.002])], least=0.1) or (0.0, 0.0)
    assert low < -0.04
    assert high > 0.04


def test_nothing_measured_leaves_the_axis_open() -> None:
    assert limits_of([]) is None
    assert limits_of([np.array([np.nan, np.nan])]) is None
