from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, strategies as st
from scipy import stats

from rig.plant.parameters import LITRE_PER_MINUTE
from rig.sweep.study import Share, Study, study_of


def table_of(**columns: Any) -> pa.Table:
    return pa.table({name: pa.array(values) for name, values in columns.items()})


def leaks(cases: int, limit: float, *, seed: int = 1, estimates: bool = True) -> pa.Table:
    """Return healthy cases and leaks that are named with a logistic chance in their flow."""
    random = np.random.default_rng(seed)
    flow = np.exp(random.uniform(np.log(0.01), np.log(1.0), cases)) * LITRE_PER_MINUTE
    # 95 in 100 of the leaks of `limit` (L/min) are named.
    chance = 1.0 / (1.0 + np.exp(-(3.0 * np.log(flow / LITRE_PER_MINUTE / limit) + np.log(19.0))))
    healthy = random.random(cases) < 0.3
    right = np.where(healthy, True, random.random(cases) < chance)
    fault = np.where(healthy, "healthy", "internal_leakage")
    verdict = np.where(right, fault, "healthy")
    none = np.full(cases, np.nan)
    leak = np.where(right & ~healthy, flow * 1.02, none)
    if not estimates:
        leak = none
    return table_of(
        case=np.arange(cases), fault=fault.tolist(), verdict=verdict.tolist(), right=right,
        false_alarm=np.zeros(cases, dtype=bool), lost=np.zeros(cases, dtype=bool),
        leak_true_m3_per_s=np.where(healthy, np.nan, flow), leak_m3_per_s=leak,
        leak_low_m3_per_s=leak * 0.9, leak_high_m3_per_s=leak * 1.1,
        latency_s=np.where(right & ~healthy, 2.0, np.nan),
        score=np.where(healthy, 0.0, np.log(flow)) + random.normal(0.0, 1.0, cases),
    )  # fmt: skip


def test_the_smallest_leak_found_is_that_of_the_curve_it_was_drawn_by() -> None:
    curve = study_of(leaks(4000, 0.2)).power["all"]
    assert curve.limit_m3_per_s is not None
    assert curve.interval_m3_per_s is not None
    low, high = (end / LITRE_PER_MINUTE for end in curve.interval_m3_per_s)
    assert low < 0.2 < high
    assert high / low < 1.5


def test_its_interval_holds_it_as_often_as_it_says() -> None:
    held = 0
    for seed in range(60):
        interval = study_of(leaks(600, 0.2, seed=seed)).power["all"].interval_m3_per_s
        assert interval is not None
        held += interval[0] < 0.2 * LITRE_PER_MINUTE < interval[1]
    assert stats.binomtest(held, 60, 0.95).pvalue > 1e-3


@pytest.mark.parametrize("limit", [1e-4, 1e4])
def test_no_smallest_leak_is_reported_that_the_cases_do_not_bracket(limit: float) -> None:
    curve = study_of(leaks(500, limit)).power["all"]
    assert curve.bins
    assert curve.limit_m3_per_s is None


def test_the_area_below_the_roc_is_the_chance_that_a_leak_scores_above_a_healthy_rig() -> None:
    table = leaks(400, 0.2)
    score, fault = np.array(table["score"]), np.array(table["fault"])
    healthy, leaky = score[fault == "healthy"], score[fault != "healthy"]
    chance = stats.mannwhitneyu(leaky, healthy).statistic / (leaky.size * healthy.size)
    roc = study_of(table).roc["all"]
    assert roc.area == pytest.approx(chance)
    assert (roc.found[0], roc.false_alarms[0]) == (0.0, 0.0)
    assert (roc.found[-1], roc.false_alarms[-1]) == (1.0, 1.0)


@given(st.integers(0, 50), st.integers(0, 50))
def test_a_share_lies_in_its_interval_which_is_wilsons(count: int, more: int) -> None:
    share = Share(count, count + more)
    low, high = share.interval
    assert 0.0 <= low <= high <= 1.0
    if share.of:
        reference = stats.binomtest(count, share.of).proportion_ci(method="wilson")
        assert (low, high) == pytest.approx((reference.low, reference.high))


def test_cases_are_counted_by_fault_and_verdict_and_sized() -> None:
    study: Study = study_of(leaks(300, 0.2))
    counts = [count for row in study.confusion.values() for count in row.values()]
    assert sum(counts) == study.cases == 300
    assert study.right["healthy"].part == 1.0
    assert study.latency_s == (2.0, 2.0)
    assert study.sizing is not None
    assert study.sizing["relative_bias"] == pytest.approx(0.02)
    assert study.sizing["in_interval"]["part"] == 1.0
    assert study_of(leaks(300, 0.2, estimates=False)).sizing is None


def test_a_sweep_of_leaks_alone_has_no_roc() -> None:
    table = leaks(300, 0.2)
    only = table.filter(pa.compute.not_equal(table["fault"], "healthy"))
    study = study_of(only)
    assert study.roc == {}
    assert study.false_alarms.of == 0
    assert study.plain()["false_alarms"]["part"] is None
