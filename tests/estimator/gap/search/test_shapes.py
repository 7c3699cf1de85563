"""Shapes that are tried along a quantity: where their knots are, and how fine they may be."""

from itertools import pairwise

import numpy as np
import pytest

from estimator.gap.search.shapes import Shape, corners, fine_shapes, finer, knots_of, symbols


def test_a_table_has_a_knot_at_each_level_of_a_quantity_and_none_between() -> None:
    generator = np.random.default_rng(1)
    levels = np.repeat([1e5, 3e5, 5e5, 7e5], 2000)
    values = np.r_[levels + 3e3 * generator.standard_normal(8000), np.linspace(1e5, 7e5, 100)]
    assert knots_of(values) == pytest.approx([1e5, 3e5, 5e5, 7e5], rel=1e-2)


def test_a_table_has_no_knot_where_a_quantity_never_was() -> None:
    generator = np.random.default_rng(2)
    slow, fast = generator.uniform(0.0, 0.2, 4000), generator.uniform(0.6, 1.0, 4000)
    knots = np.array(knots_of(np.r_[slow, fast]))
    assert len(knots) == 9
    assert np.all(np.diff(knots) > 0.0)
    assert not np.any((knots > 0.21) & (knots < 0.59))


def test_waves_are_as_short_as_the_motion_can_show_and_none_between_two_is_missed() -> None:
    time = np.arange(20000) * 1e-3
    position = 0.1 + 0.125 * np.sin(2.0 * np.pi * 0.1 * time)
    shapes = fine_shapes("position", position, turned=False)
    pitches = np.array([shape.at[0] for shape in shapes if shape.form == "wave"])
    assert pitches.min() < 2.5e-3
    assert np.diff(1.0 / pitches).max() <= 0.5 / 0.249
    quick = fine_shapes("position", 0.1 + 0.125 * np.sin(2.0 * np.pi * 2.0 * time), turned=False)
    fastest = min(shape.at[0] for shape in quick if shape.form == "wave")
    assert fastest > 8.0 * 0.125 * 2.0 * np.pi * 2.0 * 0.5 * 1e-3


def test_limits_are_tried_on_either_side_where_a_quantity_has_both_signs() -> None:
    volts = np.random.default_rng(3).normal(0.0, 0.5, 4000)
    table = Shape("command", "", "table", (-1.0, 0.0, 1.0))
    limits = [shape.at[0] for shape in symbols(table, volts) if shape.form == "beyond"]
    assert len(limits) == 11
    assert 0.0 < limits[0] < 0.05
    assert not [s for s in symbols(table, np.abs(volts)) if s.form == "beyond"]


def test_between_two_limits_that_are_tried_finer_ones_are() -> None:
    volts = np.random.default_rng(3).normal(0.0, 0.5, 4000)
    tried = corners(symbols(Shape("command", "", "table", (-1.0, 0.0, 1.0)), volts))
    assert {shape.form for shape in tried} == {"hinge", "beyond"}
    for one, after in pairwise(tried):
        if one.form == after.form:
            near = [shape.at[0] for shape in finer(one, float(np.ptp(volts)))]
            assert max(near) >= one.at[0] + 0.3 * (after.at[0] - one.at[0])
