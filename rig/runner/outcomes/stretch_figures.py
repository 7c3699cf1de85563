"""Figures that are computed once for each step, cycle, segment or test, for limits of a test.

Each is told as soon as it is known: when its stretch has ended, and of a step already on the way,
because overshoot and settling time can only grow.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from math import nan
from typing import Final, NamedTuple, Protocol

import numpy as np

from estimator.leaks import Decision
from faults import (
    DECIDED_FIGURES,
    STEP_FIGURES,
    CampaignTest,
    Expression,
    LimitEach,
    TestLimit,
    stretches_of,
)
from rig.plant import TICK

from .figures import Array, Figure, decided_figure
from .measures import Rows, StepFollower, StepPart
from .timeline import Timeline

_INSTANT_S: Final = 1e-9
_DECIMALS: Final = 9
"""Decimals to which a settling time in s is rounded before it is judged."""
_STEP_CHANNELS: Final = ("setpoint_m", "position_m")

Known = Callable[[], Mapping[str, Figure]]


class FigureKnown(NamedTuple):
    """A figure of one stretch, or what its samples so far say of it.

    Attributes:
        begin_s: when the stretch began, s of the test.
        times_s: when each value was known, (n,), s of the test.
        values: the values, (n,), SI. Before the stretch has ended they are lower bounds.
        is_final: whether the last value is the figure itself.
    """

    begin_s: float
    times_s: Array
    values: Array
    is_final: bool


class StretchFigure:
    """Computes a figure of a limit for each of the stretches that the limit asks for.

    A cycle that the test leaves early, because a segment or the test ends, has no figure. A segment
    that ends early has that of what was run of it.

    Args:
        test: the test.
        limit: the limit, whose `each` says for which stretches.
        expression: how the figure follows from the channels; None for one that does not.
        channels: names of the rows' columns.
        timeline: when the motion takes place.
    """

    def __init__(
        self,
        test: CampaignTest,
        limit: TestLimit,
        expression: Expression | None,
        channels: Sequence[str],
        timeline: Timeline,
    ) -> None:
        assert limit.each
        self._each: LimitEach = limit.each
        self._timeline = timeline
        laid = stretches_of(test.setpoint, test.duration_s, limit.during, limit.each)
        self._begins = np.array([begin for begin, _ in laid])
        self._ends = np.array([end for _, end in laid])
        self._new = _collecting(limit, expression, channels)
        self._place = -1
        self._present: _Stretch | None = None

    def take(self, rows: Array, decision: Decision | None) -> Iterator[FigureKnown]:
        """Process the next rows of the test, and yield what they say of its stretches.

        Args:
            rows: float64 (n, channels), with `time_s` first.
            decision: the detector's newest decision; None before the first.
        """
        laid = self._timeline.laid_at(rows[:, 0])
        places = np.searchsorted(self._begins - _INSTANT_S, laid, side="right") - 1
        if self._ends.size:
            places[laid >= self._ends[places] - _INSTANT_S] = -1
        changes = np.flatnonzero(np.diff(places)) + 1
        for part in np.split(np.arange(len(rows)), changes):
            yield from self._take(rows[part], int(places[part[0]]), laid[part[-1]], decision)

    def _take(
        self, rows: Array, place: int, laid_s: float, decision: Decision | None
    ) -> Iterator[FigureKnown]:
        """Process rows that are all of one stretch, or of none (place -1)."""
        if place != self._place:
            yield from self._leave(decision)
            self._place = place
            self._present = None if place < 0 else _Stretch(self._new(), float(rows[0, 0]))
        if self._present is None:
            return
        self._present.end_s = float(rows[-1, 0])
        yield from self._present.gathered.take(rows)
        # No further sample of a stretch comes within a tick before its end.
        if laid_s >= self._ends[place] - TICK - _INSTANT_S:
            yield from self._leave(decision, whole=True)

    def finish(self, decision: Decision | None, known: Known) -> Iterator[FigureKnown]:
        """Yield what is known as the test has ended.

        Args:
            decision: the detector's last decision; None if there is none.
            known: returns the figures that every test has, which may take some time to compute.
        """
        yield from self._leave(decision, known)

    def _leave(
        self, decision: Decision | None, known: Known = dict, *, whole: bool = False
    ) -> Iterator[FigureKnown]:
        """Yield the figure of the present stretch, which is over."""
        stretch, self._present = self._present, None
        if stretch is not None and (whole or self._each != "cycle"):
            yield from stretch.gathered.final(stretch.begin_s, stretch.end_s, decision, known)


class _Gathered(Protocol):
    """What is kept of the samples of one stretch."""

    def take(self, rows: Array) -> Iterator[FigureKnown]:
        """Process the next rows of the stretch, and yield what they say already."""

    def final(
        self, begin_s: float, end_s: float, decision: Decision | None, known: Known
    ) -> Iterator[FigureKnown]:
        """Yield the figure of the stretch, between the times of its first and last sample."""


class _Stretch:
    """A stretch that has begun."""

    def __init__(self, gathered: _Gathered, begin_s: float) -> None:
        self.gathered = gathered
        self.begin_s = self.end_s = begin_s


def _collecting(
    limit: TestLimit, expression: Expression | None, channels: Sequence[str]
) -> Callable[[], _Gathered]:
    """Return what makes an empty collection of the samples of a stretch."""
    if limit.watched in STEP_FIGURES:
        # Where segments follow each other, a jump between two of them is a step of the later one.
        following = None if limit.during else StepFollower()
        return lambda: _OfSteps(limit.watched, channels, following or StepFollower())
    if expression is not None:
        return lambda: _OfSamples(expression, channels)
    return lambda: _OfTheTest(limit.watched)


class _OfSamples:
    """A figure that is an expression over the samples of its stretch."""

    def __init__(self, expression: Expression, channels: Sequence[str]) -> None:
        self._expression = expression
        self._rows = Rows(channels, expression.channels)

    def take(self, rows: Array) -> Iterator[FigureKnown]:
        self._rows.take(rows)
        return iter(())

    def final(
        self, begin_s: float, end_s: float, decision: Decision | None, known: Known
    ) -> Iterator[FigureKnown]:
        yield _single(begin_s, end_s, self._expression.of(self._rows.columns()))


class _OfTheTest:
    """A figure of which the detector's decision tells, or that every test has in the end."""

    def __init__(self, figure: str) -> None:
        self._figure = figure

    def take(self, rows: Array) -> Iterator[FigureKnown]:
        return iter(())

    def final(
        self, begin_s: float, end_s: float, decision: Decision | None, known: Known
    ) -> Iterator[FigureKnown]:
        if self._figure in DECIDED_FIGURES:
            value = decided_figure(self._figure, decision)
        else:
            found = known().get(self._figure)
            value = nan if found is None else found.value
        yield _single(begin_s, end_s, value)


