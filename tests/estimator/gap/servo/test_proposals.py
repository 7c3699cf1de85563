"""A stop that the ram ran into is proposed where the pistons' force begins to grow."""

import numpy as np
import pytest

from estimator.gap.servo.proposals import _contact


def test_a_contact_is_found_where_the_force_begins_to_grow() -> None:
    rng = np.random.default_rng(1)
    depth = rng.uniform(0.40, 0.45, 20000)
    force = 300.0 + 50.0 * rng.standard_normal(len(depth))
    contact = _contact(depth, force + 5e6 * np.maximum(depth - 0.447, 0.0))
    assert contact is not None
    assert contact[0] == pytest.approx(0.447, abs=1e-4)
    assert contact[1] == pytest.approx(5e6, rel=0.03)


def test_a_contact_is_that_of_the_best_of_all_hinges() -> None:
    rng = np.random.default_rng(2)
    depth = rng.uniform(-0.23, -0.20, 3000)
    force = 4e5 * (depth + 0.21) ** 2 * 1e3 + 20.0 * rng.standard_normal(len(depth))
    near = depth > depth.max() - 6e-3
    fits = {}
    for place in np.arange(depth.max() - 6e-3, depth.max() - 5e-5, 5e-5):
        columns = np.column_stack([np.ones(near.sum()), np.maximum(depth[near] - place, 0.0)])
        (_, slope), (rest,), *_ = np.linalg.lstsq(columns, force[near], rcond=None)
        fits[rest] = (place, slope)
    assert _contact(depth, force) == pytest.approx(fits[min(fits)], rel=1e-9)


def test_a_force_that_does_not_grow_shows_no_contact() -> None:
    depth = np.linspace(0.0, 0.1, 5000)
    assert _contact(depth, np.full(5000, 800.0)) is None
    assert _contact(depth, -1e6 * depth) is None
    assert _contact(np.full(5000, 0.3), np.full(5000, 800.0)) is None
