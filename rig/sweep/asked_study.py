"""Computes what came of the criteria, figures and limits of a sweep."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from faults import Criterion, TestLimit
from rig.configuration import (
    Sweep,
    SweptMotion,
    asked_column,
    figures_judged_twice,
    limit_label,
    met_column,
)

from .asked import LIMIT_AT, PASSED
from .study import Share
from .table import columns_of

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FigureStudy:
    """A figure over the cases of which it is known.

    Attributes:
        name: the figure, with its channel and where it is taken.
        figure: the figure alone.
        unit: SI unit; empty for a plain number.
        cases: number of cases.
        median, p95: median and 95 % quantile over all these cases, in `unit`, in which infinite
            values count as the greatest or the least; NaN if there are no cases.
        greatest: greatest value, in `unit`; NaN if there are no cases.
        infinite: number of cases in which it is infinite, as the ram never settled.
        minus_infinite: number of cases in which it is minus infinity.
    """

    name: str
    figure: str
    unit: str
    cases: int
    median: float
    p95: float
    greatest: float
    infinite: int
    minus_infinite: int


@dataclass(frozen=True)
class CriterionStudy:
    """What came of a criterion.

    Attributes:
        criterion: the criterion.
        motion: name of the motion to whose cases it applies; empty for those of all motions.
        met: share of the cases of which it was asked that met it.
    """

    criterion: Criterion
    motion: str
    met: Share


@dataclass(frozen=True)
class LimitStudy:
    """What came of a limit.

    Attributes:
        limit: the limit.
        motion: name of the motion in whose cases it holds; empty for those of all motions.
        outer: share of the cases that exceeded the outer band; None without such a band.
        inner: share of the cases that exceeded the inner band; None without such a band.
        outer_times, inner_times: how often that was, in all cases together.
    """

    limit: TestLimit
    motion: str
    outer: Share | None
    inner: Share | None
    outer_times: int
    inner_times: int


@dataclass(frozen=True)
class AskedStudy:
    """What came of all that a sweep asks of its cases.

    Attributes:
        passed: share of the cases that met all criteria and exceeded no limit that calls for
            more than a warning; None if there are neither criteria nor limits.
        ended: share of the cases that exceeded such a limit; None if there are no limits.
        ended_at_s: median of the times when they did, s; None if none did.
        criteria: the criteria, those of the sweep first.
        figures: the sweep's own figures and those of the criteria, each once.
        limits: the limits, those of the sweep first.
    """

    passed: Share | None
    ended: Share | None
    ended_at_s: float | None
    criteria: tuple[CriterionStudy, ...]
    figures: tuple[FigureStudy, ...]
    limits: tuple[LimitStudy, ...]

    def plain(self) -> dict[str, Any]:
        """Return all as JSON-able values in SI; infinity and NaN become None.

        A quantile or greatest value of a figure that is None is infinite, as the counts `infinite`
        and `minus_infinite` of cases tell, unless the figure is known of no case.
        """
        found: dict[str, Any] = {
            "figures": [
                {
                    "figure": each.name, "unit": each.unit, "cases": each.cases,
                    "median": _finite(each.median), "p95": _finite(each.p95),
                    "greatest": _finite(each.greatest), "infinite": each.infinite,
                    "minus_infinite": each.minus_infinite,
                }
                for each in self.figures
            ],
            "criteria": [
                {
                    "figure": each.criterion.label, "motion": each.motion or None,
                    "unit": each.criterion.unit, "at_least": _finite(each.criterion.low),
                    "at_most": _finite(each.criterion.high), "met": each.met.plain,
                }
                for each in self.criteria
            ],
            "limits": [
                {
                    "watched": limit_label(each.limit), "motion": each.motion or None,
                    "action": each.limit.action,
                    "outer": each.outer and each.outer.plain | {"times": each.outer_times},
                    "inner": each.inner and each.inner.plain | {"times": each.inner_times},
                }
                for each in self.limits
            ],
        }  # fmt: skip
        if self.passed is not None:
            found["passed"] = self.passed.plain
        if self.ended is not None:
            found["ended"] = self.ended.plain | {"median_at_s": self.ended_at_s}
        return found


def study_of_asked(sweep: Sweep, table: pa.Table) -> AskedStudy | None:
    """Return what came of all that a sweep asks of its cases; None if it asks nothing.

    Args:
        sweep: the sweep.
        table: its table, a row for each case.
    """
    if not (sweep.own_figures or any(each.criteria or each.limits for each in sweep.motions)):
        return None
    column = columns_of(table)
    motions = column["motion"]
    limited = LIMIT_AT in column
    at_s = column[LIMIT_AT] if limited else np.empty(0)
    reached = at_s[np.isfinite(at_s)]
    judged_twice = figures_judged_twice(each.criteria for each in sweep.motions)
    holds = np.isin(motions, [each.name for each in sweep.motions if each.limits])
    return AskedStudy(
        passed=_true(column[PASSED]) if PASSED in column else None,
        ended=Share(int(reached.size), int(holds.sum())) if limited else None,
        ended_at_s=float(np.median(reached)) if reached.size else None,
        criteria=tuple(
            CriterionStudy(
                each,
                motion,
                _met(each, met_column(each, judged_twice), column, _of(motions, motion)),
            )
            for each, motion in _each(sweep, "criteria")
        ),
        figures=tuple(_figures(sweep, column)),
        limits=tuple(
            _limit(each, motion, column, _of(motions, motion))
            for each, motion in _each(sweep, "limits")
        ),
    )


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None


def _of(motions: NDArray[np.str_], motion: str) -> NDArray[np.bool_]:
    return motions == motion if motion else np.ones(motions.size, np.bool_)


def _true(values: Array) -> Share:
    """Return the share of the known values, 1 or 0 each, that are 1."""
    known = values[np.isfinite(values)]
    return Share(int((known > 0.0).sum()), int(known.size))


def _each(sweep: Sweep, kind: str) -> Iterator[tuple[Any, str]]:
    """Yield each criterion or limit once, with the motion that has it; "" if all motions do."""
    seen: list[tuple[Any, str]] = []
    for motion in sweep.motions:
        for asked in _asked(motion, kind):
            everywhere = all(asked in _asked(each, kind) for each in sweep.motions)
            pair = asked, "" if everywhere else motion.name
            if pair not in seen:
                seen.append(pair)
    yield from seen


def _asked(motion: SweptMotion, kind: str) -> tuple[Any, ...]:
    return motion.criteria if kind == "criteria" else motion.limits


def _met(criterion: Criterion, met: str, column: dict[str, Any], here: NDArray[np.bool_]) -> Share:
    asked = np.isfinite(column[met]) & here
    value = column[asked_column("figure", criterion.label)][asked]
    return Share(int(((criterion.low <= value) & (value <= criterion.high)).sum()), value.size)


def _figures(sweep: Sweep, column: dict[str, Any]) -> Iterator[FigureStudy]:
    known = {
        own.name: (own.name, own.unit) for own in sweep.own_figures if own.expression.is_number
    }
    asked = [criterion for motion in sweep.motions for criterion in motion.criteria]
    known |= {each.label: (each.figure, each.unit) for each in asked}
    for name, (figure, unit) in known.items():
        values = column[asked_column("figure", name)]
        values = values[~np.isnan(values)]
        median, p95 = _quantiles(values, [50.0, 95.0])
        greatest = float(values.max()) if values.size else float("nan")
        infinite, minus_infinite = int(np.isposinf(values).sum()), int(np.isneginf(values).sum())
        counts = int(values.size), median, p95, greatest, infinite, minus_infinite
        yield FigureStudy(name, figure, unit, *counts)


def _quantiles(values: Array, percent: list[float]) -> list[float]:
    """Return percentiles of values (n,), which may be infinite; NaN if there are none.

    Between two finite values a percentile is interpolated. Nothing lies between a value and an
    infinite one, so that the upper one of the two counts there.
    """
    if not values.size:
        return [float("nan")] * len(percent)
    with np.errstate(invalid="ignore"):
        between = np.percentile(values, percent)
    upper = np.percentile(values, percent, method="higher")
    found: list[float] = np.where(np.isfinite(between), between, upper).tolist()
    return found


def _limit(
    limit: TestLimit, motion: str, column: dict[str, Any], here: NDArray[np.bool_]
) -> LimitStudy:
    shares: dict[str, Share | None] = {"outer": None, "inner": None}
    times = {"outer": 0, "inner": 0}
    for band in limit.bands:
        counts = column[asked_column(band.name, limit_label(limit))][here]
        known = counts[np.isfinite(counts)]
        shares[band.name], times[band.name] = _true(known), int(known.sum())
    return LimitStudy(
        limit, motion, shares["outer"], shares["inner"], times["outer"], times["inner"]
    )
