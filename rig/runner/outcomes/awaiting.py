"""Follows what ends a test: a channel within a range, or a verdict."""

from collections.abc import Sequence
from math import inf, nan

import numpy as np

from estimator.leaks import Decision
from faults import CampaignTest

from .figures import Array
from .measures import CriterionResult, Rows

_INSTANT_S = 1e-9


class AwaitedEnd:
    """Whether the end that a test awaits has come; a test without one ends by its duration alone.

    Args:
        test: the test.
        channels: names of the rows' columns.

    Attributes:
        came_at_s: when it came, s of the test; NaN before.
        by_channel: whether a channel is awaited, so that batches are to be short.
    """

    def __init__(self, test: CampaignTest, channels: Sequence[str]) -> None:
        self._until, self._at_most_s = test.until, test.duration_s
        self.by_channel = test.until is not None and bool(test.until.channel)
        self._rows = (
            Rows(channels, (test.until.channel,)) if test.until and self.by_channel else None
        )
        self._since_s = nan
        self.came_at_s = nan

    @property
    def came(self) -> bool:
        """Whether it has come."""
        return not np.isnan(self.came_at_s)

    def take(self, rows: Array, decision: Decision | None) -> None:
        """Process the next rows of the test, and the newest decision of the detector."""
        until = self._until
        if until is None or self.came:
            return
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
