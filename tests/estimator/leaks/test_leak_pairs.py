"""Two leaks stay two while each stands out beside the other."""

import pytest

from estimator.leaks.finding import Finding
from estimator.leaks.leak_statistic import TWO_WITNESSES, LeakTest
from rig.plant.parameters import LITRE_PER_MINUTE

from .test_leak_statistic import ROOT, blocks

FIRST, SECOND = 40, 60
"""Blocks at which the leaks of chambers 1 and 2 begin, 0.12 L/min each."""


def test_a_leak_that_seems_to_begin_later_alone_does_not_hide_the_second(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Taken to begin with the second leak, the first explains a part of it, and leaves too little.

    So it was in simulated runs with the second leak 10 s after the first.
    """
    test = LeakTest(1.0)
    coefficient = 0.12 * LITRE_PER_MINUTE / ROOT
    series = blocks(101, 1)
    for k, block in enumerate(series):
        block.missing[:] += coefficient * block.faults[:, 0] * (k >= FIRST)
        block.missing[:] += coefficient * block.faults[:, 1] * (k >= SECOND)
    for block in series[:-1]:
        test.add(block)
        found = test.search()
    assert [finding.fault for finding in found] in ([0, 1], [1, 0])

    best = test.best
    alone = Finding(0, SECOND, coefficient, 1e-12, 7.0, 60.0, 0.5 * SECOND, 1.0)

    def later(beside: Finding | None = None) -> Finding | None:
        if beside is None:
            return alone
        return None if beside == alone else best(beside)

    monkeypatch.setattr(test, "best", later)
    test.add(series[-1])
    again = test.search()
    assert sorted(finding.fault for finding in again) == [0, 1]
    assert sorted(finding.onset for finding in again) == [FIRST, SECOND]


def test_a_leak_is_preferred_to_a_loss_of_supply_that_is_as_likely() -> None:
    """While the valve joins only one chamber to the supply, both have the same signature."""
    test = LeakTest(1.0)
    for k, block in enumerate(blocks(70, 2)):
        # What the supply's has besides fits the noise a little better.
        block.faults[:, 3] = 1e-3 * block.faults[:, 0] + 1e-5 * block.missing / LITRE_PER_MINUTE
        block.missing[:] += 0.2 * LITRE_PER_MINUTE / ROOT * block.faults[:, 0] * (k >= FIRST)
        test.add(block)
        assert all(finding.fault == 0 for finding in test.search())
    assert test.search()


def test_two_faults_are_told_apart_only_by_four_blocks_for_each() -> None:
    test = LeakTest(1.0)
    named = []
    for k, block in enumerate(blocks(70, 1, noise=0.001)):
        both = block.faults[:, 0] + block.faults[:, 2]
        block.missing[:] += 0.5 * LITRE_PER_MINUTE / ROOT * both * (k >= FIRST)
        test.add(block)
        if len(test.search()) == 2:
            named.append(k + 1 - min(finding.onset for finding in test.search()))
    assert TWO_WITNESSES <= named[0] <= TWO_WITNESSES + 4
