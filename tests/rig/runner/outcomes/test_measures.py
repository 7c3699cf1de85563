"""What figures say of a motion, and what becomes of the criteria on them."""

from math import inf

import numpy as np
import pytest

from control import Steps
from faults import CampaignTest, Criterion, Expression, OwnFigure
from rig.runner.campaign.bench import plain_test
from rig.runner.outcomes.measures import CriterionResult, Measures
from rig.runner.outcomes.timeline import Timeline

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


def test_a_segments_figure_is_of_when_the_segment_took_place() -> None:
    timeline = Timeline()
    timeline.skip(1.0, 6.0)
    criterion = Criterion("peak", 0.0, 1.0, "m", during="late", from_s=6.0, until_s=6.4)
    measures = Measures(a_test(criteria=(criterion,)), CHANNELS, timeline)
    measures.take(rows())
    (result,) = measures.results({}, None)
    assert result.value == pytest.approx(0.31)
