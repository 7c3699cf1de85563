"""Figures of steps, cycles, segments and tests are limits that are judged when they are known."""

from itertools import pairwise
from math import inf, isfinite, nan

import numpy as np
import pytest

from control import Sequence, Sine, Stretch
from estimator.leaks import Decision
from faults import CampaignTest, Expression, OwnFigure, TestLimit
from rig.runner.campaign.bench import plain_test
from rig.runner.outcomes.figures import Figure
from rig.runner.outcomes.limits import LimitPassed, LimitWatch
from rig.runner.outcomes.measures import StepFollower, step_answers
from rig.runner.outcomes.timeline import Timeline

from .test_measures import CHANNELS, a_test, rows

RMS = Expression("rms(setpoint_m - position_m)")


def watch(test: CampaignTest, samples: np.ndarray, batches: int = 7) -> LimitWatch:
    watched = LimitWatch(test, CHANNELS)
    for batch in np.array_split(samples, batches):
        watched.take(batch, None)
    watched.finish(None, dict)
    return watched


def passed(limit: TestLimit, samples: np.ndarray, batches: int = 7) -> list[LimitPassed]:
    return watch(a_test(limits=(limit,)), samples, batches).passed


def cycling(*limits: TestLimit) -> CampaignTest:
    """Return a test of three cycles of 1 s, whose rows are those of `errors`."""
    plain = plain_test("a", Sine(0.3, 0.1, 1.0), 3.0, 0.3, 1.0)
    return CampaignTest(**{**vars(plain), "limits": limits})


def errors(*in_cycles: float) -> np.ndarray:
    time = 1e-3 * np.arange(1000 * len(in_cycles))
    setpoint = 0.3 + 0.1 * np.sin(2 * np.pi * time)
    position = setpoint - np.repeat(in_cycles, 1000)
    return np.column_stack([time, setpoint, position, np.full(len(time), 5.0)])


def random_steps(seed: int) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(seed)
    setpoint = np.repeat(rng.choice([0.2, 0.2005, 0.3, 0.5], 12), rng.integers(1, 60, 12))
    position = setpoint + rng.normal(0.0, 0.02, setpoint.size)
    position[rng.random(setpoint.size) < 0.05] = nan
    return {
        "time_s": 1e-3 * np.arange(setpoint.size), "setpoint_m": setpoint, "position_m": position,
    }  # fmt: skip


@pytest.mark.parametrize("seed", range(8))
def test_steps_are_the_same_however_their_samples_come(seed: int) -> None:
    columns = random_steps(seed)
    follower, parts = StepFollower(), []
    cuts = np.sort(np.random.default_rng(seed).integers(0, columns["time_s"].size, 9))
    for part in zip(*(np.split(each, cuts) for each in columns.values()), strict=True):
        parts += follower.take(*part)
    last = follower.finish()
    over = [each for each in (*parts, last) if each is not None and each.is_over]
    found = [(float(each.overshoot[-1]), float(each.settling_s[-1])) for each in over]
    assert found == step_answers(columns)
    for before, after in pairwise(parts):
        if before.begin_s == after.begin_s and before.times_s.size and after.times_s.size:
            assert before.overshoot[-1] <= after.overshoot[0]
            assert before.settling_s[-1] <= after.settling_s[0] + 1e-9 or after.is_over


@pytest.mark.parametrize("batches", [1, 7, 60])
def test_an_overshoot_is_acted_on_at_the_sample_that_shows_it(batches: int) -> None:
    samples = rows()
    samples[1200:1300, 2] = 0.3 + 0.1 * 0.3
    limit = TestLimit("overshoot", "", high=0.2, inner_high=0.05, action="hold", each="step")
    inner, outer = passed(limit, samples, batches)
    assert (inner.band, inner.at_s, inner.action) == ("inner", 1.0, "warn")
    assert (outer.band, outer.action) == ("outer", "hold")
    assert (outer.at_s, outer.since_s) == pytest.approx((1.2, 1.0))
    assert str(outer) == (
        "overshoot of the step from 1.000 s 0.3 above 0.2 at 1.200 s: hold"
    )  # fmt: skip


def test_a_settling_time_is_acted_on_as_soon_as_it_is_too_long() -> None:
    limit = TestLimit("settling", "s", high=0.3, action="trip", each="step")
    (passing,) = passed(limit, rows(settles_s=0.5))
    assert passing.at_s == pytest.approx(1.3)
    assert passing.value == pytest.approx(0.301)
    within = TestLimit("settling", "s", high=0.5, action="trip", each="step")
    assert passed(within, rows(settles_s=0.5)) == []


def test_a_ram_that_had_not_settled_when_its_step_ended_is_beyond_any_limit() -> None:
    limit = TestLimit("settling", "s", high=9.0, action="warn", each="step")
    (passing,) = passed(limit, rows(settles_s=9.0))
    assert passing.value == inf
    assert str(passing) == (
        "settling of the step from 1.000 s did not settle, above 9 s at 2.999 s: warn"
    )


