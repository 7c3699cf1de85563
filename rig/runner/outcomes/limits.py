"""Tells which limits were passed in a test, when, and what is to be done.

What the loop judges it alone counts; its log is put into words here. The other limits are judged
here, in the rows of the test.
"""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from math import nan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.leaks import Decision
from faults import DECIDED_FIGURES, CampaignTest, Expression, TestLimit
from rig.configuration import show
from rig.io import ChannelLimit
from rig.loop import LIMITED, RungPassed, rungs_with_bands
from rig.plant import TICK
from rig.recording import unit_of

from .figures import Array
from .measures import Rows
from .timeline import Timeline

_MOST_KEPT: Final = 20
"""Most passings of one band that an outcome lists; one that is passed more often is passed all the
time, and its count would only lengthen the report."""
_INSTANT_S: Final = 1e-9


@dataclass(frozen=True)
class LimitPassed:
    """One passing of a band of a limit.

    Attributes:
        watched: name of the channel or figure.
        band: "inner" or "outer"; a limit of the rig has an outer band only.
        value: the value when the band counted as passed, in `unit`.
        limit: the end of the band that was passed, in the same unit.
        unit: SI unit; empty for a plain number.
        at_s: when, s of the test.
        action: what was done: `warn`, `hold`, `ramp_down` or `trip`.
        since_s: since when the value was beyond the band, s of the test; NaN if it is not known.
        of: whose limit it is, "test" or "rig".
    """

    watched: str
    band: str
    value: float
    limit: float
    unit: str
    at_s: float
    action: str
    since_s: float = nan
    of: str = "test"

    def __str__(self) -> str:
        """Return it in words: "following_error_m 5.1 mm above 5 mm at 12.345 s: ramp_down"."""
        word = "above" if self.value > self.limit else "below"
        limit = f"{word} {show(self.limit, self.unit)} at {self.at_s:.3f} s"
        return f"{self.watched} {show(self.value, self.unit)} {limit}: {self.action}"


