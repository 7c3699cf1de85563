"""Measures the figures that a test's criteria ask for, and judges whether the criteria are met."""

from collections.abc import Mapping, Sequence as Listing
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Final, NamedTuple

import numpy as np

from control import Sequence
from estimator.leaks import Decision
from faults import FOLLOWING_ERROR, STEP_M, CampaignTest, Criterion
from rig.configuration import show_alike
from rig.plant import TICK

from .figures import Array, Figure
from .timeline import Timeline

_SETTLED: Final = 0.05
"""Part of a step within which the ram must stay to have settled: the usual 5 %."""

_COMES: Final = ("settling", "until ")
"""What the names of figures begin with that are times, infinite for what never came."""


@dataclass(frozen=True)
class CriterionResult:
    """What came of one criterion of a test.

    Attributes:
        figure: name of the figure, with its channel and where it was taken.
        value: the figure, in `unit`; NaN if it is not known, infinite if the ram never settled.
        unit: SI unit; empty for a plain number.
        low, high: limits of the criterion, in the same unit; infinite for no limit.
        met: whether the figure is known and within the limits.
    """

    figure: str
    value: float
    unit: str
    low: float
    high: float
    met: bool

    def __str__(self) -> str:
        """Return figure, value and limit in words: "rms_error 7.1 mm, at most 3 mm"."""
        return f"{self.figure} {self.value_words}, {self.limit_words}"

    @property
    def value_words(self) -> str:
        """The figure in words: "7.1 mm"; "never" for what did not come or settle."""
        if self.value == inf and self.figure.startswith(_COMES):
            return "never"
        return self._words[0]

    @property
    def limit_words(self) -> str:
        """The limits in words: "at least 1 mm and at most 3 mm"."""
        _, least, most = self._words
        ends = (("at least", self.low, least), ("at most", self.high, most))
        return " and ".join(f"{word} {text}" for word, end, text in ends if isfinite(end))

    @property
    def _words(self) -> list[str]:
        return show_alike((self.value, self.low, self.high), self.unit)


class Rows:
    """The samples of some channels of a test, collected batch by batch.

    Args:
        channels: names of the rows' columns.
        wanted: names of the channels to keep; `time_s` and those that the rows lack are added as
            they are needed: `following_error_m` follows from setpoint and position.
    """

    def __init__(self, channels: Listing[str], wanted: Listing[str]) -> None:
        self._channels = tuple(channels)
        self._wanted = tuple(dict.fromkeys(("time_s", *wanted)))
        needed = [*self._wanted]
        if FOLLOWING_ERROR in needed:
            needed += ["setpoint_m", "position_m"]
        self._kept = [name for name in dict.fromkeys(needed) if name in self._channels]
        self._columns = [self._channels.index(name) for name in self._kept]
        self._parts: list[Array] = []

    def take(self, rows: Array) -> None:
        """Add the next rows of the test, float64 (n, channels)."""
        self._parts.append(rows[:, self._columns])

    def forget_before(self, time_s: float) -> None:
        """Drop the samples before a time of the test, s."""
        table = self._parts[0] if len(self._parts) == 1 else np.concatenate(self._parts)
        self._parts = [table[np.searchsorted(table[:, 0], time_s - 1e-6) :]]

    def columns(self, from_s: float = 0.0, until_s: float = inf) -> dict[str, Array]:
        """Return channel -> samples (n,) of a stretch of the test; a channel without any is NaN."""
        self._parts = [np.concatenate(self._parts)] if len(self._parts) > 1 else self._parts
        table = self._parts[0] if self._parts else np.empty((0, len(self._kept)))
        # A sample at the end of a stretch counts, however its time was rounded.
        inside = (table[:, 0] >= from_s - 1e-6) & (table[:, 0] < until_s - 1e-6)
        part = table[inside]
        found = {name: part[:, index] for index, name in enumerate(self._kept)}
        if FOLLOWING_ERROR in self._wanted:
            lacking = np.full(len(part), nan)
            wanted, here = found.get("setpoint_m", lacking), found.get("position_m", lacking)
            found[FOLLOWING_ERROR] = np.abs(wanted - here)
        return {name: found.get(name, np.full(len(part), nan)) for name in self._wanted} | found


