"""Trends: a figure that wears is seen, one that only scatters is not."""

from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from estimator.friction.curve import FrictionCurve, FrictionEstimate
from rig.report.campaign.several_runs import trend_page
from rig.runner.outcomes.figures import figures_of
from rig.runner.run_folder.archive import Run
from rig.runner.run_folder.trend import FEWEST, Trend, trends_of

BEGUN = datetime(2026, 11, 1, tzinfo=UTC)


def run_at(day: float, **values: float | None) -> Run:
    figures = {
        name: {"value": value, "standard_error": 0.01, "unit": "L/min"}
        for name, value in values.items()
    }
    test: dict[str, Any] = {"name": "leaks", "figures": figures}
    started = (BEGUN + timedelta(days=day)).isoformat()
    results = {"name": "night", "rig": "bench", "started": started, "tests": [test]}
    return Run(Path(f"night-{day:g}"), results, "ended")


def trend_in(values: np.ndarray, days: np.ndarray | None = None) -> Trend:
    days = np.arange(len(values)) if days is None else days
    runs = [run_at(float(day), leak=float(value)) for day, value in zip(days, values, strict=True)]
    (trend,) = trends_of(runs)
    return trend


def test_wear_is_seen_with_its_slope_within_the_interval() -> None:
    noise = np.random.default_rng(1).normal(0.0, 0.01, 20)
    trend = trend_in(0.1 + 0.004 * np.arange(20) + noise)
    assert trend.changes
    assert trend.slope is not None
    assert trend.half is not None
    assert abs(trend.slope - 0.004) < trend.half
    assert trend.in_words.startswith("changes: +0.00")


def test_scatter_is_called_a_change_about_as_seldom_as_stated() -> None:
    random = np.random.default_rng(2)
    called = sum(trend_in(0.1 + random.normal(0.0, 0.01, 8)).changes for _ in range(2000))
    # 1 in 100 (the quantile is good to 3 %): 20 expected, 4 standard deviations are 18.
    assert 2 <= called <= 40


def test_too_few_runs_or_all_at_once_tell_no_trend() -> None:
    assert trend_in(np.arange(FEWEST - 1.0)).slope is None
    assert trend_in(np.arange(6.0), days=np.zeros(6)).slope is None


def test_a_figure_that_is_not_known_in_a_run_leaves_no_point() -> None:
    runs = [run_at(0.0, leak=0.1), run_at(1.0, leak=None), run_at(2.0)]
    (trend,) = trends_of(runs)
    assert [point.run for point in trend.points] == ["night-0"]


@pytest.mark.parametrize("slope", [0.0, 0.02])
def test_the_page_says_first_what_changes_and_shows_every_figure(slope: float) -> None:
    noise = np.random.default_rng(3).normal(0.0, 0.001, 10)
    trend = trend_in(0.1 + slope * np.arange(10) + noise)
    page = trend_page([trend], "night <1>")
    assert "night &lt;1&gt;" in page
    assert "Trends over 10 runs" in page
    assert ("1 figure changes" in page) is (slope > 0.0)
    assert ("No change is shown" in page) is (slope == 0.0)
    assert page.count('class="plot trend"') == 1


def test_what_is_called_friction_already_is_not_called_so_twice() -> None:
    known = FrictionEstimate(210.0, 4.0, "N")
    curve = SimpleNamespace(estimates={"coulomb": known, "friction_asymmetry": known})
    found = figures_of(None, np.empty((0, 2)), cast(FrictionCurve, curve), None)
    assert list(found) == ["friction_coulomb", "friction_asymmetry"]


def test_the_page_of_one_run_claims_no_trend() -> None:
    page = trend_page(trends_of([run_at(0.0, leak=0.1, friction_asymmetry=1.0)]), "night")
    assert "One run: no trend yet" in page
    assert "Too few runs to show a change" in page
    assert "friction asymmetry" in page


def test_a_residual_is_followed_though_some_rows_have_none() -> None:
    """The first row has no innovation, nor has one of a tick that was missed."""
    innovations = 1e4 * np.random.default_rng(0).standard_normal((30_000, 2))
    whole = figures_of(None, innovations, None, None)["residual_pressure_1"]
    innovations[0] = np.nan
    innovations[5000:5185] = np.nan
    innovations[9000:10_000] = np.nan
    found = figures_of(None, innovations, None, None)["residual_pressure_1"]
    assert found.value == pytest.approx(whole.value, rel=0.01)
    assert found.value == pytest.approx(1e4 * np.sqrt(2.0 / np.pi), rel=0.02)
    assert found.standard_error is not None
    innovations[:29_000] = np.nan
    assert "residual_pressure_1" not in figures_of(None, innovations, None, None)
