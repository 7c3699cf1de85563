"""Follows what ends a test, or a segment of it: a channel within a range, or a verdict."""

from collections.abc import Sequence
from math import inf, nan

import numpy as np

from estimator.leaks import Decision
from faults import CampaignTest, SegmentEnd, Until

from .figures import Array
from .measures import CriterionResult, Rows
from .timeline import Timeline

_INSTANT_S = 1e-9


class _Awaited:
    """Whether something has come in the rows of a test.

    Attributes:
        came_at_s: when it came, s of the test; NaN before.
    """

    def __init__(self, until: Until, channels: Sequence[str]) -> None:
        self._until = until
        self._rows = Rows(channels, (until.channel,)) if until.channel else None
        self._since_s = nan
        self.came_at_s = nan

    @property
    def came(self) -> bool:
        return not np.isnan(self.came_at_s)

    def take(self, rows: Array, decision: Decision | None) -> None:
        """Process the next rows of the test, at least one, and the detector's newest decision."""
        until = self._until
        times = rows[-1:, 0]
        if self._rows is None:
            is_there = np.array([decision is not None and decision.verdict == until.verdict])
        else:
            self._rows.take(rows)
            columns = self._rows.columns(float(rows[0, 0]))
            self._rows.forget_before(float(rows[-1, 0]))
            times, values = columns["time_s"], columns[until.channel]
            is_there = (values >= until.low) & (values <= until.high)
        for time_s, there in zip(times, is_there, strict=True):
            if not there:
                self._since_s = nan
                continue
            if np.isnan(self._since_s):
                self._since_s = float(time_s)
            if time_s - self._since_s >= until.for_s - _INSTANT_S:
                self.came_at_s = float(time_s)
                return


class AwaitedEnd:
    """Whether the end that a test awaits has come; a test without one ends by its duration alone.

    Args:
        test: the test.
        channels: names of the rows' columns.

    Attributes:
        by_channel: whether a channel is awaited, so that batches are to be short.
    """

    def __init__(self, test: CampaignTest, channels: Sequence[str]) -> None:
        self._until, self._at_most_s = test.until, test.duration_s
        self.by_channel = test.until is not None and bool(test.until.channel)
        self._awaited = None if test.until is None else _Awaited(test.until, channels)

    @property
    def came_at_s(self) -> float:
        """When it came, s of the test; NaN before."""
        return nan if self._awaited is None else self._awaited.came_at_s

    @property
    def came(self) -> bool:
        """Whether it has come."""
        return not np.isnan(self.came_at_s)

    def take(self, rows: Array, decision: Decision | None) -> None:
        """Process the next rows of the test, and the newest decision of the detector."""
        if self._awaited is not None and not self.came:
            self._awaited.take(rows, decision)

    @property
    def results(self) -> tuple[CriterionResult, ...]:
        """Whether it came in time, as a criterion of the test; none if nothing is awaited."""
        if self._until is None:
            return ()
        label, most = self._until.label, self._at_most_s
        value = self.came_at_s if self.came else inf
        return (CriterionResult(label, value, "s", -inf, most, self.came),)

    def __str__(self) -> str:
        """Return what came, and when, in words."""
        label = "" if self._until is None else self._until.label
        return f"{label}: came at {self.came_at_s:.3f} s"


class SegmentEnds:
    """Whether what ends the segments of a test early has come.

    Args:
        test: the test.
        channels: names of the rows' columns.
        timeline: when the motion takes place; who ends a segment early notes that in it.

    Attributes:
        is_close: whether batches are to be short, so that a segment ends soon after what ends it.
    """

    def __init__(self, test: CampaignTest, channels: Sequence[str], timeline: Timeline) -> None:
        self._ends = test.segment_ends
        self._timeline = timeline
        self._awaited = [_Awaited(each.until, channels) for each in self._ends]
        self._present = 0
        self._until_s = 0.0
        self.is_close = any(each.until.channel or each.until.for_s for each in self._ends)

    def take(self, rows: Array, decision: Decision | None) -> SegmentEnd | None:
        """Process the next rows of the test, at least one; return the segment that ends now.

        The result is None if none does. A segment that was returned is not looked at again.

        Args:
            rows: float64 (n, channels), with `time_s` first.
            decision: the detector's newest decision; None before the first.
        """
        laid = self._timeline.laid_at(rows[:, 0])
        self._until_s = float(laid[-1])
        while self._present < len(self._ends):
            end, awaited = self._ends[self._present], self._awaited[self._present]
            here = rows[(laid >= end.begin_s - _INSTANT_S) & (laid < end.end_s - _INSTANT_S)]
            if len(here):
                awaited.take(here, decision)
            if not awaited.came and self._until_s < end.end_s - _INSTANT_S:
                return None
            self._present += 1
            if awaited.came:
                return end
        return None

    @property
    def results(self) -> tuple[CriterionResult, ...]:
        """What came in the segments that were begun, as criteria of the test.

        The value is the time from the segment's begin until it came, s.
        """
        found = []
        for end, awaited in zip(self._ends, self._awaited, strict=True):
            if self._until_s < end.begin_s:
                break
            begun_s = self._timeline.test_s(end.begin_s)
            value = round(max(awaited.came_at_s - begun_s, 0.0), 9) if awaited.came else inf
            most = end.end_s - end.begin_s
            found.append(CriterionResult(end.label, value, "s", -inf, most, awaited.came))
        return tuple(found)