class _OfSteps:
    """Overshoot or settling time of each step within a stretch."""

    def __init__(self, figure: str, channels: Sequence[str], follower: StepFollower) -> None:
        self._figure = figure
        self._channels = channels
        self._follower = follower

    def take(self, rows: Array) -> Iterator[FigureKnown]:
        new = Rows(self._channels, _STEP_CHANNELS)
        new.take(rows)
        columns = new.columns()
        parts = self._follower.take(columns["time_s"], *(columns[each] for each in _STEP_CHANNELS))
        return map(self._known, parts)

    def final(
        self, begin_s: float, end_s: float, decision: Decision | None, known: Known
    ) -> Iterator[FigureKnown]:
        part = self._follower.finish()
        return iter(() if part is None else (self._known(part),))

    def _known(self, part: StepPart) -> FigureKnown:
        # Ticks are some 1e-16 s off, by which a ram that settles in time may be late.
        settling_s = np.round(part.settling_s, _DECIMALS)
        values = part.overshoot if self._figure == "overshoot" else settling_s
        return FigureKnown(part.begin_s, part.times_s, values, part.is_over)


def _single(begin_s: float, end_s: float, value: float) -> FigureKnown:
    return FigureKnown(begin_s, np.array([end_s]), np.array([value]), is_final=True)
