"""A leak that grows over minutes is found, though no single onset explains it."""

import numpy as np
import pytest

from estimator.leaks.fault_size import LEAST_BLOCKS, STRETCHES, stretches
from estimator.leaks.leak_statistic import LeakTest
from estimator.leaks.leak_verdicts import growth_of, may_be_lines, present_coefficient
from rig.plant.parameters import LITRE_PER_MINUTE

from .test_leak_statistic import ROOT, blocks

FLOW = ROOT / LITRE_PER_MINUTE


def growing(count: int, seed: int, fault: int, rate: float) -> LeakTest:
    """Return a test of a leak that grows by so many L/min a block from a fifth of the run on.

    It is looked for at every sixteenth block.
    """
    test = LeakTest(1.0)
    for k, block in enumerate(blocks(count, seed)):
        flow = max(k - count // 5, 0) * rate
        coefficient = flow * LITRE_PER_MINUTE / (ROOT if fault < 2 else 0.6 * ROOT)
        block.missing[:] += coefficient * block.faults[:, fault]
        test.add(block)
        if k % 16 == 15:
            test.search()
    return test


@pytest.mark.parametrize(
    ("fault", "rate"),
    [
        (0, 2e-4),
        pytest.param(0, 3e-3, marks=pytest.mark.long),
        pytest.param(1, 2e-4, marks=pytest.mark.long),
        (1, 3e-3),
        pytest.param(2, 2e-4, marks=pytest.mark.long),
        (2, 3e-3),
    ],
)
def test_a_leak_that_grows_is_named_and_followed(fault: int, rate: float) -> None:
    test = growing(320, 1, fault, rate)
    found = test.search()
    assert [finding.fault for finding in found] == [fault]
    size = FLOW if fault < 2 else 0.6 * FLOW
    assert present_coefficient(test, found[0]) * size == pytest.approx(256 * rate, rel=0.25)
    assert not may_be_lines(test, found)
    growth = growth_of(test, found[0], size * LITRE_PER_MINUTE)
    assert growth is not None
    now, deviation = growth.now_m3_per_s, growth.now_std_m3_per_s
    assert abs(now - 256 * rate * LITRE_PER_MINUTE) < 3.0 * deviation
    assert growth.rate_m3_per_s2 == pytest.approx(2.0 * rate * LITRE_PER_MINUTE, rel=0.1)


@pytest.mark.parametrize("leak", ["external_leakage_2", "internal_leakage"])
def test_a_leak_that_stays_as_it_is_does_not_grow(leak: str) -> None:
    test = LeakTest(1.0)
    for block in blocks(160, 3, leak=leak, flow=0.3, onset=50):
        test.add(block)
    (found,) = test.search()
    size = test.sums.mean_sizes(test.mark(found))[found.fault] * LITRE_PER_MINUTE
    assert growth_of(test, found, float(size)) is None


def test_health_is_not_taken_for_growth() -> None:
    for seed in range(4):
        assert growing(320, seed, 0, 0.0).search() == []


def test_the_null_may_wander_in_the_meantime() -> None:
    """By 0.1 um from stretch to stretch, twice what leaks take to be found in as long a time."""
    rng = np.random.default_rng(3)
    for _ in range(4):
        test = LeakTest(1.0)
        wander = np.cumsum(0.01 * rng.standard_normal(STRETCHES)).repeat(40)
        for block, part in zip(blocks(320, 5), wander, strict=True):
            block.missing[:] += part * block.nuisances[:, 0]
            test.add(block)
            assert test.search() == []


def test_stretches_are_of_like_length() -> None:
    test = LeakTest(1.0)
    for block in blocks(LEAST_BLOCKS, 2):
        test.add(block)
    marks = stretches(test.sums)
    assert marks.size == STRETCHES - 1
    lengths = np.diff([0, *test.sums.mark_blocks[marks], LEAST_BLOCKS])
    assert lengths.tolist() == [LEAST_BLOCKS // STRETCHES] * STRETCHES


def test_a_run_of_an_hour_has_no_stretch_twice() -> None:
    """Marks thin out with age: two eighths of the run may begin at the same one."""
    test = LeakTest(1.0)
    for k, block in enumerate(blocks(7200, 2)):
        test.add(block)
        if k % 480 == 479:
            assert test.search() == []
            assert (np.diff(stretches(test.sums)) > 0).all()
