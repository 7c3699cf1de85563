"""Cases pass the bands of their limits by the rules of a campaign's limits."""

from dataclasses import replace
from math import inf

import numpy as np
import pytest
from numpy.typing import NDArray

from control import Constant
from faults import CampaignTest, Expression, OwnFigure, TestLimit, Verdict
from rig.runner.outcomes.limits import LimitWatch
from rig.sweep.crossing import crossings_of

Array = NDArray[np.float64]
TIME_S: Array = np.arange(4000, dtype=np.float64) * 1e-3


def channels(values: Array) -> dict[str, Array]:
    return {"time_s": TIME_S[: values.size], "pressure_1_Pa": values}


def limit(**given: object) -> TestLimit:
    bands = {"low": -inf, "high": 1.0, "action": "trip"}
    return TestLimit("pressure_1_Pa", "Pa", **bands | given)  # type: ignore[arg-type]


def campaign_passings(watched: TestLimit, values: Array) -> list[tuple[str, float]]:
    """Return band and time of each passing as a campaign judges a quantity of its own."""
    own = OwnFigure("mine", Expression("pressure_1_Pa + 0"), "Pa")
    named = replace(watched, watched="mine")
    test = CampaignTest(
        "", "", 4.0, 0.0, 0.0, Constant(0.3), None, (), Verdict.HEALTHY, 1, 0,
        own_figures=(own,), limits=(named,),
    )  # fmt: skip
    rows = np.column_stack([TIME_S, values])
    passed = LimitWatch(test, ("time_s", "pressure_1_Pa")).take(rows, None)
    return sorted((each.band, each.at_s) for each in passed)


@pytest.mark.parametrize("seed", range(6))
def test_passings_are_those_of_a_campaign(seed: int) -> None:
    walk = np.cumsum(np.random.default_rng(seed).normal(size=4000)) * 0.03
    low, high = np.percentile(walk, [5.0, 80.0]).tolist()
    watched = limit(low=low, high=high, inner_high=high - 0.2, hysteresis=0.05, for_s=0.01 * seed)
    found = [(each.band, each.at_s) for each in crossings_of(watched, channels(walk))]
    assert sorted(found) == campaign_passings(watched, walk)
    assert found


def test_a_passing_must_last_and_the_value_come_back_before_it_counts_again() -> None:
    values = np.zeros(4000)
    values[100:150] = 2.0  # too short
    values[200:400] = 2.0
    values[400:450] = 0.95  # not back by the hysteresis
    values[450:500] = 2.0
    values[600:800] = -3.0
    watched = limit(low=-1.0, for_s=0.1, hysteresis=0.1)
    found = crossings_of(watched, channels(values))
    assert [each.at_s for each in found] == pytest.approx([0.3, 0.7])
    assert [(each.value, each.end) for each in found] == [(2.0, 1.0), (-3.0, -1.0)]


def test_a_limit_holds_in_its_segments_only_and_begins_anew_in_each() -> None:
    values = np.full(4000, 2.0)
    found = crossings_of(limit(windows_s=((1.0, 1.5), (3.0, 3.5)), for_s=0.2), channels(values))
    assert [each.at_s for each in found] == pytest.approx([1.2, 3.2])


def test_a_figure_is_judged_every_50_ms_once_there_is_enough_of_the_stretch() -> None:
    values = np.where(TIME_S < 2.0, 0.0, 4.0)
    watched = limit(over_s=1.0, expression=Expression("mean(pressure_1_Pa)"))
    (found,) = crossings_of(watched, channels(values))
    # The mean over the last second is above 1 from a quarter of a second after the step on.
    assert 2.25 < found.at_s <= 2.3
    early = limit(over_s=1.0, high=-1.0, expression=Expression("mean(pressure_1_Pa)"))
    assert crossings_of(early, channels(values))[0].at_s == pytest.approx(1.0, abs=0.05)


def test_a_value_that_is_not_known_passes_nothing() -> None:
    assert not crossings_of(limit(), channels(np.full(100, np.nan)))