@dataclass
class _Band:
    """One band of a limit that is judged here, with how long it has been passed.

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

    def take(self, times: Array, values: Array) -> list[LimitPassed]:
        """Process samples, and return the passings among them."""
        back = self.limit.hysteresis
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
                found.append(self._passing(float(time_s), float(value)))
        return found

    def forget(self) -> None:
        """Begin anew, as where the limit does not hold."""
        self.beyond_s, self.passed = nan, False

    def _passing(self, time_s: float, value: float) -> LimitPassed:
        end = self.high if value > self.high else self.low
        watched, unit, since_s = self.limit.watched, self.limit.unit, self.beyond_s
        return LimitPassed(watched, self.name, value, end, unit, time_s, self.action, since_s)


@dataclass
class _Watched:
    """A limit that is judged here, with its bands and the samples from which its value follows."""

    limit: TestLimit
    bands: list[_Band] = field(default_factory=list)
    rows: Rows | None = None
    expression: Expression | None = None


class LimitWatch:
    """Follows all limits of one test.

    Args:
        test: the test.
        channels: names of the rows' columns.
        ladder: the limits of the rig, in the order in which the loop has them.
        timeline: when the motion takes place, as segments of the test end early.

    Attributes:
        passed: the passings so far, in the order of their times.
        due: the first passing for which the runner must act, with a hold or worse; None so far.
        acts: whether the runner must act on a limit at all, so that batches are to be short.
    """

    def __init__(
        self,
        test: CampaignTest,
        channels: Sequence[str],
        ladder: Sequence[ChannelLimit] = (),
        timeline: Timeline | None = None,
    ) -> None:
        self.passed: list[LimitPassed] = []
        self.due: LimitPassed | None = None
        self._own = {each.name: each.expression for each in test.own_figures}
        self._ladder = tuple(ladder)
        self._rungs = tuple(rungs_with_bands(test.limits))
        self._timeline = timeline or Timeline()
        self._times_passed: Counter[tuple[object, ...]] = Counter()
        mine = [limit for limit in test.limits if limit.watched not in LIMITED]
        self._watched = [self._watching(limit, channels) for limit in mine]
        self.acts = any(limit.action != "warn" for limit in mine)

    def _watching(self, limit: TestLimit, channels: Sequence[str]) -> _Watched:
        bands = [_Band(limit, each.name, each.low, each.high, each.action) for each in limit.bands]
        expression = limit.expression or self._own.get(limit.watched)
        rows = None
        if expression is not None:
            rows = Rows(channels, expression.channels)
        elif limit.watched not in DECIDED_FIGURES:
            rows = Rows(channels, (limit.watched,))
        return _Watched(limit, bands, rows, expression)

    def take(
        self, rows: Array, decision: Decision | None, by_loop: Sequence[RungPassed] = ()
    ) -> list[LimitPassed]:
        """Process the next rows of the test, and return what was passed in them, in order of time.

        Args:
            rows: float64 (n, channels), with `time_s` first; none after a trip.
            decision: the detector's newest decision; None before the first.
            by_loop: what the loop has found passed since the last call.
        """
        found = [self._by_loop(each) for each in by_loop]
        for each in self._watched if len(rows) else ():
            here = rows[self._holds(each.limit, rows[:, 0])]
            if len(here):
                found += self._judged(each, here, decision)
            if not len(here) or here[-1, 0] < rows[-1, 0]:
                for band in each.bands:
                    band.forget()
        found = [each for each in found if self._is_kept(each)]
        found.sort(key=lambda passing: passing.at_s)
        self.passed += found
        return found

    def _judged(
        self, watched: _Watched, rows: Array, decision: Decision | None
    ) -> list[LimitPassed]:
        """Return the passings in rows in which a limit holds; note the first to be acted on."""
        found = []
        times, values = self._samples(watched, rows, decision)
        for band in watched.bands:
            passings = band.take(times, values)
            found += passings
            if passings and band.action != "warn" and self.due is None:
                self.due = passings[0]
        return found

    def _is_kept(self, passing: LimitPassed) -> bool:
        which = passing.of, passing.watched, passing.band, passing.limit
        self._times_passed[which] += 1
        return self._times_passed[which] <= _MOST_KEPT

    def _by_loop(self, passed: RungPassed) -> LimitPassed:
        """Return in the words of the outcome what the loop has found."""
        of_test = passed.rung - len(self._ladder)
        if of_test < 0:
            rung = self._ladder[passed.rung]
            whose, band, unit = "rig", "outer", unit_of(rung.channel)
            action = "warn" if rung.action == "indicate" else rung.action
        else:
            rung, limit, of = self._rungs[of_test]
            whose, band, unit, action = "test", of.name, limit.unit, of.action
        at_s, value = passed.tick * TICK, passed.value
        end = rung.high if value > rung.high else rung.low
        since_s = max(at_s - rung.for_s, 0.0)
        return LimitPassed(rung.channel, band, value, end, unit, at_s, action, since_s, whose)

    def _holds(self, limit: TestLimit, times_s: Array) -> NDArray[np.bool_]:
        """Return at which of some times of the test, (n,) in s, a limit holds."""
        if not limit.windows_s:
            return np.ones(len(times_s), np.bool_)
        laid_s = self._timeline.laid_at(times_s)
        holds = np.zeros(len(times_s), np.bool_)
        for begin_s, end_s in limit.windows_s:
            holds |= (laid_s >= begin_s - _INSTANT_S) & (laid_s < end_s - _INSTANT_S)
        return holds

    def _begin_s(self, limit: TestLimit, time_s: float) -> float:
        """Return when the stretch in which a limit holds at a time began, s of the test."""
        laid_s = self._timeline.laid_s(time_s)
        begun = [begin for begin, end in limit.windows_s if begin <= laid_s + _INSTANT_S < end]
        return self._timeline.test_s(begun[0]) if begun else 0.0

    def _samples(
        self, watched: _Watched, rows: Array, decision: Decision | None
    ) -> tuple[Array, Array]:
        """Return (times in s, values) of a limit in the next rows; one of each for a figure."""
        limit, now = watched.limit, rows[-1:, 0]
        if watched.rows is None:
            return now, np.array([_decided(limit.watched, decision)])
        watched.rows.take(rows)
        from_s, begin_s = float(rows[0, 0]), self._begin_s(limit, float(now[0]))
        expression = watched.expression
        if expression is not None and expression.is_number:
            from_s = float(now[0]) - limit.over_s
        columns = watched.rows.columns(from_s)
        watched.rows.forget_before(from_s)
        if expression is None:
            return columns["time_s"], columns[limit.watched]
        if not expression.is_number:
            return columns["time_s"], expression.of(columns)
        # A figure over less than its stretch would jump about at the begin.
        value = expression.of(columns) if from_s >= begin_s - _INSTANT_S else nan
        return now, np.array([value])

    @property
    def acted(self) -> LimitPassed | None:
        """The first passing of a limit of the test that called for more than a warning, if any."""
        ours = (each for each in self.passed if each.of == "test")
        return next((each for each in ours if each.action != "warn"), None)


def _decided(figure: str, decision: Decision | None) -> float:
    """Return a figure of `DECIDED_FIGURES`, SI; NaN if the detector does not tell it."""
    if decision is None:
        return nan
    value = decision.leak_m3_per_s
    if figure == "bulk_modulus":
        value = decision.details.get("bulk_modulus_Pa")
    return nan if value is None else float(value)
