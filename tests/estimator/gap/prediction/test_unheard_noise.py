"""Noise that a sensor is stated to have, and has not, does not hide what the model lacks."""

from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from estimator.gap.plant.records import record_of
from estimator.gap.prediction.bands import unheard
from estimator.gap.prediction.fit import Filtered, Fitter
from estimator.gap.prediction.predictor import Predictor
from tests.estimator.gap.wheel import ran, wheel


@pytest.fixture(scope="module")
def pool() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as threads:
        yield threads


def measured(pool: ThreadPoolExecutor, **wheel_is: float) -> tuple[float, float, float]:
    """Return a wheel's cost per reading, that of the model's twins, and what these have too much.

    The wheel is the model but for `wheel_is`.
    """
    plant = wheel()
    predictor, values = Predictor(plant), plant.nominal
    record = record_of(ran(3, 8.0, **wheel_is), plant)  # type: ignore[arg-type]
    filtered = Fitter(predictor, [record], pool).filtered(values)
    twins = [
        Fitter(predictor, [predictor.twin(record, values, seed)], pool).filtered(values)
        for seed in (1, 2)
    ]
    stated = np.mean([twin.costs(values).sum() for twin in twins]) / filtered.samples
    cost = filtered.costs(values).sum() / filtered.samples
    return float(cost), float(stated), unheard(filtered, twins, values)


@pytest.mark.parametrize("hidden", [{}, {"offset": 1.0}, {"squared": 12.0}, {"lag_s": 6e-3}])
def test_of_noise_as_stated_nothing_is_unheard_whatever_the_model_lacks(
    pool: ThreadPoolExecutor, hidden: dict[str, float]
) -> None:
    assert measured(pool, **hidden)[2] == 0.0


def test_the_floor_of_a_sensor_less_noisy_than_stated_is_what_a_rig_like_the_model_costs(
    pool: ThreadPoolExecutor,
) -> None:
    _, stated, too_much = measured(pool, quiet=0.3)
    assert stated - too_much == pytest.approx(0.3**2 * stated, abs=0.05 * stated)


def test_what_the_model_lacks_shows_over_the_floor_of_a_sensor_less_noisy_than_stated(
    pool: ThreadPoolExecutor,
) -> None:
    whole, *_ = measured(pool, quiet=0.3)
    cost, stated, too_much = measured(pool, quiet=0.3, offset=0.03)
    assert cost < stated
    assert cost - (stated - too_much) == pytest.approx(cost - whole, rel=0.2)


def of_innovations(innovations: np.ndarray) -> Any:
    plant = SimpleNamespace(period=1e-3)
    blocks = [slice(first, first + 500) for first in range(0, len(innovations), 500)]
    return SimpleNamespace(
        innovations=lambda values: [(innovations, None)], blocks=[blocks],
        predictor=SimpleNamespace(plant=plant), samples=innovations.size,
    )  # fmt: skip


def test_a_twin_that_breaks_away_where_the_record_does_not_has_no_noise_too_much() -> None:
    white = np.random.default_rng(1).standard_normal((2, 8000, 1))
    white[1, ::2000] += 300.0
    record, twin = (of_innovations(each) for each in white)
    found: list[Filtered] = [twin]
    assert unheard(record, found, {}) == 0.0
    white[0] *= 0.5
    assert unheard(record, found, {}) == pytest.approx(0.75, abs=0.1)
