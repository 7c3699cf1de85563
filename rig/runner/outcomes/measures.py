"""Measures the figures that a test's criteria ask for, and judges whether the criteria are met."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Final

import numpy as np

from estimator.leaks import Decision
from faults import FOLLOWING_ERROR, CampaignTest, Criterion
from rig.configuration import show

from .figures import Array, Figure

_JUMP_M: Final = 1e-3
"""Change of a setpoint within a tick, m, that counts as a step: 1 m/s, faster than the valve can
move the ram (0.71 m/s, section 2.1) and than any smooth setpoint that it can follow."""
_SETTLED: Final = 0.05
"""Part of a step within which the ram must stay to have settled: the usual 5 %."""


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
        ends = (("at least", self.low), ("at most", self.high))
        limits = " and ".join(
            f"{word} {show(end, self.unit)}" for word, end in ends if isfinite(end)
        )
        value = show(self.value, self.unit) if isfinite(self.value) else "not known"
        if self.value == inf:
            value = "never"
        return f"{self.figure} {value}, {limits}"


class Rows:
    """The samples of some channels of a test, collected batch by batch.

    Args:
        channels: names of the rows' columns.
        wanted: names of the channels to keep; `time_s` and those that the rows lack are added as
            they are needed: `following_error_m` follows from setpoint and position.
    """

    def __init__(self, channels: Sequence[str], wanted: Sequence[str]) -> None:
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
    """

    def __init__(self, test: CampaignTest, channels: Sequence[str]) -> None:
        self._test = test
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
        columns = self._rows.columns(criterion.from_s, criterion.until_s)
        own = {each.name: each for each in self._test.own_figures}
        if criterion.figure in own:
            return float(own[criterion.figure].expression.of(columns))
        if criterion.figure == "overshoot":
            return max((overshoot for overshoot, _ in step_answers(columns)), default=nan)
        if criterion.figure == "settling":
            return max((settled_s for _, settled_s in step_answers(columns)), default=nan)
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


def step_answers(columns: Mapping[str, Array]) -> list[tuple[float, float]]:
    """Return (overshoot, settling time in s) of every step of the setpoint in some samples.

    The samples are those of `setpoint_m`, `position_m` and `time_s`, each (n,).

    The overshoot is a part of the step; the settling time is infinite if the ram was not within 5 %
    of the step when it ended. A step lasts until the setpoint moves again, or to the last sample.
    """
    setpoint, position, time = (columns[each] for each in ("setpoint_m", "position_m", "time_s"))
    moves = np.flatnonzero(np.abs(np.diff(setpoint)) > 0.0) + 1
    found = []
    for place, begin in enumerate(moves):
        height = setpoint[begin] - setpoint[begin - 1]
        if abs(height) <= _JUMP_M:
            continue
        end = moves[place + 1] if place + 1 < len(moves) else len(setpoint)
        beyond = (position[begin:end] - setpoint[begin]) / height
        beyond = np.where(np.isnan(beyond), 0.0, beyond)
        outside = np.flatnonzero(np.abs(beyond) > _SETTLED)
        settled = 0 if not outside.size else outside[-1] + 1
        late = settled >= end - begin
        settled_s = inf if late else float(time[begin + settled] - time[begin])
        found.append((max(float(beyond.max()), 0.0), settled_s))
    return found
