"""The console keeps hours of a rig's curves by their extremes, and gaps stay gaps."""

import json

import numpy as np
import pytest

from rig.console.history import MOST_STEPS, History, Taken

from .site import Site

NOW_S = 1.8e9
MS = 1e-3


def taken(first_row: int, values: np.ndarray) -> Taken:
    rows = np.arange(first_row, first_row + len(values), dtype=np.int64)
    return Taken(rows, MS, np.asarray([values], np.float64))


def test_a_peak_of_one_sample_is_seen_over_eight_hours() -> None:
    history = History(("load_kN",))
    values = np.zeros(5000)
    values[2345] = 7.0
    history.take(taken(0, values), NOW_S)
    for span_s in (10.0, 60.0, 600.0, 3600.0, 8 * 3600.0):
        found = history.stretch(NOW_S + 1.0, span_s)
        assert np.nanmax(found.high) == 7.0
        assert np.nanmin(found.low) == 0.0
        assert found.low.shape[1] <= MOST_STEPS


def test_a_pause_between_two_runs_is_a_gap() -> None:
    history = History(("load_kN",))
    history.take(taken(0, np.ones(1000)), NOW_S)
    history.take(taken(0, np.full(1000, 2.0)), NOW_S + 30.0)
    found = history.stretch(NOW_S + 31.0, 60.0, steps=60)
    there = np.isfinite(found.high[0])
    assert 2 <= there.sum() <= 5
    assert set(found.high[0][there]) == {1.0, 2.0}


def test_samples_that_are_taken_twice_change_nothing() -> None:
    history = History(("load_kN",))
    ramp = taken(0, np.arange(500.0))
    history.take(ramp, NOW_S)
    before = history.stretch(NOW_S + 1.0, 10.0)
    history.take(ramp, NOW_S)
    after = history.stretch(NOW_S + 1.0, 10.0)
    np.testing.assert_array_equal(before.high, after.high)
    np.testing.assert_array_equal(before.low, after.low)


def test_what_is_older_than_the_finest_steps_is_told_in_longer_ones() -> None:
    history = History(("load_kN",))
    for second in range(0, 1300, 1):
        history.take(taken(1000 * second, np.full(100, float(second))), NOW_S + second)
    late = history.stretch(NOW_S + 1299.0, 10.0)
    assert late.step_s == pytest.approx(0.01)
    early = history.stretch(NOW_S + 100.0, 10.0)
    assert early.step_s == pytest.approx(0.1)
    assert np.nanmax(early.high) in (99.0, 100.0)


def test_who_is_logged_in_is_sent_a_stretch(site: Site) -> None:
    anna = site.cookie()
    query = "/history?rig=bench&span_s=10&steps=100"
    assert site.ask("GET", query).status == 401
    assert site.ask("GET", "/history?rig=other", headers=anna).status == 404
    assert site.ask("GET", query + "&span_s=99999999", headers=anna).status == 400
    assert site.ask("GET", query + "&end_ms=soon", headers=anna).status == 400
    reply = site.ask("GET", query + "&names=load_kN", headers=anna)
    head = json.loads(reply.headers["x-history"])
    assert head["names"] == ["load_kN"]
    assert head["count"] <= 100
    assert int(reply.headers["content-length"]) == 2 * 4 * head["count"]
