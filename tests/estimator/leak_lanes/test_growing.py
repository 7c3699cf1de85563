"""A leak that grows is found in lanes as it is by the replay of the same blocks."""

import pytest

from estimator.leak_lanes.compiled_tests import CompiledLeakTest
from estimator.leaks import LeakTest
from tests.estimator.leaks.test_growing import growing


@pytest.mark.parametrize("fault", [0, 2])
def test_growth_is_found_alike(fault: int) -> None:
    compiled, plain = CompiledLeakTest(1.0), LeakTest(1.0)
    named = 0
    for block in growing(fault, 30, count=80):
        compiled.add(block)
        plain.add(block)
        here, there = compiled.search(), plain.search()
        assert [(f.fault, f.onset, f.ramp) for f in here] == [
            (f.fault, f.onset, f.ramp) for f in there
        ]
        assert compiled.null_bias() == pytest.approx(plain.null_bias())
        for mine, other in zip(here, there, strict=True):
            assert mine.statistic == pytest.approx(other.statistic, rel=1e-5)
        named += bool(here) and here[0].ramp is not None
    assert named >= 30
