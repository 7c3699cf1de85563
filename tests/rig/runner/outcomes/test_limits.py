"""Which limits were passed, in words, and which of them the runner must act on."""

from math import inf, nan

import numpy as np
import pytest

from faults import Expression, OwnFigure, TestLimit
from rig.io.limits import ChannelLimit
from rig.loop.interlocks.ladder import rungs_of
from rig.loop.interlocks.passings import RungPassed
from rig.runner.outcomes.limits import LimitWatch
from rig.runner.outcomes.timeline import Timeline

from .test_measures import a_test, rows

CHANNELS = ("time_s", "setpoint_m", "position_m", "oil_temperature_K")
NONE = np.empty((0, 4))


def watch(limit: TestLimit, **more: object) -> LimitWatch:
    watched = LimitWatch(a_test(limits=(limit,), **more), CHANNELS)
    for batch in np.array_split(rows(), 7):
        watched.take(batch, None)
    return watched


def test_what_the_loop_counted_is_told_with_limit_value_and_time() -> None:
    limit = TestLimit("following_error_m", "m", high=5e-3, action="ramp_down", for_s=0.2)
    watched = LimitWatch(a_test(limits=(limit,)), CHANNELS)
    (passing,) = watched.take(NONE, None, [RungPassed(3, 1000, 0, 0.01)])
    assert str(passing) == "following_error_m 10 mm above 5 mm at 1.000 s: ramp_down"
    assert (passing.since_s, passing.of) == (0.8, "test")
    assert (watched.acted, watched.due, watched.acts) == (passing, None, False)


def test_the_loop_alone_counts_what_it_judges() -> None:
    assert not watch(TestLimit("following_error_m", "m", high=5e-3)).passed


def test_limits_of_the_rig_are_told_beside_those_of_the_test() -> None:
    ladder = (ChannelLimit("pressure_1_Pa", -inf, 2e7, "trip", 0.003),)
    limit = TestLimit("position_m", "m", low=0.1, inner_low=0.2, action="hold")
    watched = LimitWatch(a_test(limits=(limit,)), CHANNELS, ladder)
    found = [RungPassed(1, 9, 0, 2.1e7), RungPassed(1, 5, 1, 0.19), RungPassed(1, 7, 2, 0.09)]
    passed = watched.take(NONE, None, found)
    assert [(each.of, each.band, each.action) for each in passed] == [
        ("test", "inner", "warn"), ("test", "outer", "hold"), ("rig", "outer", "trip"),
    ]  # fmt: skip
    assert watched.acted == passed[1]


def test_a_band_with_several_stretches_has_a_rung_for_each() -> None:
    limit = TestLimit("position_m", "m", high=0.5, during="a", windows_s=((0.0, 1.0), (3.0, 4.0)))
    assert [(each.from_s, each.until_s) for each in rungs_of((limit,))] == [(0.0, 1.0), (3.0, 4.0)]
    watched = LimitWatch(a_test(limits=(limit,)), CHANNELS)
    (passing,) = watched.take(NONE, None, [RungPassed(1, 3500, 1, 0.6)])
    assert (passing.limit, passing.at_s) == (0.5, 3.5)


def test_bands_are_passed_each_by_itself_and_after_their_time() -> None:
    limit = TestLimit(
        "oil_temperature_K", "K", high=4.8, inner_high=4.5, action="hold", for_s=0.1
    )  # fmt: skip
    passed = watch(limit).passed
    assert [(each.band, each.action) for each in passed] == [("inner", "warn"), ("outer", "hold")]
    assert [each.at_s for each in passed] == pytest.approx([0.1, 0.1])
    assert [each.since_s for each in passed] == [0.0, 0.0]
    assert not watch(TestLimit("oil_temperature_K", "K", high=4.8, for_s=3.6)).passed


def test_a_limit_of_a_segment_begins_anew_where_the_segment_does() -> None:
    limit = TestLimit(
        "oil_temperature_K", "K", high=4.8, for_s=0.4, during="late", windows_s=((11.0, 12.0),)
    )  # fmt: skip
    timeline = Timeline()
    timeline.skip(0.5, 10.0)
    watched = LimitWatch(a_test(limits=(limit,)), CHANNELS, (), timeline)
    for batch in np.array_split(rows(), 60):
        watched.take(batch, None)
    (passing,) = watched.passed
    assert passing.at_s == pytest.approx(1.9, abs=0.06)
    assert watched.due == passing


def test_a_figure_over_its_last_seconds_is_the_runners_to_act_on() -> None:
    own = OwnFigure("heat", Expression("mean(oil_temperature_K)"), "K")
    limit = TestLimit("heat", "K", high=3.0, action="hold", over_s=1.0)
    watched = watch(limit, own_figures=(own,))
    assert watched.acts
    assert watched.due is not None
    assert watched.due.at_s >= 1.0


def test_a_figure_of_every_test_is_watched_by_its_own_expression() -> None:
    expression = Expression("max(abs(setpoint_m - position_m))")
    limit = TestLimit("peak_error", "m", high=5e-3, over_s=0.5, expression=expression)
    due = watch(limit).due
    assert due is not None
    assert due.at_s >= 1.0


def test_a_value_that_is_not_known_passes_no_limit() -> None:
    nothing = LimitWatch(a_test(limits=(TestLimit("oil_temperature_K", "K", high=1.0),)), CHANNELS)
    unknown = rows()
    unknown[:, 3] = nan
    assert nothing.take(unknown, None) == []


def test_within_its_hysteresis_a_band_stays_passed() -> None:
    limit = TestLimit("oil_temperature_K", "K", high=4.0, hysteresis=1.0, action="warn")
    batch = rows()
    batch[1000:1500, 3] = 3.5
    batch[1500:2000, 3] = 2.0
    watched = LimitWatch(a_test(limits=(limit,)), CHANNELS)
    watched.take(batch, None)
    assert [each.at_s for each in watched.passed] == [0.0, 2.0]
