"""Two leaks stay two while each stands out beside the other."""

import pytest

from estimator.leaks.finding import Finding
from estimator.leaks.leak_statistic import LeakTest
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
    for k, block in enumerate(blocks(100, 1)):
        block.missing[:] += coefficient * block.faults[:, 0] * (k >= FIRST)
        block.missing[:] += coefficient * block.faults[:, 1] * (k >= SECOND)
        test.add(block)
        found = test.search()
    assert [finding.fault for finding in found] in ([0, 1], [1, 0])

    best = test.best

    def later(beside: Finding | None = None) -> Finding | None:
        alone = best()
        assert alone is not None
        if beside is None:
            return Finding(alone.fault, SECOND, alone.coefficient, 1e-12, 7.0, 60.0, 30.0, 1.0)
        return None if beside.onset == SECOND and beside.fault == alone.fault else best(beside)

    monkeypatch.setattr(test, "best", later)
    for block in blocks(101, 1)[100:]:
        block.missing[:] += coefficient * block.faults[:, :2].sum(axis=1)
        test.add(block)
    again = test.search()
    assert sorted(finding.fault for finding in again) == [0, 1]
    assert sorted(finding.onset for finding in again) == [FIRST, SECOND]
