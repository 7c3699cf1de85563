"""Computes the statistics of a sweep: confusion, ROC, smallest leak found, and errors of sizes."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from math import exp, log, sqrt
from statistics import NormalDist
from typing import Any, Final

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from estimator.leaks import SILENT
from rig.configuration import HEALTHY
from rig.plant import LITRE_PER_MINUTE

from .table import columns_of

Array = NDArray[np.float64]

POWER: Final = 0.95
"""Share of leaks that are named right at the flow that counts as the smallest found."""
_BINS_PER_DECADE: Final = 5
LEAST_CASES: Final = 20
"""Smallest number of leaks to which a curve is fitted."""
_STEPS: Final = 50
_Z: Final = NormalDist().inv_cdf(0.975)


@dataclass(frozen=True)
class Share:
    """A share of some cases, with its 95 % interval (Wilson 1927).

    Attributes:
        count: number of cases that belong to the share.
        of: number of all cases.
    """

    count: int
    of: int

    @property
    def part(self) -> float:
        """The share, from 0 to 1; NaN if there are no cases."""
        return self.count / self.of if self.of else float("nan")

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the share; (0, 1) if there are no cases."""
        if not self.of:
            return 0.0, 1.0
        p, n, z2 = self.part, self.of, _Z * _Z
        middle = (p + z2 / (2 * n)) / (1 + z2 / n)
        half = _Z / (1 + z2 / n) * sqrt(p * (1 - p) / n + z2 / (4 * n * n))
        return max(middle - half, 0.0), min(middle + half, 1.0)

    @property
    def plain(self) -> dict[str, Any]:
        """The share as JSON-able values; its part is None if there are no cases."""
        part = self.part if self.of else None
        return {"count": self.count, "of": self.of, "part": part, "interval": list(self.interval)}


@dataclass(frozen=True)
class PowerBin:
    """The leaks of a sweep whose flows lie between two limits.

    Attributes:
        low, high: the limits, m^3/s; a flow of `low` belongs to the bin, one of `high` does not.
        right: share of these leaks that were named right.
    """

    low: float
    high: float
    right: Share


@dataclass(frozen=True)
class PowerCurve:
    """The share of leaks that are named right, as a function of their flow.

    Leaks whose flow is not positive or not known are left out. The flow is the mean one of the
    case; in an adaptive sweep it is the one that was drawn, and no logistic curve is fitted.

    Attributes:
        bins: the leaks in bins of flow, smallest flow first, without empty bins.
        intercept, slope: coefficients of a logistic curve in ln(flow in m^3/s); None if no curve
            can be fitted.
        share: the wanted share.
        limit_m3_per_s: flow at which the curve reaches the wanted share; None without a curve that
            rises, or if that flow is outside of the leaks' flows.
        interval_m3_per_s: 95 % interval of this flow; None without it.
        missed_m3_per_s: largest flow of a leak that was not named right; None if all were.
        named_m3_per_s: smallest flow of a leak that was named right; None if none was.
        at_least_m3_per_s, at_most_m3_per_s: the one end of the limit's interval that is known of an
            adaptive sweep whose interval leads beyond the flows that were drawn; else None.
        steps: flows in m^3/s and the most likely share at each that grows with the flow; empty
            unless the sweep is adaptive.
    """

    bins: tuple[PowerBin, ...]
    intercept: float | None = None
    slope: float | None = None
    limit_m3_per_s: float | None = None
    interval_m3_per_s: tuple[float, float] | None = None
    missed_m3_per_s: float | None = None
    named_m3_per_s: float | None = None
    share: float = POWER
    at_least_m3_per_s: float | None = None
    at_most_m3_per_s: float | None = None
    steps: tuple[tuple[float, float], ...] = ()

    @property
    def cases(self) -> int:
        """Number of leaks in all bins."""
        return sum(each.right.of for each in self.bins)

    @property
    def separates(self) -> bool:
        """Whether every leak that was named right is larger than every one that was not.

        It is False if all were named right, or none was.
        """
        missed, named = self.missed_m3_per_s, self.named_m3_per_s
        return missed is not None and named is not None and missed < named


@dataclass(frozen=True)
class Roc:
    """A receiver operating characteristic, for thresholds of a score from high to low.

    The first threshold is infinite; the others are the scores that occur.

    Attributes:
        false_alarms: share of the healthy cases with a score at or above each threshold, (m,).
        found: share of the leaky cases with a score at or above each threshold, (m,).
        area: area under the curve of `found` over `false_alarms`, from 0 to 1.
    """

    false_alarms: Array
    found: Array
    area: float


