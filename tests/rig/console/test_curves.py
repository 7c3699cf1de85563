"""The charts show the last ten seconds, and moving averages that have seen every sample.

Hours of the curves are kept by their extremes, and gaps stay gaps.
"""

import json
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rig.console.curves import AVERAGED_S, CHANNELS, CURVES, KEPT, POINTS, Curves, MovingAverage
from rig.console.history import MOST_STEPS, History, Taken
from rig.stream.known import Window

from .site import Site

MS = 1e-3


def window(first_row: int, rows: int, test: int = 1, **given: Any) -> Window:
    number = np.arange(first_row, first_row + rows, dtype=np.int64)
    none = np.full(rows, np.nan, np.float32)
    values = {name: np.asarray(given.get(name, none), np.float32) for name in CHANNELS}
    return Window(
        number, np.asarray(number * MS, np.float64), np.full(rows, test, np.int64), values
    )


def shown(curves: Curves, count: int = 0) -> dict[str, Any]:
    points = curves.since(count)
    assert points is not None
    return points


def test_a_hundred_points_a_second_in_the_units_of_the_screen() -> None:
    curves = Curves()
    ramp = np.arange(1000) * 1e-4
    curves.take(window(0, 1000, position_m=ramp, pressure_1_Pa=np.full(1000, 7.5e6)), MS)
    points = shown(curves)
    assert points["time_s"] == pytest.approx(np.arange(100) * 0.01)
    assert points["position_mm"] == pytest.approx(np.arange(100) * 1.0, abs=0.01)
    assert set(points["pressure_1_MPa"]) == {7.5}
    assert set(points["leak_L_per_min"]) == {None}
    assert set(points) == {"epoch", "time_s", "test", *CURVES}


def test_what_was_shown_is_not_shown_again() -> None:
    curves = Curves()
    curves.take(window(0, 1000), MS)
    count = curves.count
    curves.take(window(500, 700), MS)
    assert shown(curves, count)["time_s"] == pytest.approx(np.arange(1.0, 1.2, 0.01))
    assert curves.since(curves.count) is None


def test_the_last_ten_seconds_are_kept() -> None:
    curves = Curves()
    for first in range(0, 20_000, 1000):
        curves.take(window(first, 1000), MS)
    points = shown(curves)
    assert len(points["time_s"]) == POINTS
    assert points["time_s"][0] == pytest.approx(10.0)
    assert len(shown(curves, curves.count - 3)["time_s"]) == 3


def test_another_run_begins_anew() -> None:
    curves = Curves()
    curves.take(window(50_000, 1000), MS)
    curves.take(window(0, 500), MS)
    points = shown(curves)
    assert (points["epoch"], len(points["time_s"])) == (1, 50)


def test_a_slow_rig_has_all_of_its_samples_shown() -> None:
    curves = Curves()
    number = np.arange(40, dtype=np.int64)
    values = {name: np.zeros(40, np.float32) for name in CHANNELS}
    curves.take(
        Window(number, np.asarray(number * 0.05, np.float64), np.ones(40, np.int64), values), 0.05
    )
    assert shown(curves)["time_s"] == pytest.approx(np.arange(40) * 0.05)


def test_between_the_samples_of_a_slower_device_a_point_has_the_newest_value() -> None:
    curves = Curves()
    position = np.full(240, np.nan)
    position[3:120:4] = 0.001 * np.arange(3, 120, 4)
    for first in (0, 77):
        part = slice(first, 77 if first == 0 else 240)
        rows = np.arange(240)[part]
        curves.take(window(first, len(rows), position_m=position[part]), 1e-3)
    points = shown(curves)["position_mm"]
    # Nothing was measured before the first sample, nor for longer than a tenth of a second.
    assert points[:12] == [None, *(float(4 * (row // 4) - 1) for row in range(10, 120, 10))]
    assert points[12:22] == [119.0] * 10
    assert points[22:] == [None, None]


def test_the_residuals_of_one_test_are_not_averaged_with_those_of_the_next() -> None:
    curves = Curves()
    curves.take(window(0, 2000, 1, innovation_pressure_1_Pa=np.full(2000, 4e4)), MS)
    curves.take(window(2000, 2000, 2, innovation_pressure_1_Pa=np.full(2000, -1e4)), MS)
    averages = shown(curves)["average_1_kPa"]
    assert set(averages[:200]) == {40.0}
    assert set(averages[200:]) == {10.0}


@given(
    st.lists(st.floats(-1e6, 1e6, width=32) | st.just(float("nan")), max_size=200),
    st.lists(st.integers(0, 200), max_size=5),
)
def test_the_moving_average_is_the_mean_of_the_last_however_they_come(
    values: list[float], cuts: list[int]
) -> None:
    count = 7
    edges = sorted({0, *(min(cut, len(values)) for cut in cuts), len(values)})
    average = MovingAverage(count)
    parts = [np.array(values[a:b], float) for a, b in pairwise(edges)]
    found = np.concatenate([average.take(part) for part in parts] or [np.empty(0)])
    for k, mean in enumerate(found):
        last = np.abs(values[max(0, k + 1 - count) : k + 1])
        last = last[np.isfinite(last)]
        if len(last):
            assert mean == pytest.approx(last.mean(), abs=1e-6 * (1.0 + np.nanmax(np.abs(values))))
        else:
            assert np.isnan(mean)


def test_the_window_is_that_of_the_thesis() -> None:
    from estimator.filters.residuals import THESIS_WINDOW

    assert pytest.approx(THESIS_WINDOW) == AVERAGED_S / MS


def test_the_history_gets_every_sample_and_each_average_once() -> None:
    curves = Curves()
    peak = np.zeros(1000)
    peak[123] = 5e3
    ones = np.ones(1000)
    first = curves.take(window(0, 1000, load_N=peak, innovation_pressure_1_Pa=ones), MS)
    assert first is not None
    kept = dict(zip(KEPT, first.curves, strict=True))
    assert kept["load_kN"][123] == pytest.approx(5.0)
    assert np.isfinite(kept["average_1_kPa"]).all()
    curves.begin()
    again = curves.take(window(0, 1000, load_N=peak, innovation_pressure_1_Pa=ones), MS)
    assert again is not None
    assert np.isnan(dict(zip(KEPT, again.curves, strict=True))["average_1_kPa"]).all()


NOW_S = 1.8e9


def taken(first_row: int, values: Any) -> Taken:
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


def test_what_was_kept_before_the_clock_was_set_back_is_not_mixed_with_what_comes() -> None:
    history = History(("load_kN",))
    rows = np.arange(1000)
    history.take(Taken(rows, 0.01, np.full((1, 1000), 2.0)), 10_000.0)
    history.take(Taken(rows + 1000, 0.01, np.full((1, 1000), 1.0)), 9_995.0)
    kept = history.stretch(10_000.0, 20.0)
    assert np.nanmax(kept.high) == 1.0
