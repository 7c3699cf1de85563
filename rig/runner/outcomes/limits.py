"""Follows the limits of a test in its rows: what was passed, when, and what is to be done."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from math import inf, nan
from typing import Final

import numpy as np

from estimator.leaks import Decision
from faults import CampaignTest, TestLimit
from rig.configuration import show
from rig.loop import LIMITED

from .figures import Array
from .measures import Rows

_MOST_KEPT: Final = 20
"""Most passings of one band that an outcome lists; one that is passed more often is passed all the
time, and its count would only lengthen the report."""
_INSTANT_S: Final = 1e-9
_AHEAD_S: Final = 5e-3
"""By how much a loop may be ahead in counting how long a band has been passed, s: it begins with
the first exchange of a segment, and rows with the first whole sample."""


@dataclass(frozen=True)
class LimitPassed:
    """One passing of a band of a test's limit.

    Attributes:
        watched: name of the channel or figure.
        band: "inner" or "outer".
        value: the value when the band counted as passed, in `unit`.
        limit: the end of the band that was passed, in the same unit.
        unit: SI unit; empty for a plain number.
        at_s: when, s of the test.
        action: what was done: `warn`, `hold`, `ramp_down` or `trip`.
    """

    watched: str
    band: str
    value: float
    limit: float
    unit: str
    at_s: float
    action: str

    def __str__(self) -> str:
        """Return it in words: "following_error_m 5.1 mm above 5 mm at 12.345 s: ramp_down"."""
        word = "above" if self.value > self.limit else "below"
        limit = f"{word} {show(self.limit, self.unit)} at {self.at_s:.3f} s"
        return f"{self.watched} {show(self.value, self.unit)} {limit}: {self.action}"


@dataclass
class _Band:
    """One band of a limit, with how long it has been passed.

    Attributes:
        name: "inner" or "outer".
        beyond_s: since when the value is beyond, s of the test; NaN while it is within.
        passed: whether it has been beyond for long enough, and has not come back since.
    """

    limit: TestLimit
    name: str
    low: float
    high: float
    action: str
    beyond_s: float = nan
    passed: bool = False
    kept: int = 0
    last: tuple[float, float] = (nan, nan)
    """Time in s and value of the latest sample."""

    def take(self, times: Array, values: Array) -> list[LimitPassed]:
        """Process samples, and return the passings among them."""
        back = self.limit.hysteresis
        if len(times):
            self.last = float(times[-1]), float(values[-1])
        outside = (values < self.low) | (values > self.high)
        if not outside.any() and not self.passed:
            self.beyond_s = nan
            return []
        near = (values < self.low + back) | (values > self.high - back)
        found = []
        for time_s, value, is_beyond, is_near in zip(times, values, outside, near, strict=True):
            if not (is_near if self.passed else is_beyond):
                self.beyond_s, self.passed = nan, False
                continue
            if np.isnan(self.beyond_s):
                self.beyond_s = float(time_s)
            lasted = time_s - self.beyond_s >= self.limit.for_s - _INSTANT_S
            if lasted and not self.passed:
                self.passed = True
                self.kept += 1
                if self.kept <= _MOST_KEPT:
                    found.append(self._passing(float(time_s), float(value)))
        return found

    def nearly(self) -> LimitPassed | None:
        """Return the passing that a loop has found which began to count some ticks before us."""
        lasts_s = self.last[0] - self.beyond_s
        is_near = lasts_s >= self.limit.for_s - _AHEAD_S and not self.passed
        return self._passing(*self.last) if is_near else None

    def _passing(self, time_s: float, value: float) -> LimitPassed:
        end = self.high if value > self.high else self.low
        watched, unit = self.limit.watched, self.limit.unit
        return LimitPassed(watched, self.name, value, end, unit, time_s, self.action)


@dataclass
class _Watched:
    """A limit with its bands, and the samples from which its value follows."""

    limit: TestLimit
    bands: list[_Band] = field(default_factory=list)
    rows: Rows | None = None


class LimitWatch:
    """Follows all limits of one test in its rows.

    The loop acts by itself on the limits that it judges (`rig.loop.rungs_of`); those are followed
    here for the record. For the others, `due` says what is to be done.

    Args:
        test: the test.
        channels: names of the rows' columns.

    Attributes:
        passed: the passings so far, in the order of their times.
        due: the first passing for which the runner must act, with a hold or worse; None so far.
        acts: whether the runner must act on a limit at all, so that batches are to be short.
    """

    def __init__(self, test: CampaignTest, channels: Sequence[str]) -> None:
        self.passed: list[LimitPassed] = []
        self.due: LimitPassed | None = None
        self._own = {each.name: each.expression for each in test.own_figures}
        self._watched = [self._watching(limit, channels) for limit in test.limits]
        self.acts = any(
            limit.watched not in LIMITED and limit.action != "warn" for limit in test.limits
        )

    def _watching(self, limit: TestLimit, channels: Sequence[str]) -> _Watched:
        watched = _Watched(limit)
        inner, outer = (limit.inner_low, limit.inner_high), (limit.low, limit.high)
        if inner != (-inf, inf):
            watched.bands.append(_Band(limit, "inner", *inner, "warn"))
        if outer != (-inf, inf):
            watched.bands.append(_Band(limit, "outer", *outer, limit.action))
        if limit.watched in self._own:
            watched.rows = Rows(channels, self._own[limit.watched].channels)
        elif limit.watched != "leak":
            watched.rows = Rows(channels, (limit.watched,))
        return watched

    def take(self, rows: Array, decision: Decision | None) -> list[LimitPassed]:
        """Process the next rows of the test, and return the passings among them.

        Args:
            rows: float64 (n, channels), with `time_s` first; at least one.
            decision: the detector's newest decision; None before the first.
        """
        found: list[LimitPassed] = []
        for each in self._watched:
            times, values = self._samples(each, rows, decision)
            for band in each.bands:
                passings = band.take(times, values)
                found += passings
                is_ours = each.limit.watched not in LIMITED
                if passings and band.action != "warn" and is_ours and self.due is None:
                    self.due = passings[0]
        found.sort(key=lambda passing: passing.at_s)
        self.passed += found
        return found

    def _samples(
        self, watched: _Watched, rows: Array, decision: Decision | None
    ) -> tuple[Array, Array]:
        """Return (times in s, values) of a limit in the next rows; one of each for a figure."""
        limit, now = watched.limit, rows[-1:, 0]
        if watched.rows is None:
            flow = None if decision is None else decision.leak_m3_per_s
            return now, np.array([nan if flow is None else flow])
        watched.rows.take(rows)
        from_s = float(rows[0, 0])
        expression = self._own.get(limit.watched)
        if expression is not None and expression.is_number:
            from_s = float(now[0]) - limit.over_s
        columns = watched.rows.columns(from_s)
        watched.rows.forget_before(from_s)
        if expression is None:
            return columns["time_s"], columns[limit.watched]
        if not expression.is_number:
            return columns["time_s"], expression.of(columns)
        # A figure over less than its stretch would jump about at the test's begin.
        value = expression.of(columns) if from_s >= 0.0 else nan
        return now, np.array([value])

    def close(self) -> None:
        """Note what a loop that has tripped must have found, if its passing is in no row."""
        if self.acted is not None:
            return
        for each in self._watched:
            for band in each.bands:
                passing = band.nearly()
                if passing is not None and band.action != "warn" and each.limit.watched in LIMITED:
                    self.passed.append(passing)

    @property
    def acted(self) -> LimitPassed | None:
        """The first passing that called for more than a warning; None if none did."""
        return next((each for each in self.passed if each.action != "warn"), None)
