"""Tells which limits were passed in a test, when, and what is to be done.

What the loop judges it alone counts; its log is put into words here. The other limits are judged
here, in the rows of the test: figures of a stretch, such as a step or a cycle, as they are known.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from math import inf, nan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.friction import FrictionCurve
from estimator.leaks import Decision
from faults import DECIDED_FIGURES, FOLLOWING_ERROR, FRICTION, CampaignTest, Expression, TestLimit
from rig.configuration import show, show_alike
from rig.io import ChannelLimit
from rig.loop import LIMITED, RungPassed, rungs_with_bands
from rig.plant import TICK
from rig.recording import unit_of

from .figures import Array, decided_figure
from .measures import Rows
from .stretch_figures import FigureKnown, Known, StretchFigure
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
            For a figure of a stretch it is the stretch's begin.
        of: whose limit it is, "test" or "rig".
        each: the kind of stretch of which it is a figure: "step", "cycle", "segment" or "test";
            empty for what is judged all the time.
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
    each: str = ""

    def __str__(self) -> str:
        """Return it in words: "following_error_m 5.1 mm above 5 mm at 12.345 s: ramp_down".

        A figure of a stretch is "overshoot of the step from 1.000 s 12 % above 10 % at 1.234 s".
        """
        word = "above" if self.value > self.limit else "below"
        limit = f"{word} {self._words[1]} at {self.at_s:.3f} s"
        of = f" of the {self.each} from {self.since_s:.3f} s" if self.each else ""
        return f"{self.watched}{of} {self.value_words} {limit}: {self.action}"

    @property
    def value_words(self) -> str:
        """The value in words; a ram that was not settled at the end of a step "did not settle"."""
        if self.value == inf and self.watched == "settling":
            return "did not settle,"
        return self._words[0]

    @property
    def _words(self) -> list[str]:
        return show_alike((self.value, self.limit), self.unit)


@dataclass(frozen=True)
class LimitNotJudged:
    """A limit of a test that was not judged, so that it cannot have been kept.

    Attributes:
        watched: name of the channel or figure.
        why: the reason, as a clause.
        each: the kind of stretch of which it is a figure; empty for what is judged all the time.
        during: name of the segment in which it holds; empty for the whole test.
    """

    watched: str
    why: str
    each: str = ""
    during: str = ""

    def __str__(self) -> str:
        """Return it in words: "the limit of leak in wave was not judged: ..."."""
        of = f" of each {self.each}" if self.each else ""
        where = f" in {self.during}" if self.during else ""
        return f"the limit of {self.watched}{of}{where} was not judged: {self.why}"


@dataclass
class _Band:
    """One band of a limit that is judged here, with how long it has been passed.

    Attributes:
        name: "inner" or "outer".
        beyond_s: since when the value is beyond, s of the test; NaN while it is within.
        passed: whether it has been beyond for long enough, and has not come back since.
        stretch_s: begin of the stretch whose figure was judged last, s of the test; NaN before any.
    """

    limit: TestLimit
    name: str
    low: float
    high: float
    action: str
    beyond_s: float = nan
    passed: bool = False
    stretch_s: float = nan

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

    def take_stretch(self, known: FigureKnown) -> list[LimitPassed]:
        """Process a figure of a stretch; return its passing, the first one alone, if there is one.

        What is known before the stretch has ended can only grow, so that it may be above an end,
        and says nothing of whether it will be below one.
        """
        if known.begin_s != self.stretch_s:
            self.stretch_s, self.passed = known.begin_s, False
        beyond = known.values > self.high
        if known.is_final:
            beyond[-1] |= known.values[-1] < self.low
        if self.passed or not beyond.any():
            return []
        self.passed, self.beyond_s = True, known.begin_s
        first = int(np.argmax(beyond))
        return [self._passing(float(known.times_s[first]), float(known.values[first]))]

    def forget(self) -> None:
        """Begin anew, as where the limit does not hold."""
        self.beyond_s, self.passed = nan, False

    def _passing(self, time_s: float, value: float) -> LimitPassed:
        end = self.high if value > self.high else self.low
        watched, unit, since_s = self.limit.watched, self.limit.unit, self.beyond_s
        return LimitPassed(
            watched, self.name, value, end, unit, time_s, self.action, since_s,
            each=self.limit.each,
        )  # fmt: skip


@dataclass
class _Watched:
    """A limit that is judged here, with its bands and the samples from which its value follows."""

    limit: TestLimit
    bands: list[_Band] = field(default_factory=list)
    rows: Rows | None = None
    expression: Expression | None = None
    stretches: StretchFigure | None = None
    """Computes the figure, if it is one of each stretch of a kind."""
    is_known: bool = False
    """Whether a value was known so far, so that the limit was judged."""


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
        watches: whether there are limits that are judged here.
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
        self._limits = test.limits
        self._by_place = {
            place: self._watching(test, limit, channels)
            for place, limit in enumerate(test.limits)
            if limit.watched not in LIMITED
        }
        self._watched = [each for each in self._by_place.values() if each is not None]
        self.watches = bool(self._watched)
        acting = (limit for limit in mine if limit.action != "warn")
        self.acts = any(limit.each != "test" for limit in acting)

    def _watching(
        self, test: CampaignTest, limit: TestLimit, channels: Sequence[str]
    ) -> _Watched | None:
        """Return a limit that is judged here; None if the rig has no channel for its figure."""
        bands = [_Band(limit, each.name, each.low, each.high, each.action) for each in limit.bands]
        expression = limit.expression or self._own.get(limit.watched)
        wanted = () if expression is None else expression.channels
        if any(name not in (*channels, FOLLOWING_ERROR) for name in wanted):
            return None
        if limit.each:
            figure = StretchFigure(test, limit, expression, channels, self._timeline)
            return _Watched(limit, bands, stretches=figure)
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
            rows: float64 (n, channels), with `time_s` first.
            decision: the detector's newest decision; None before the first.
            by_loop: what the loop has found passed since the last call.
        """
        found = [self._by_loop(each) for each in by_loop]
        for each in self._watched if len(rows) else ():
            if each.stretches is not None:
                found += self._judged_stretches(each, each.stretches.take(rows, decision), decision)
                continue
            here = rows[self._holds(each.limit, rows[:, 0])]
            if len(here):
                found += self._judged(each, here, decision)
            if not len(here) or here[-1, 0] < rows[-1, 0]:
                for band in each.bands:
                    band.forget()
        return self._kept(found)

    def take_passed(self, by_loop: Sequence[RungPassed]) -> list[LimitPassed]:
        """Return what the loop has found passed since the last call, where no rows come with it."""
        return self._kept([self._by_loop(each) for each in by_loop])

    def finish(self, decision: Decision | None, known: Known) -> list[LimitPassed]:
        """Judge the figures that are known as the test has ended; return what was passed.

        Args:
            decision: the detector's last decision; None if there is none.
            known: returns the figures that every test has; it is called only if a limit asks.
        """
        found = []
        for each in self._watched:
            if each.stretches is not None:
                found += self._judged_stretches(
                    each, each.stretches.finish(decision, known), decision
                )
        return self._kept(found)

    def not_judged(
        self, recorded_s: float, friction: FrictionCurve | None
    ) -> tuple[LimitNotJudged, ...]:
        """Return the limits of the test that were not judged so far, in the order of the file.

        Args:
            recorded_s: how long the test has lasted, s.
            friction: the friction identified from the motion; None if there is none.
        """
        reached_s = self._timeline.laid_s(recorded_s)
        found = []
        for place, limit in enumerate(self._limits):
            watched = self._by_place.get(place)
            why = ""
            if not recorded_s:
                why = "the test did not begin"
            elif limit.windows_s and reached_s <= limit.windows_s[0][0] + _INSTANT_S:
                why = f"the segment {limit.during} did not begin"
            elif place in self._by_place and watched is None:
                why = f"this rig does not tell {limit.watched}"
                if limit.watched.startswith("loop_"):
                    why = "the loop of a simulated rig runs by no clock"
            elif watched is not None and not watched.is_known:
                why = _unknown(limit, friction)
            if why:
                found.append(LimitNotJudged(limit.watched, why, limit.each, limit.during))
        return tuple(found)

    def _kept(self, found: list[LimitPassed]) -> list[LimitPassed]:
        """Keep passings in the order of their times, and return those that the outcome lists."""
        found = [each for each in found if self._is_kept(each)]
        found.sort(key=lambda passing: passing.at_s)
        self.passed += found
        return found

    def _judged_stretches(
        self, watched: _Watched, figures: Iterable[FigureKnown], decision: Decision | None
    ) -> list[LimitPassed]:
        """Return the passings of figures of stretches; note the first to be acted on."""
        found = []
        for known in figures:
            watched.is_known |= _is_known(watched.limit, known.values, decision)
            for band in watched.bands:
                found += self._noted(band, band.take_stretch(known))
        return found

    def _noted(self, band: _Band, passings: list[LimitPassed]) -> list[LimitPassed]:
        """Return passings of a band, the first of which is noted if it is to be acted on."""
        if passings and band.action != "warn" and self.due is None:
            self.due = passings[0]
        return passings

    def _judged(
        self, watched: _Watched, rows: Array, decision: Decision | None
    ) -> list[LimitPassed]:
        """Return the passings in rows in which a limit holds; note the first to be acted on."""
        found = []
        times, values = self._samples(watched, rows, decision)
        watched.is_known |= _is_known(watched.limit, values, decision)
        for band in watched.bands:
            found += self._noted(band, band.take(times, values))
        return found

    def _is_kept(self, passing: LimitPassed) -> bool:
        which = passing.of, passing.watched, passing.each, passing.band, passing.limit
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
            return now, np.array([decided_figure(limit.watched, decision)])
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


def _is_known(limit: TestLimit, values: Array, decision: Decision | None) -> bool:
    """Return whether a limit's value is known; a detector that finds no leak knows that too."""
    if limit.watched == "leak":
        return decision is not None
    return not bool(np.isnan(values).all())


def _unknown(limit: TestLimit, friction: FrictionCurve | None) -> str:
    """Return why the value of a limit was not known in a test that has begun."""
    if limit.watched.startswith(FRICTION):
        estimates = {} if friction is None else friction.estimates
        known = estimates.get(limit.watched) or estimates.get(limit.watched.removeprefix(FRICTION))
        if known is not None and known.needs:
            return f"the motion did not show it; it needs {known.needs}"
        return "it was not known at the end of the test"
    if limit.each:
        none = "began" if limit.each == "step" else "was completed"
        return f"no {limit.each} {none} in which it was known"
    if limit.over_s:
        over = show(limit.over_s, "s")
        return f"it was not known at any time, as `over` {over} had not passed or readings lacked"
    return "it was not known at any time"
