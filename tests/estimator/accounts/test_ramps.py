"""A fault that grows is fitted by its levels, as sudden faults are fitted by their onsets."""

import numpy as np
import pytest

from estimator.accounts import SHIFT, Intervals, JointFit, Ramp, RampFit
from estimator.leaks.leak_statistic import LeakTest
from tests.estimator.leaks.test_leak_statistic import blocks


def of(count: int) -> LeakTest:
    """Return a test of healthy blocks."""
    test = LeakTest(1.0)
    for block in blocks(count, 4):
        test.add(block)
    return test


def test_a_fault_whose_level_is_one_from_a_mark_on_is_a_sudden_one() -> None:
    test = of(60)
    sudden = JointFit(test.sums, [SHIFT, 1, 0], [30, 20, 30], 0.7)
    since = (np.arange(60) >= np.array([[30], [20], [30]])).astype(float)
    fit = RampFit(Intervals(test.sums), [SHIFT, 1, 0], since, 0.7)
    assert fit.coefficients == pytest.approx(sudden.coefficients)
    assert fit.explained == pytest.approx(sudden.explained)
    assert fit.error == pytest.approx(sudden.error)
    assert fit.uneven_error() == pytest.approx(sudden.uneven_error())
    for found, expected in zip(fit.left_out(), sudden.left_out(), strict=True):
        assert found == pytest.approx(expected)


def test_the_levels_of_a_ramp_are_those_in_the_middle_of_the_blocks() -> None:
    intervals = Intervals(of(20).sums)
    level = intervals.level(Ramp(2.0, 4.0))
    assert level[:4].tolist() == [0.0] * 4
    assert level[4:12] == pytest.approx((np.arange(8) + 0.5) / 8.0)
    assert level[12:].tolist() == [1.0] * 8


def test_products_of_ramps_are_those_of_its_column() -> None:
    intervals = Intervals(of(20).sums)
    level = intervals.level(Ramp(2.0, 4.0))
    since = intervals.sums.faults_since()
    ramped = intervals.ramped(level[None], since, np.array([4]))
    assert ramped.products[0] == pytest.approx(level @ intervals.products)
    assert ramped.squares[0, 0, 2] == pytest.approx(level**2 @ intervals.squares[:, 0, 2])
    assert ramped.crossed[0, 1] == pytest.approx(level @ intervals.crossed[:, 1])
    assert ramped.blocks[0] == 16.0


def test_sudden_faults_that_add_up_to_a_ramp_have_its_size() -> None:
    intervals = Intervals(of(20).sums)
    fit = RampFit(intervals, [0], intervals.level(Ramp(2.0, 4.0))[None], 1.0)
    terms = fit.terms()
    assert [block for _, block, _ in terms] == list(range(4, 13))
    assert sum(size for _, _, size in terms) == pytest.approx(float(fit.coefficients[0]))