class Measures:
    """Follows the rows of one test, and computes the figures of its criteria and its own figures.

    Args:
        test: the test.
        channels: names of the rows' columns.
        timeline: when the motion takes place, as segments of the test end early.
    """

    def __init__(
        self, test: CampaignTest, channels: Listing[str], timeline: Timeline | None = None
    ) -> None:
        self._test = test
        self._timeline = timeline or Timeline()
        wanted = [name for each in test.own_figures for name in each.expression.channels]
        wanted += [each.channel for each in test.criteria if each.channel]
        if test.criteria:
            wanted += ["setpoint_m", "position_m", FOLLOWING_ERROR]
        self._rows = Rows(channels, wanted) if test.own_figures or test.criteria else None

    def take(self, rows: Array) -> None:
        """Process the next rows of the test, float64 (n, channels)."""
        if self._rows is not None:
            self._rows.take(rows)

    def figures(self, known: Mapping[str, Figure], decision: Decision | None) -> dict[str, Figure]:
        """Return the figures that the criteria ask for and the test's own, by their names.

        Args:
            known: the figures that every test has.
            decision: the detector's last decision; None if there is none.
        """
        found: dict[str, Figure] = {}
        if self._rows is None:
            return found
        for each in self._test.own_figures:
            if each.expression.is_number:
                found[each.name] = Figure(each.expression.of(self._rows.columns()), None, each.unit)
        for criterion in self._test.criteria:
            if criterion.label not in known:
                found[criterion.label] = Figure(self._value(criterion), None, criterion.unit)
        return {name: figure for name, figure in found.items() if isfinite(figure.value)}

    def results(
        self, known: Mapping[str, Figure], decision: Decision | None
    ) -> tuple[CriterionResult, ...]:
        """Return what came of each criterion; the arguments are those of `figures`."""
        results = []
        for criterion in self._test.criteria:
            if criterion.figure == "leak":
                flow = None if decision is None else decision.leak_m3_per_s
                value = nan if flow is None else flow
            elif criterion.figure in known:
                value = known[criterion.figure].value
            else:
                value = self._value(criterion)
            met = criterion.low <= value <= criterion.high
            results.append(
                CriterionResult(
                    criterion.label, value, criterion.unit, criterion.low, criterion.high, met
                )
            )
        return tuple(results)

    def _value(self, criterion: Criterion) -> float:
        assert self._rows is not None
        window = criterion.from_s, criterion.until_s
        if criterion.during:
            window = self._timeline.test_s(window[0]), self._timeline.test_s(window[1])
        columns = self._rows.columns(*window)
        own = {each.name: each for each in self._test.own_figures}
        if criterion.figure in own:
            return float(own[criterion.figure].expression.of(columns))
        if criterion.figure == "overshoot":
            return max((overshoot for overshoot, _ in self._steps(columns)), default=nan)
        if criterion.figure == "settling":
            return max((settled_s for _, settled_s in self._steps(columns)), default=nan)
        usual = "position_m" if criterion.figure in ("peak", "valley") else FOLLOWING_ERROR
        samples = columns[criterion.channel or usual]
        samples = samples[np.isfinite(samples)]
        if not samples.size:
            return nan
        match criterion.figure:
            case "rms_error":
                return float(np.sqrt(np.mean(np.square(samples))))
            case "peak_error" | "peak":
                return float(samples.max())
            case "valley":
                return float(samples.min())
        return nan

    def _steps(self, columns: Mapping[str, Array]) -> list[tuple[float, float]]:
        """Return the answers to the steps in some samples, each of which ends with its segment."""
        setpoint = self._test.setpoint
        starts_s = setpoint.starts_s[1:] if isinstance(setpoint, Sequence) else ()
        return step_answers(columns, [self._timeline.test_s(start) for start in starts_s])


def step_answers(
    columns: Mapping[str, Array], borders_s: Listing[float] = ()
) -> list[tuple[float, float]]:
    """Return (overshoot, settling time in s) of every step of the setpoint in some samples.

    The samples are those of `setpoint_m`, `position_m` and `time_s`, each (n,).

    The overshoot is a part of the step; the settling time is infinite if the ram was not within 5 %
    of the step when it ended. A step lasts until the setpoint moves again, or to a border between
    segments, at the times `borders_s` in their order, or to the last sample.
    """
    follower = StepFollower()
    samples = [columns[each] for each in ("time_s", "setpoint_m", "position_m")]
    # The first sample of a segment counts to it, however its time was rounded.
    places = np.searchsorted(samples[0], np.array(borders_s) - 1e-6)
    parts: list[StepPart | None] = []
    for piece in zip(*(np.split(each, places) for each in samples), strict=True):
        parts += [*follower.take(*piece), follower.finish()]
    ended = [part for part in parts if part is not None and part.is_over]
    return [(float(part.overshoot[-1]), float(part.settling_s[-1])) for part in ended]


