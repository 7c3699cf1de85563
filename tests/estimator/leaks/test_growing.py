"""A leak that grows within a test is named, with how it grew; nothing else is taken for one."""

import numpy as np
import pytest

from estimator.accounts import AccountBlock
from estimator.leaks import Finding, Growth, LeakTest
from estimator.leaks.growing import DURATIONS_S, RAMP_PART
from estimator.leaks.leak_verdicts import (
    fault_probabilities,
    growth_of,
    may_be_lines,
    present_coefficient,
)
from rig.plant import LITRE_PER_MINUTE

from .test_leak_statistic import ROOT, blocks

ONSET, FLOW = 30, 0.4


def growing(
    fault: int, ramp: int, *, count: int = 110, seed: int = 1, ends: int | None = None
) -> list[AccountBlock]:
    """Return blocks of a leak that grows to 0.4 L/min from block 30 on, in so many blocks."""
    found = blocks(count, seed)
    for k, block in enumerate(found[:ends]):
        level = min(max((k - ONSET + 0.5) / ramp, 0.0), 1.0)
        coefficient = FLOW * LITRE_PER_MINUTE / (ROOT if fault < 2 else 0.6 * ROOT)
        block.missing[:] += level * coefficient * block.faults[:, fault]
    return found


def searched(found: list[AccountBlock]) -> LeakTest:
    """Return the test of the blocks, with a search after each."""
    test = LeakTest(1.0)
    for block in found:
        test.add(block)
        test.search()
    return test


def the_growth(test: LeakTest, finding: Finding) -> Growth:
    """Return the growth of a leak, sized as the tests' blocks are."""
    size = (1.0 if finding.fault < 2 else 0.6) * ROOT
    growth = growth_of(test, finding, size)
    assert growth is not None
    return growth


@pytest.mark.parametrize(("fault", "ramp"), [(0, 20), (1, 60), (2, 60)])
def test_a_leak_that_grows_within_a_minute_is_named_and_sized(fault: int, ramp: int) -> None:
    test = searched(growing(fault, ramp))
    (found,) = test.search()
    assert found.fault == fault
    assert found.onset_s == pytest.approx(0.5 * ONSET, abs=1.5)
    assert not may_be_lines(test, [found])
    assert fault_probabilities(test)[1 + fault] > 0.99
    growth = the_growth(test, found)
    assert growth.from_m3_per_s == 0.0
    assert growth.seconds == pytest.approx(0.5 * ramp, rel=0.15)
    assert growth.now_m3_per_s == pytest.approx(FLOW * LITRE_PER_MINUTE, rel=0.05)
    assert not growth.grows_on


def test_a_leak_that_still_grows_is_said_to_grow_on() -> None:
    test = searched(growing(0, 80, count=80))
    (found,) = test.search()
    growth = the_growth(test, found)
    assert growth.grows_on
    assert growth.now_m3_per_s == pytest.approx(FLOW * LITRE_PER_MINUTE * 50.0 / 80.0, rel=0.05)


def test_a_leak_that_opens_at_once_is_not_said_to_have_grown() -> None:
    test = LeakTest(1.0)
    for block in blocks(110, 3, leak="external_leakage_2", flow=0.4, onset=ONSET):
        test.add(block)
        assert all(finding.ramp is None for finding in test.search())
    assert test.search()


def test_a_null_that_moves_is_no_leak_that_grows() -> None:
    """By 2 um within 20 s, which makes a flow of 0.2 L/min."""
    found = blocks(110, 5)
    for k, block in enumerate(found):
        block.missing[:] += 0.2 * min(max((k - ONSET) / 40.0, 0.0), 1.0) * block.nuisances[:, 0]
    test = LeakTest(1.0)
    for block in found:
        test.add(block)
        assert test.search() == []


def test_health_is_not_taken_for_growth_even_at_a_hundred_alarms_a_day() -> None:
    for seed in range(3):
        test = LeakTest(100.0, model_error=0.06)
        for block in blocks(80, seed, noise=0.002):
            test.add(block)
            assert all(finding.ramp is None for finding in test.search())


def test_once_shut_a_leak_that_grew_is_gone() -> None:
    found = growing(0, 20, count=140, ends=90)
    test = searched(found[:90])
    (finding,) = test.search()
    assert finding.ramp is not None
    assert finding.grown == pytest.approx(present_coefficient(test, finding))
    for block in found[90:]:
        test.add(block)
    assert present_coefficient(test, finding) == 0.0


def test_the_limit_of_growth_is_higher_as_it_has_a_part_of_the_rate() -> None:
    test = searched(growing(0, 20))
    (finding,) = test.search()
    freedom = test.candidates().regression.freedom
    assert finding.limit == test.threshold(freedom, RAMP_PART / len(DURATIONS_S))
    assert test.limit() + 0.4 < finding.limit < test.limit() + 2.0


def test_growth_is_found_anew_when_the_test_is_asked_for_the_nuisances() -> None:
    """The null that the accounts need is fitted beside the leak that grows."""
    test = searched(growing(0, 60))
    healthy = searched(blocks(110, 1))
    bias, spread = test.null_bias()
    assert np.abs(bias - healthy.null_bias()[0]) < 2.0 * spread
