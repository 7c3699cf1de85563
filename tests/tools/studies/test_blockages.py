"""The study of return blockages counts by a bound that no test can pass."""

import pytest

from estimator.leaks import LeakTest
from tools.studies.blockages import Outcome, greatest_power, table


def test_a_blockage_that_began_after_the_last_block_can_be_found_by_chance_only() -> None:
    assert greatest_power(LeakTest(1.0), 1e13, 20.0, 1e-3) == 0.0


def test_its_table_counts_apart_what_the_bound_says_can_be_seen() -> None:
    found = [
        Outcome(1e13, 0.99, "return_blockage", ("return_blockage",)),
        Outcome(8e12, 0.96, "unknown_fault", ("unknown_fault",)),
        Outcome(2e12, 0.30, "healthy", ()),
    ]
    assert [each.can_be_seen for each in found] == [True, True, False]
    lines = table(found).splitlines()
    assert lines[2].startswith("| power of 95% or more | 2 | 1 of 2")
    assert lines[2].endswith("| 1 | unknown_fault 1 |")
    assert lines[3].startswith("| less | 1 | 0 of 1")


@pytest.mark.parametrize("power", [0.0, 0.949])
def test_less_than_the_stated_power_is_not_seen(power: float) -> None:
    assert not Outcome(1e13, power, "healthy", ()).can_be_seen