@dataclass(frozen=True)
class Study:
    """The statistics of a sweep.

    Attributes:
        cases: number of cases.
        confusion: number of cases, by the injected fault, and then by the last verdict.
        false_alarms: share of the healthy cases with a false alarm at any time.
        right: share of the cases whose last verdict is right, by the injected fault.
        power: power curve of each kind of leak, and of all leaks under the key `all`; empty without
            leaks.
        roc: receiver operating characteristics, under the same keys; empty without healthy cases.
        latency_s: median and 95 % quantile of the latencies of leaks named right; None if there
            are none.
        sizing: number, relative bias and RMS error of the estimated flows of leaks named right, and
            the share of their 95 % intervals that hold the true flow; None if no such flow was
            estimated.
        lost: share of the cases in which the filter was lost.
    """

    cases: int
    confusion: Mapping[str, Mapping[str, int]]
    false_alarms: Share
    right: dict[str, Share]
    power: dict[str, PowerCurve]
    roc: dict[str, Roc]
    latency_s: tuple[float, float] | None
    sizing: dict[str, Any] | None
    lost: Share

    def plain(self) -> dict[str, Any]:
        """Return the statistics as JSON-able values, with flows in L/min."""
        return {
            "cases": self.cases,
            "confusion": self.confusion,
            "false_alarms": self.false_alarms.plain,
            "right": {name: share.plain for name, share in self.right.items()},
            "limit_L_per_min": {
                name: None if curve.limit_m3_per_s is None else {
                    "value": curve.limit_m3_per_s / LITRE_PER_MINUTE,
                    "interval": [end / LITRE_PER_MINUTE for end in curve.interval_m3_per_s or ()],
                }
                for name, curve in self.power.items()
            },
            "roc_area": {name: roc.area for name, roc in self.roc.items()},
            "latency_s": self.latency_s and {"median": self.latency_s[0], "p95": self.latency_s[1]},
            "sizing": self.sizing,
            "lost": self.lost.plain,
        }  # fmt: skip


def study_of(table: pa.Table) -> Study:
    """Return the statistics of a sweep's table."""
    column = columns_of(table)
    faults, verdicts, right = column["fault"], column["verdict"], column["right"]
    healthy = faults == HEALTHY
    places = np.unique(faults[~healthy]).tolist()
    parts = {place: faults == place for place in places}
    if places:
        parts = {"all": ~healthy, **parts}
    flow, score = column["leak_true_m3_per_s"], column["score"]
    names = [HEALTHY, *places] if healthy.any() else places
    return Study(
        cases=int(faults.size),
        confusion={name: Counter(sorted(verdicts[faults == name].tolist())) for name in names},
        false_alarms=_share(column["false_alarm"][healthy]),
        right={name: _share(right[faults == name]) for name in names},
        power={name: power_curve(flow[at], right[at]) for name, at in parts.items()},
        roc={name: _roc(score[healthy], score[at]) for name, at in parts.items() if healthy.any()},
        latency_s=_latency(column["latency_s"]),
        sizing=_sizing(column, right & ~healthy),
        lost=_share(column["lost"]),
    )


def verdict_order(confusion: Mapping[str, Mapping[str, int]]) -> list[str]:
    """Return the verdicts that occur in a confusion matrix, in the order to show them.

    First come those that are a key of `confusion`, in its order; then other faults, by name; last
    `healthy` and `inconclusive`, if they are no keys.
    """
    found = {verdict for counts in confusion.values() for verdict in counts}
    first = [name for name in confusion if name in found]
    rest = sorted(found - set(first), key=lambda name: (name in SILENT, name))
    return first + rest


def _share(true: NDArray[np.bool_]) -> Share:
    return Share(int(true.sum()), int(true.size))


def _latency(latency_s: Array) -> tuple[float, float] | None:
    known = latency_s[np.isfinite(latency_s)]
    if not known.size:
        return None
    middle, late = np.percentile(known, [50.0, 95.0]).tolist()
    return middle, late


def power_curve(flow: Array, right: NDArray[np.bool_]) -> PowerCurve:
    """Return the power curve of some leaks, with a logistic curve if one can be fitted.

    Args:
        flow: flow of each leak, m^3/s, (n,); those that are not positive or not known are left out.
        right: whether each was named right, (n,).
    """
    known = np.isfinite(flow) & (flow > 0.0)
    flow, right = flow[known], right[known]
    if not flow.size:
        return PowerCurve(())
    curve = PowerCurve(
        power_bins(flow, right),
        missed_m3_per_s=None if right.all() else float(flow[~right].max()),
        named_m3_per_s=float(flow[right].min()) if right.any() else None,
    )
    return _with_limit(curve, np.log(flow), right)


