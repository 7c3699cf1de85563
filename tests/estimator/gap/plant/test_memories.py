"""What remembers follows a quantity: as differential equations say, or as it is pulled along."""

from math import pi

import numpy as np
import pytest
from scipy.signal import lsim

from estimator.gap.plant.memories import memory_columns

PERIOD = 1e-3
TIME = np.arange(2000) * PERIOD
ONE_STRETCH = np.r_[1, np.zeros(len(TIME) - 1, dtype=np.int64)]


def _smooth() -> np.ndarray:
    return np.asarray(np.sin(2.0 * pi * 1.3 * TIME) + 0.3 * np.sin(2.0 * pi * 11.0 * TIME))


SECOND_ORDER = 1.5 * float(np.abs(np.diff(_smooth(), 2)).max())
"""What a sample's bend of the quantity may add: the disturbance is right to second order."""


def _middles(values: np.ndarray) -> np.ndarray:
    return np.asarray(0.5 * (values[1:] + values[:-1]))


@pytest.mark.parametrize("constant", [0.004, 0.05, 0.4])
def test_a_lag_is_behind_by_what_the_differential_equation_says(constant: float) -> None:
    quantity = _smooth()
    _, follower, _ = lsim(([1.0], [constant, 1.0]), quantity, TIME)
    (behind,) = memory_columns("lag", (constant,), quantity, ONE_STRETCH, PERIOD, False).T
    expected = _middles(follower - quantity)
    assert behind[1:-1] == pytest.approx(expected[1:], abs=SECOND_ORDER)


@pytest.mark.parametrize(("hertz", "damping"), [(3.0, 0.05), (20.0, 0.2), (60.0, 0.5)])
def test_a_resonance_is_behind_and_fast_as_the_differential_equation_says(
    hertz: float, damping: float
) -> None:
    quantity, w = _smooth(), 2.0 * pi * hertz
    system = ([w * w], [1.0, 2.0 * damping * w, w * w])
    _, follower, _ = lsim(system, quantity, TIME)
    found = memory_columns("resonance", (hertz, damping), quantity, ONE_STRETCH, PERIOD, False)
    expected = _middles(follower - quantity)
    speed = np.diff(follower) / PERIOD / w
    assert found[1:-1, 0] == pytest.approx(expected[1:], abs=SECOND_ORDER)
    assert found[1:-1, 1] == pytest.approx(speed[1:], abs=SECOND_ORDER)


def test_a_command_that_is_held_steps_once_a_sample() -> None:
    steps = np.where(TIME < 0.1, 0.0, 1.0)
    (behind,) = memory_columns("lag", (0.02,), steps, ONE_STRETCH, PERIOD, True).T
    after = TIME[100:] - TIME[100]
    assert behind[:100] == pytest.approx(np.zeros(100))
    assert behind[100:] == pytest.approx(-np.exp(-(after + 0.5 * PERIOD) / 0.02), abs=1e-4)


def test_a_play_stays_until_it_is_pulled_along() -> None:
    up, down = np.linspace(0.0, 1.0, 101), np.linspace(1.0, -1.0, 201)[1:]
    quantity = np.concatenate([up, down])
    starts = np.r_[1, np.zeros(len(quantity) - 1, dtype=np.int64)]
    (behind,) = memory_columns("play", (0.2,), quantity, starts, PERIOD, False).T
    follower = behind + quantity
    assert follower[:101] == pytest.approx(np.maximum(up - 0.2, 0.0))
    assert follower[101:] == pytest.approx(np.minimum(0.8, down + 0.2))


def test_a_follower_is_at_rest_where_a_stretch_begins() -> None:
    starts = ONE_STRETCH.copy()
    starts[700] = 1
    quantity = _smooth()
    for form, at in (("lag", (0.1,)), ("resonance", (5.0, 0.1)), ("play", (0.2,))):
        found = memory_columns(form, at, quantity, starts, PERIOD, False)
        assert not found[700].any()
        alone = memory_columns(
            form, at, quantity[700:], ONE_STRETCH[: len(TIME) - 700], PERIOD, False
        )
        assert np.array_equal(found[700:], alone)
