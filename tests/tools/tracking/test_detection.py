"""Pairs of trials are compared at the stated rate, and rigs are the same under both laws."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, strategies as st

from tools.studies.leak_trials import Judgement, Plan, Trial, record
from tools.tracking.detection import (
    Pair,
    is_closed_loop,
    large_table,
    other_table,
    paired_difference,
    plans,
    small_table,
)

LEAK = Plan(1, "internal_leakage", 0.2, 12.0, 40.0)


def judged(plan: Plan, verdict: str) -> Trial:
    held = ((0.5, "inconclusive"), (plan.onset_s + 2.0, verdict))
    return Trial(plan, False, plan.size, {"product": Judgement(held, (0.0,), plan.size, 0.01)})


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=1, max_size=60))
def test_an_interval_holds_what_was_found_but_for_all_or_none(
    pairs: list[tuple[bool, bool]],
) -> None:
    first, second = zip(*pairs, strict=True)
    shown, low, high = paired_difference(first, second)
    back = paired_difference(second, first)
    assert -1.0 <= low <= high <= 1.0
    assert low <= shown <= high or abs(shown) > 0.9
    np.testing.assert_allclose(back, (-shown, -high, -low))


@pytest.mark.parametrize(("gained", "lost"), [(0.05, 0.05), (0.1, 0.2)])
def test_of_100_differences_95_are_within_their_intervals(gained: float, lost: float) -> None:
    rng = np.random.default_rng(1)
    held = 0
    for _ in range(400):
        drawn = rng.random(60)
        first = (drawn >= gained) & (drawn < 0.8)
        second = (drawn < gained) | (drawn >= gained + lost) & (drawn < 0.8)
        _, low, high = paired_difference(list(first), list(second))
        held += low <= gained - lost <= high
    # Of 400 intervals at 95 %, fewer than 369 hold the truth once in a hundred studies.
    assert held >= 369


def test_only_closed_loops_are_compared() -> None:
    kept = {plan.seed for plan in plans(20, 20)}
    assert kept == {plan.seed for plan in plans(20, 20) if is_closed_loop(plan)}
    open_loop = next(Plan(seed, None, 1.0, 2.0, 3.0) for seed in range(50)
                     if not is_closed_loop(Plan(seed, None, 1.0, 2.0, 3.0)))  # fmt: skip
    setpoint = record(open_loop)[0]["setpoint_V"]
    assert np.isfinite(setpoint).all()


def test_the_law_changes_the_command_and_neither_setpoint_nor_rig() -> None:
    plan = next(Plan(seed, None, 1.0, 2.0, 3.0) for seed in range(50)
                if is_closed_loop(Plan(seed, None, 1.0, 2.0, 3.0)))  # fmt: skip
    (plain, loaded, _), (tracked, same_load, _) = (
        record(plan), record(replace(plan, tracking=True)),
    )  # fmt: skip
    assert loaded == same_load
    np.testing.assert_array_equal(plain["setpoint_m"], tracked["setpoint_m"])
    assert not np.array_equal(plain["command_V"], tracked["command_V"])


def test_tables_have_a_row_for_each_size_and_one_for_all() -> None:
    small = replace(LEAK, seconds=80.0, size=0.05)
    healthy = replace(LEAK, fault=None)
    found = [
        Pair(judged(LEAK, "internal_leakage"), judged(LEAK, "unknown_fault")),
        Pair(judged(small, "internal_leakage"), judged(small, "internal_leakage")),
        Pair(judged(healthy, "healthy"), judged(healthy, "healthy")),
    ]
    assert "| 0.04 to 0.06 | 1 | 1 | 1 | +0.0 (" in small_table(found)
    assert "| 0.1 to 0.3 | 1 | 1 | 0 | -100.0 (" in large_table(found)
    assert "| healthy | 1 | 1 | 1 | +0.0 (" in other_table(found)
