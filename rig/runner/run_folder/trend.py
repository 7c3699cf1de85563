"""Computes trends of figures over runs, as slopes with intervals, so that wear shows early."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime
from math import sqrt
from typing import Final

import numpy as np

from estimator.accounts import student_quantile

from .archive import Run

FEWEST: Final = 4
"""Fewest runs for which a slope is computed, so that its interval is meaningful."""
SURE: Final = 0.01
"""Probability that a figure which does not change is reported to change; it is small because a
page shows many figures."""
_DAY_S: Final = 86400.0


@dataclass(frozen=True)
class Point:
    """The value of a figure in one run.

    Attributes:
        run: name of the run's folder.
        at: when the run was begun, UTC.
        value: the figure, in its unit.
        standard_error: in the same unit; None if it is not known.
    """

    run: str
    at: datetime
    value: float
    standard_error: float | None


@dataclass(frozen=True)
class Trend:
    """The course of a figure of a test over several runs.

    Attributes:
        campaign: campaign and rig, as "CAMPAIGN on RIG".
        test: name of the test.
        figure: name of the figure.
        unit: unit of the figure.
        points: the values of the runs, oldest first.
        slope: change of the figure per day, in its unit; None if there are fewer than `FEWEST`
            runs, or all began at once.
        half: half the width of the slope's 99 % interval, which follows from the scatter of the
            values about the fitted line; None without a slope.
    """

    campaign: str
    test: str
    figure: str
    unit: str
    points: tuple[Point, ...]
    slope: float | None = None
    half: float | None = None

    @property
    def changes(self) -> bool:
        """Whether zero lies outside of the slope's 99 % interval; False without a slope."""
        return self.slope is not None and self.half is not None and abs(self.slope) > self.half

    @property
    def in_words(self) -> str:
        """Whether the figure changes, and its slope with the 99 % interval, in words.

        Without a slope the words say how many runs are needed.
        """
        if self.slope is None or self.half is None:
            return f"{FEWEST} runs or more tell a trend"
        mean = float(np.mean([point.value for point in self.points]))
        share = f", {100.0 * self.slope / mean:+.3g} % a day" if mean else ""
        what = "changes" if self.changes else "no change is shown"
        unit = f"{self.unit} a day".strip()
        return f"{what}: {self.slope:+.3g} ± {self.half:.2g} {unit}{share} (99 % interval)"


def trends_of(runs: Iterable[Run]) -> list[Trend]:
    """Return the trends of all figures: one for each figure of each test, campaign and rig.

    A run in which a figure is missing or None is left out of the trend of this figure. A figure
    that has different units in different runs has a trend for each unit.
    """
    points: dict[tuple[str, str, str, str], list[Point]] = {}
    for run in sorted(runs, key=lambda run: run.started):
        for test in run.tests:
            for name, figure in (test.get("figures") or {}).items():
                if figure["value"] is None:
                    continue
                campaign = f"{run.campaign} on {run.rig}"
                key = (campaign, str(test["name"]), str(name), str(figure["unit"]))
                points.setdefault(key, []).append(
                    Point(run.folder.name, run.started, figure["value"], figure["standard_error"])
                )
    return [_fitted(Trend(*key, tuple(found))) for key, found in points.items()]


def _fitted(trend: Trend) -> Trend:
    """Return a trend with its slope by least squares, and half the interval by Student's t.

    A trend of fewer than `FEWEST` runs, or of runs that all began at once, is returned as it is.
    """
    first = trend.points[0].at
    days = np.array([(point.at - first).total_seconds() / _DAY_S for point in trend.points])
    values = np.array([point.value for point in trend.points])
    count = len(days)
    across = days - days.mean()
    spread = float(across @ across)
    if count < FEWEST or spread <= 0.0:
        return trend
    slope = float(across @ (values - values.mean())) / spread
    residual = values - values.mean() - slope * across
    error = sqrt(float(residual @ residual) / (count - 2) / spread)
    half = student_quantile(0.5 * SURE, count - 2.0) * error
    return replace(trend, slope=slope, half=half)
