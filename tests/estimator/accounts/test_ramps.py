"""A fault that grows is fitted by its levels, as sudden faults are fitted by their onsets."""

import numpy as np
import pytest

from estimator.accounts import (
    NUISANCE_COUNT,
    SHIFT,
    Intervals,
    JointFit,
    Ramp,
    RampFit,
    RampRules,
    likeliest_ramp,
)
from estimator.accounts.ramp_search import _columns, _from_each_mark
from estimator.leaks.leak_statistic import LeakTest
from rig.plant import LITRE_PER_MINUTE
from tests.estimator.leaks.test_leak_statistic import ROOT, blocks


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
    sums = of(20).sums
    intervals = Intervals(sums)
    level = intervals.level(Ramp(2.0, 4.0))
    starts = sums.starts_s
    since, crossed, visible = _from_each_mark(*sums.packed, starts, intervals.end_s, 4)
    products, turned = np.empty((3, 6)), np.empty((6, NUISANCE_COUNT))
    _columns(4, 4.0, starts, intervals.end_s, since, crossed, products, turned)
    own = np.diagonal(intervals.squares, axis1=1, axis2=2)
    assert products[0] == pytest.approx(level**2 @ own)
    assert products[1] == pytest.approx(level**2 @ intervals.squares[:, :, SHIFT])
    assert products[2] == pytest.approx(level @ intervals.products)
    assert turned == pytest.approx(np.einsum("j,jia->ia", level, intervals.crossed))
    assert visible[16, 0]
    assert not visible[17, 0]


def test_the_likeliest_ramp_is_refined_to_the_one_that_was_made() -> None:
    """From a ramp that begins 2 s late and lasts half as long, beside noise."""
    test = LeakTest(1.0)
    for k, block in enumerate(blocks(80, 6, noise=0.002)):
        level = min(max((k + 0.5 - 20) / 24.0, 0.0), 1.0)
        block.missing[:] += 0.3 * LITRE_PER_MINUTE / ROOT * level * block.faults[:, 0]
        test.add(block)
    rules = RampRules(4.0, 128.0, 40, 4, 0.8, 20.0)
    found = likeliest_ramp(test.sums, 0.25, np.array([24]), np.array([6.0]), rules)
    assert found.fault == 0
    assert found.mark == pytest.approx(20, abs=1)
    assert found.seconds == pytest.approx(12.0, rel=0.1)
    assert found.gain > found.rival + 20.0


def test_sudden_faults_that_add_up_to_a_ramp_have_its_size() -> None:
    intervals = Intervals(of(20).sums)
    fit = RampFit(intervals, [0], intervals.level(Ramp(2.0, 4.0))[None], 1.0)
    terms = fit.terms()
    assert [block for _, block, _ in terms] == list(range(4, 13))
    assert sum(size for _, _, size in terms) == pytest.approx(float(fit.coefficients[0]))