def power_bins(
    flow: Array, right: NDArray[np.bool_], per_decade: int = _BINS_PER_DECADE
) -> tuple[PowerBin, ...]:
    """Return leaks in bins of flow, smallest flow first, without empty bins.

    Args:
        flow: flow of each leak, above 0, m^3/s, (n,).
        right: whether each was named right, (n,).
        per_decade: number of bins of a decade of flow.
    """
    first = np.floor(np.log10(flow.min()) * per_decade)
    last = np.floor(np.log10(flow.max()) * per_decade)
    edges = 10.0 ** (np.arange(first, last + 2.0) / per_decade)
    bins = (
        PowerBin(float(low), float(high), _share(right[(flow >= low) & (flow < high)]))
        for low, high in pairwise(edges)
    )
    return tuple(each for each in bins if each.right.of)


def _with_limit(curve: PowerCurve, size: Array, right: NDArray[np.bool_]) -> PowerCurve:
    """Return a power curve with its fitted logistic curve, and the limit that follows from it.

    What cannot be estimated stays None; see `PowerCurve`.

    Args:
        curve: the power curve without a fit.
        size: ln(flow in m^3/s) of each leak, (n,).
        right: whether each leak was named right, (n,).
    """
    if size.size < LEAST_CASES or right.all() or not right.any():
        return curve
    fitted = _logistic(size, right.astype(np.float64))
    if fitted is None:
        return curve
    (intercept, slope), covariance = fitted
    curve = replace(curve, intercept=intercept, slope=slope)
    if slope <= 0.0:
        return curve
    wanted = log(POWER / (1.0 - POWER))
    limit = (wanted - intercept) / slope
    if not size.min() <= limit <= size.max():
        return curve
    gradient = np.array([-1.0 / slope, -limit / slope])
    half = _Z * sqrt(float((gradient * (covariance * gradient).sum(axis=1)).sum()))
    interval = exp(limit - half), exp(limit + half)
    return replace(curve, limit_m3_per_s=exp(limit), interval_m3_per_s=interval)


def _logistic(x: Array, y: Array) -> tuple[tuple[float, float], Array] | None:
    """Return (intercept, slope) of the most likely logistic curve, and their covariance (2, 2).

    The result is None if there is no finite slope, because all y above some x are 1 and all below
    are 0, or if the iteration does not converge.

    Args:
        x: independent variable, (n,).
        y: 0 or 1 for each x, (n,).
    """
    centre = float(x.mean())
    design = np.column_stack([np.ones(x.size), x - centre])
    beta = np.zeros(2)
    for _ in range(_STEPS):
        chance = 1.0 / (1.0 + np.exp(-np.clip(design.dot(beta), -30.0, 30.0)))
        weight = chance * (1.0 - chance)
        information = (design.T * weight).dot(design)
        determinant = information[0, 0] * information[1, 1] - information[0, 1] ** 2
        if determinant <= 1e-12 * information[0, 0] * max(information[1, 1], 1e-300):
            return None
        covariance = np.array(
            [[information[1, 1], -information[0, 1]], [-information[0, 1], information[0, 0]]]
        ) / determinant  # fmt: skip
        step = covariance.dot(design.T.dot(y - chance))
        beta = beta + np.clip(step, -5.0, 5.0)
        if np.abs(step).max() < 1e-9:
            # If some x separates all zeros from all ones, the slope grows without limit.
            if abs(beta[1]) * float(x.std()) > 25.0:
                return None
            back = np.array([[1.0, -centre], [0.0, 1.0]])
            turned = back.dot(covariance).dot(back.T)
            return (float(beta[0] - beta[1] * centre), float(beta[1])), turned
    return None


def _roc(healthy: Array, leaky: Array) -> Roc:
    """Return the receiver operating characteristic of a score (Fawcett 2006).

    Args:
        healthy: scores of the healthy cases.
        leaky: scores of the leaky cases.
    """
    scores = np.concatenate([healthy, leaky])
    thresholds = np.concatenate([[np.inf], np.unique(scores)[::-1]])
    alarms = (healthy[:, None] >= thresholds).mean(axis=0)
    found = (leaky[:, None] >= thresholds).mean(axis=0)
    area = float(((found[1:] + found[:-1]) * np.diff(alarms)).sum() * 0.5)
    return Roc(alarms, found, area)


def _sizing(column: dict[str, Any], named: NDArray[np.bool_]) -> dict[str, Any] | None:
    true, found = column["leak_true_m3_per_s"], column["leak_m3_per_s"]
    at = named & np.isfinite(found) & np.isfinite(true)
    if not at.any():
        return None
    low, high = column["leak_low_m3_per_s"][at], column["leak_high_m3_per_s"][at]
    relative = found[at] / true[at] - 1.0
    covered = _share((low <= true[at]) & (true[at] <= high))
    return {
        "leaks": int(at.sum()),
        "relative_bias": float(relative.mean()),
        "relative_rms": float(np.sqrt(np.square(relative).mean())),
        "in_interval": covered.plain,
    }