def test_a_figure_that_can_only_grow_is_below_a_limit_only_at_its_end() -> None:
    limit = TestLimit("overshoot", "", low=0.2, action="warn", each="step")
    (passing,) = passed(limit, rows(overshoot=0.1))
    assert passing.at_s == pytest.approx(2.999)
    assert passed(limit, rows(overshoot=0.3)) == []


@pytest.mark.parametrize("batches", [1, 7, 60])
def test_each_cycle_is_judged_as_it_ends(batches: int) -> None:
    limit = TestLimit("rms_error", "m", high=5e-3, action="warn", expression=RMS, each="cycle")
    found = watch(cycling(limit), errors(2e-3, 6e-3, 7e-3), batches).passed
    assert [each.value for each in found] == pytest.approx([6e-3, 7e-3])
    assert [each.since_s for each in found] == pytest.approx([1.0, 2.0])
    assert [each.at_s for each in found] == pytest.approx([1.999, 2.999])


def test_the_runner_acts_on_the_first_cycle_beyond_the_outer_band() -> None:
    limit = TestLimit(
        "rms_error", "m", high=5e-3, inner_high=1e-3, action="hold", expression=RMS, each="cycle"
    )
    watched = watch(cycling(limit), errors(2e-3, 6e-3, 7e-3))
    assert watched.acts
    assert watched.due is not None
    assert (watched.due.band, watched.due.action) == ("outer", "hold")
    assert watched.due.at_s == pytest.approx(1.999)


def test_a_cycle_that_the_test_leaves_early_is_not_judged() -> None:
    limit = TestLimit("rms_error", "m", high=5e-3, action="warn", expression=RMS, each="cycle")
    assert watch(cycling(limit), errors(2e-3, 6e-3)[:1500]).passed == []


def test_a_segment_that_ends_early_is_judged_by_what_was_run_of_it() -> None:
    calm = Sine(0.3, 0.01, 1.0)
    segments = Sequence((Stretch(calm, 10.0, "a"), Stretch(calm, 2.0, "b", blend_s=1.0)))
    limits = (
        TestLimit("rms_error", "m", high=5e-3, action="warn", expression=RMS, each="segment"),
        TestLimit(
            "rms_error", "m", high=1e-3, action="warn", expression=RMS, each="segment", during="b"
        ),
    )
    plain = plain_test("a", segments, 13.0, 0.3, 1.0)
    test = CampaignTest(**{**vars(plain), "limits": limits})
    timeline = Timeline()
    watched = LimitWatch(test, CHANNELS, (), timeline)
    samples = errors(6e-3, 6e-3, 2e-3, 2e-3)
    watched.take(samples[:1000], None)
    timeline.skip(1.0, 10.0)
    for batch in np.array_split(samples[1000:], 60):
        watched.take(batch, None)
    first, second = watched.passed
    assert (first.value, second.value) == pytest.approx((6e-3, 2e-3))
    assert (first.since_s, first.at_s) == pytest.approx((0.0, 0.999))
    assert (second.since_s, second.at_s) == pytest.approx((2.0, 3.999))


def test_figures_of_the_whole_test_are_judged_as_it_has_ended() -> None:
    own = OwnFigure("heat", Expression("mean(load_N)"), "N")
    limits = (
        TestLimit("friction_coulomb", "N", high=400.0, action="trip", each="test"),
        TestLimit("heat", "N", high=4.0, action="warn", each="test"),
        TestLimit("leak", "m^3/s", high=1e-6, action="warn", each="test"),
    )
    watched = LimitWatch(a_test(limits=limits, own_figures=(own,)), CHANNELS)
    assert not watched.acts
    assert watched.take(rows(), None) == []
    decision = Decision("internal_leakage", leak_m3_per_s=2e-6)
    found = watched.finish(decision, lambda: {"friction_coulomb": Figure(500.0, None, "N")})
    assert {each.watched: each.value for each in found} == {
        "friction_coulomb": 500.0, "heat": 5.0, "leak": 2e-6,
    }  # fmt: skip
    assert watched.due is not None
    assert watched.due.action == "trip"
    assert all(isfinite(each.at_s) and each.at_s == rows()[-1, 0] for each in found)


def test_a_figure_that_is_not_known_in_the_end_passes_no_limit() -> None:
    limit = TestLimit("friction_coulomb", "N", high=1.0, each="test")
    assert passed(limit, rows()) == []


def test_a_rig_without_the_channels_of_a_figure_is_not_judged_by_it() -> None:
    missed = Expression("missing(wakeup_s)")
    limit = TestLimit("loop_missed", "", high=0.01, over_s=1.0, expression=missed)
    assert passed(limit, rows()) == []


def test_the_share_of_missed_ticks_is_judged_over_the_last_second() -> None:
    limit = TestLimit(
        "loop_missed", "", high=0.01, action="warn", over_s=1.0,
        expression=Expression("missing(wakeup_s)"),
    )  # fmt: skip
    test = a_test(limits=(limit,))
    watched = LimitWatch(test, ("time_s", "setpoint_m", "position_m", "wakeup_s"))
    samples = rows()
    samples[2000:2020, 3] = nan
    for batch in np.array_split(samples, 60):
        watched.take(batch, None)
    (passing,) = watched.passed
    assert 2.01 < passing.at_s < 2.1
