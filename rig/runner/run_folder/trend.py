"""Trends of figures over runs: the slope with its interval, so that wear is seen coming."""

from collections.abc import Iterable
from dataclasses import dataclass
from datetime import datetime
from math import sqrt
from typing import Final

import numpy as np

from estimator.accounts import student_quantile

from .archive import Run

FEWEST: Final = 4
"""Runs from which on a slope has an interval that means something."""
SURE: Final = 0.01
"""Chance that a figure which does not change is said to; a page shows many figures."""
_DAY_S: Final = 86400.0


@dataclass(frozen=True)
class Point:
    """A figure in one run."""

    run: str
    at: datetime
    value: float
    standard_error: float | None


@dataclass(frozen=True)
class Trend:
    """A figure of a test over runs.

    Attributes:
        points: oldest first.
        slope: per day; None with fewer than `FEWEST` runs, or all at once.
        half: of the slope's 99 % interval, by the scatter of the runs about the line.
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
        """Whether the slope's interval leaves out zero."""
        return self.slope is not None and self.half is not None and abs(self.slope) > self.half

    @property
    def in_words(self) -> str:
        """The slope in words."""
        if self.slope is None or self.half is None:
            return f"{FEWEST} runs or more tell a trend"
        mean = float(np.mean([point.value for point in self.points]))
        share = f", {100.0 * self.slope / mean:+.3g} % a day" if mean else ""
        what = "changes" if self.changes else "no change is shown"
        unit = f"{self.unit} a day".strip()
        return f"{what}: {self.slope:+.3g} ± {self.half:.2g} {unit}{share} (99 % interval)"


def trends_of(runs: Iterable[Run]) -> list[Trend]:
    """Return the trend of every figure of every test of every campaign on each rig."""
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
    """Return a trend with its slope, by least squares (Student's t)."""
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
    return Trend(trend.campaign, trend.test, trend.figure, trend.unit, trend.points, slope, half)
