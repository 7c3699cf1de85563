"""Trials of leaks that come and go are what the condition asks for, and are judged by it."""

from dataclasses import replace

import numpy as np
import pytest

from rig.plant import LEAKS
from rig.recording import Recording
from tools.intermittent.__main__ import table
from tools.intermittent.judging import Outcome
from tools.intermittent.trials import GATES, ONSET_S, Course, openings, plans

RIGHT = Outcome(
    1, 0, "internal_leakage", "position", True, 100.0, 8, 0.3, 0.2, "internal_leakage", True, 41.0,
    True, 8, 0.31, 0.25, 0.36, 0.2, 0.18, 0.22, "position",
)  # fmt: skip


def test_all_places_and_all_gates_are_among_the_trials() -> None:
    found = plans(31, 36)
    assert {plan.leak for plan in found} == set(LEAKS)
    assert {plan.gate for plan in found} == set(GATES)
    assert all(plan.independent for plan in found if plan.gate != "time")
    by_time = [plan for plan in found if plan.gate == "time"]
    assert len(by_time) == 18
    assert sum(plan.independent for plan in by_time) == 9


@pytest.mark.parametrize("seed", range(5))
def test_openings_by_time_last_a_second_or_more(seed: int) -> None:
    shown, period, stay = openings(np.random.default_rng(seed), 100_000)
    edges = np.flatnonzero(np.diff(np.r_[False, shown, False].astype(np.int8)))
    lasted = (edges[1::2] - edges[::2]) / 1000.0
    assert lasted[:-1].min() >= 1.0
    assert edges[0] == round(1000.0 * ONSET_S)
    assert lasted.size >= 6
    assert 1.0 <= stay < period


def test_moments_in_which_the_leak_shuts_do_not_divide_an_opening() -> None:
    flow = np.zeros(10_000)
    flow[1000:3000] = 0.2
    flow[2000:2100] = 0.0
    flow[5000:5500] = 0.2
    course = Course(Recording({"time_s": np.arange(10_000, dtype=np.float64) * 1e-3}), flow)
    assert course.openings == 1
    assert course.duty == pytest.approx(2.4 / 9.0)
    assert course.mean_flow == pytest.approx(0.2)


def test_a_trial_counts_within_the_condition_only() -> None:
    assert RIGHT.counts
    assert RIGHT.right
    assert not replace(RIGHT, openings=5).counts
    assert not replace(RIGHT, flow=0.09).counts
    assert not replace(RIGHT, verdict="external_leakage_1").right


def test_the_table_has_a_row_for_each_place_and_gate() -> None:
    rows = table([RIGHT, replace(RIGHT, verdict="healthy", intermittent=False)]).splitlines()
    assert rows[2].startswith("| internal leakage | 2 | 1 | 0 | 21 s | 1 of 1 | 1 of 1 | 1 | 0 |")
    assert [row.split("|")[1].strip() for row in rows[3:]] == [
        "opened by position",
        "independent rig",
        "all",
    ]
