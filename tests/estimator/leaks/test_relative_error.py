"""A leak's interval carries the discharge coefficient as far as the motion leaves it open."""

from dataclasses import replace
from math import hypot

import pytest

from estimator.accounts.nuisances import NUISANCES, nuisance_index
from estimator.leaks.leak_statistic import LeakTest
from estimator.leaks.leak_verdicts import EDGE_ERROR, relative_error

from .test_leak_statistic import blocks

DISCHARGE = nuisance_index("discharge_coefficient")


def watched(*, moving: bool) -> LeakTest:
    """Return a test of a ram whose travel shows the discharge coefficient, or of one at rest."""
    test = LeakTest(1.0)
    for block in blocks(40, 1):
        shapes = block.nuisances.copy()
        shapes[:, DISCHARGE] *= float(moving)
        test.add(replace(block, nuisances=shapes))
    return test


def test_a_ram_at_rest_leaves_the_whole_tolerance_of_the_discharge_coefficient() -> None:
    whole = hypot(EDGE_ERROR, NUISANCES[DISCHARGE].sigma)
    assert relative_error(watched(moving=False)) == pytest.approx(whole)


def test_a_ram_that_moves_leaves_little_of_it() -> None:
    assert EDGE_ERROR < relative_error(watched(moving=True)) < 1.5 * EDGE_ERROR