class StepPart(NamedTuple):
    """What some samples of one step say of it.

    Attributes:
        begin_s: when the step began, s of the test.
        times_s: times of the samples, (n,), s of the test.
        overshoot: greatest overshoot up to each sample, (n,), as a part of the step.
        settling_s: settling time up to each sample, (n,), s: where the ram is outside of 5 % of the
            step, the time from its begin to the next tick, which is the least that it can be.
        is_over: whether the step is over, so that the last of these values are final; the settling
            time is infinite then if the ram never settled.
    """

    begin_s: float
    times_s: Array
    overshoot: Array
    settling_s: Array
    is_over: bool


class StepFollower:
    """Follows the steps of a setpoint through samples that come batch by batch."""

    def __init__(self) -> None:
        self._setpoint = nan
        self._step: _Step | None = None

    def take(self, times_s: Array, setpoint: Array, position: Array) -> list[StepPart]:
        """Process the next samples, each (n,), in s and m; return what they say, in their order."""
        rises = np.diff(setpoint, prepend=self._setpoint)
        self._setpoint = setpoint[-1] if len(setpoint) else self._setpoint
        moves = np.flatnonzero(np.abs(rises) > 0.0)
        found = []

        def follow(step: _Step, begin: int, after: int) -> None:
            is_over = after < moves.size
            here = slice(begin, int(moves[after]) if is_over else len(setpoint))
            found.append(step.take(times_s[here], position[here]))
            self._step = None if is_over else step
            if is_over:
                found.append(step.final())

        if self._step is not None and len(setpoint):
            follow(self._step, 0, 0)
        for place in np.flatnonzero(np.abs(rises[moves]) > STEP_M):
            begin = int(moves[place])
            step = _Step(float(times_s[begin]), float(setpoint[begin]), float(rises[begin]))
            follow(step, begin, int(place) + 1)
        return found

    def finish(self) -> StepPart | None:
        """Return the present step as one that is over; None if there is none."""
        step, self._step = self._step, None
        return None if step is None else step.final()


@dataclass
class _Step:
    """One step, with what its samples so far say of it.

    Attributes:
        begin_s: when it began, s of the test.
        target: the setpoint that it leads to, m.
        height: by how much the setpoint jumped, m.
    """

    begin_s: float
    target: float
    height: float

    def __post_init__(self) -> None:
        self._last_s = self._settled_at_s = self.begin_s
        self._overshoot = 0.0
        self._is_outside = False

    def take(self, times_s: Array, position: Array) -> StepPart:
        beyond = (position - self.target) / self.height
        beyond = np.where(np.isnan(beyond), 0.0, beyond)
        outside = np.abs(beyond) > _SETTLED
        came_in = ~outside & np.concatenate([[self._is_outside], outside[:-1]])[: len(outside)]
        settled_at_s = np.where(came_in, times_s, self._settled_at_s)
        settled_at_s = np.maximum.accumulate(settled_at_s)
        overshoot = np.maximum.accumulate(np.maximum(beyond, self._overshoot))
        # A ram that is outside now is within at the next tick at the earliest.
        settling_s = np.where(outside, times_s + TICK, settled_at_s) - self.begin_s
        if len(times_s):
            self._last_s, self._settled_at_s = float(times_s[-1]), float(settled_at_s[-1])
            self._overshoot, self._is_outside = float(overshoot[-1]), bool(outside[-1])
        return StepPart(self.begin_s, times_s, overshoot, settling_s, is_over=False)

    def final(self) -> StepPart:
        settling_s = inf if self._is_outside else self._settled_at_s - self.begin_s
        last_s, overshoot = np.array([self._last_s]), np.array([self._overshoot])
        return StepPart(self.begin_s, last_s, overshoot, np.array([settling_s]), is_over=True)
