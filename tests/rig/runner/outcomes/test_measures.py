"""What figures say of a motion, and what becomes of the criteria on them."""

from math import inf, nan

import numpy as np
import pytest

from control import Steps
from faults import CampaignTest, Criterion, Expression, OwnFigure, TestLimit
from rig.runner.campaign.bench import plain_test
from rig.runner.outcomes.limits import LimitWatch
from rig.runner.outcomes.measures import CriterionResult, Measures

CHANNELS = ("time_s", "setpoint_m", "position_m", "load_N")


def a_test(**more: object) -> CampaignTest:
    plain = plain_test("a", Steps((0.2, 0.3), 1.0), 3.0, 0.2, 1.0)
    return CampaignTest(**{**vars(plain), **more})


def rows(overshoot: float = 0.1, settles_s: float = 0.5) -> np.ndarray:
    time = 1e-3 * np.arange(3000)
    setpoint = np.where(time < 1.0, 0.2, 0.3)
    position = setpoint.copy()
    rising = (time >= 1.0) & (time < 1.0 + settles_s - 5e-4)
    position[rising] = 0.3 + 0.1 * overshoot
    return np.column_stack([time, setpoint, position, np.full(3000, 5.0)])


def measured(criterion: Criterion, *batches: np.ndarray, **more: object) -> CriterionResult:
    measures = Measures(a_test(criteria=(criterion,), **more), CHANNELS)
    for batch in batches or np.array_split(rows(), 7):
        measures.take(batch)
    (result,) = measures.results({}, None)
    return result


@pytest.mark.parametrize(
    ("figure", "value"),
    [("overshoot", 0.1), ("settling", 0.5), ("peak", 0.31), ("valley", 0.2), ("peak_error", 0.01)],
)
def test_figures_of_a_step(figure: str, value: float) -> None:
    assert measured(Criterion(figure, 0.0, 1.0, "m")).value == pytest.approx(value)


def test_an_rms_error_counts_its_stretch_only() -> None:
    whole = measured(Criterion("rms_error", 0.0, 1.0, "m"))
    assert whole.value == pytest.approx(0.01 * np.sqrt(500 / 3000))
    later = measured(Criterion("rms_error", 0.0, 1.0, "m", from_s=1.0, until_s=1.5))
    assert later.value == pytest.approx(0.01)


def test_a_ram_that_does_not_settle_never_meets_its_criterion() -> None:
    result = measured(Criterion("settling", -inf, 9.0, "s"), rows(settles_s=9.0))
    assert (result.value, result.met) == (inf, False)
    assert str(result) == "settling never, at most 9 s"


def test_a_criterion_on_what_is_not_known_is_not_met() -> None:
    result = measured(Criterion("overshoot", -inf, 1.0, ""), rows()[:900])
    assert np.isnan(result.value)
    assert not result.met
    assert "not known" in str(result)


def test_own_figures_are_kept_and_judged() -> None:
    own = OwnFigure("pull", Expression("max(load_N) - 1"), "N")
    criterion = Criterion("pull", -inf, 3.0, "N")
    result = measured(criterion, own_figures=(own,))
    assert (result.value, result.met) == (4.0, False)
    assert str(result) == "pull 4 N, at most 3 N"
    measures = Measures(a_test(own_figures=(own,)), CHANNELS)
    measures.take(rows())
    assert measures.figures({}, None)["pull"].value == 4.0


# Limits


def watch(limit: TestLimit, **more: object) -> LimitWatch:
    watched = LimitWatch(a_test(limits=(limit,), **more), CHANNELS)
    for batch in np.array_split(rows(), 7):
        watched.take(batch, None)
    return watched


def test_a_passing_names_limit_value_and_time() -> None:
    watched = watch(TestLimit("following_error_m", "m", high=5e-3, action="ramp_down"))
    (passing,) = watched.passed
    assert str(passing) == "following_error_m 10 mm above 5 mm at 1.000 s: ramp_down"
    assert (watched.acted, watched.due) == (passing, None)


def test_bands_are_passed_each_by_itself_and_after_their_time() -> None:
    limit = TestLimit(
        "following_error_m", "m", high=8e-3, inner_high=3e-3, action="hold", for_s=0.1
    )
    passed = watch(limit).passed
    assert [(each.band, each.action) for each in passed] == [("inner", "warn"), ("outer", "hold")]
    assert [each.at_s for each in passed] == pytest.approx([1.1, 1.1])
    assert not watch(TestLimit("following_error_m", "m", high=8e-3, for_s=0.6)).passed


def test_a_figure_over_its_last_seconds_is_the_runners_to_act_on() -> None:
    own = OwnFigure("pull", Expression("mean(load_N)"), "N")
    limit = TestLimit("pull", "N", high=3.0, action="hold", over_s=1.0)
    watched = watch(limit, own_figures=(own,))
    assert watched.acts
    assert watched.due is not None
    assert watched.due.at_s >= 1.0


def test_a_value_that_is_not_known_passes_no_limit() -> None:
    nothing = LimitWatch(a_test(limits=(TestLimit("load_N", "N", high=1.0),)), CHANNELS)
    unknown = rows()
    unknown[:, 3] = nan
    assert nothing.take(unknown, None) == []


def test_within_its_hysteresis_a_band_stays_passed() -> None:
    limit = TestLimit("load_N", "N", high=4.0, hysteresis=1.0, action="warn")
    batch = rows()
    batch[1000:1500, 3] = 3.5
    batch[1500:2000, 3] = 2.0
    watched = LimitWatch(a_test(limits=(limit,)), CHANNELS)
    watched.take(batch, None)
    assert [each.at_s for each in watched.passed] == [0.0, 2.0]


def test_what_a_loop_counted_a_tick_earlier_is_noted_when_it_has_tripped() -> None:
    limit = TestLimit("load_N", "N", high=4.0, for_s=0.5, action="trip")
    watched = LimitWatch(a_test(limits=(limit,)), CHANNELS)
    watched.take(rows()[:499], None)
    assert watched.acted is None
    watched.close()
    assert watched.acted is not None
    assert str(watched.acted) == "load_N 5 N above 4 N at 0.498 s: trip"
    early = LimitWatch(a_test(limits=(limit,)), CHANNELS)
    early.take(rows()[:100], None)
    early.close()
    assert early.acted is None
