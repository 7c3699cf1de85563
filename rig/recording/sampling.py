"""Recordings of any period, with irregular rows and gaps, are put on an even grid of samples here.

A reading counts at its true time: it goes to the nearest sample, and is moved there by its rate of
change. Where no row is near a sample, its readings are NaN.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .interpolation import Interpolated
from .recording import FloatArray, Recording

SAMPLE_PERIOD_S: Final = 1e-3
PERIOD_TOLERANCE: Final = 0.01
SHORTEST_S: Final = 1e-4
LONGEST_S: Final = 1.0
"""Shortest and longest period, s, of the rows of a recording."""
FINER: Final = 20.0
"""The grid of uneven rows is finer than their period by this factor at most."""
GAP: Final = 1.5
"""Rows that are further apart than this many periods have a gap between them."""
UNKNOWN_S: Final = 0.05
UNKNOWN_ROWS: Final = 5
"""After an input was unknown for longer than 50 ms and 5 rows, nobody knows what the readings in
this time belong to; they are left out."""
_JITTER: Final = 0.2
"""Rows are even if none is off its place on a straight line of times by more than this part of a
period; then they are used as they are."""
_NEIGHBOURS: Final = 3.0
"""A rate of change is taken over rows no further apart than this many periods."""


@dataclass(frozen=True)
class Sampling:
    """How the rows of a file were sampled, and what became of them.

    Attributes:
        period: period of the file's rows, s.
        grid: period of the samples that were made of them, s.
        even: whether the rows are evenly spaced in time, gaps apart.
        gaps: number of gaps between rows.
        gaps_s: time in these gaps, s.
        interpolated: channels that were sampled more slowly than the file's rows, with how.
        unrecorded: optional channels that the file lacks, or that have no value in it.
    """

    period: float
    grid: float
    even: bool = True
    gaps: int = 0
    gaps_s: float = 0.0
    interpolated: Mapping[str, Interpolated] = field(default_factory=dict)
    unrecorded: tuple[str, ...] = ()

    def notes(self) -> list[str]:
        """Return in words all that is unusual of the recording; empty if nothing is."""
        notes = []
        if not self.even or abs(self.grid / self.period - 1.0) > PERIOD_TOLERANCE:
            rows = f"a row every {self.period * 1e3:.4g} ms" + ("" if self.even else ", unevenly")
            how = "averaged to" if self.grid > GAP * self.period else "put on a grid of"
            notes.append(f"{rows}: {how} {self.grid * 1e3:.4g} ms")
        if self.gaps:
            counted = "1 gap" if self.gaps == 1 else f"{self.gaps} gaps"
            notes.append(f"{counted}, {self.gaps_s:.3g} s in all")
        notes += [f"{name} {found.words}" for name, found in self.interpolated.items()]
        notes += [f"{name} was not recorded" for name in self.unrecorded]
        return notes


def sampling_of(time_s: FloatArray, grid: float | None = None) -> Sampling:
    """Return how rows at ascending times (n,), s, were sampled: their period, evenness and gaps.

    `grid` is the period in s of the samples that are to be made of them, and becomes
    `Sampling.grid`. If it is None, it is chosen: the rows' own period if they are even, or no
    longer than 1 ms apart. For other rows, whose times matter, it is 1 ms, or a 20th of their
    period if that is longer.
    """
    period, steps = period_of(time_s), np.diff(time_s)
    gaps = steps > GAP * period
    number = np.concatenate([[0.0], np.cumsum(np.maximum(np.rint(steps / period), 1.0))])
    number -= number.mean()
    around = time_s - time_s.mean()
    late = around - number * float(number @ around / (number @ number))
    even = bool(np.all(np.abs(late) <= _JITTER * period))
    if grid is None:
        finer = max(SAMPLE_PERIOD_S, float(f"{period / FINER:.2g}"))
        grid = period if even or period <= SAMPLE_PERIOD_S else finer
    return Sampling(period, grid, even, int(gaps.sum()), float((steps[gaps] - period).sum()))


def period_of(time_s: FloatArray) -> float:
    """Return the period of rows at ascending times (n,), s, rounded to four digits.

    It is the mean of all steps that are no gaps (up to 1.5 times the median step). A mean within
    1 % of 1 ms counts as 1 ms. There must be two rows or more.
    """
    steps = np.diff(time_s)
    median = float(np.median(steps))
    found = float(np.mean(steps[steps <= GAP * median]))
    if abs(found / SAMPLE_PERIOD_S - 1.0) <= PERIOD_TOLERANCE:
        return SAMPLE_PERIOD_S
    return float(f"{found:.4g}")


def on_grid(recording: Recording, period: float, held: Sequence[str]) -> Recording:
    """Return a recording as samples of one period, each reading at the sample nearest to its time.

    Readings that are nearest to the same sample are averaged; a sample without any is NaN. A
    commanded channel (`held`) acts from its own row to the next, so that a sample has the mean of
    what acted until the next sample; across a gap in its rows the command changes evenly. While a
    command is unknown for long (`UNKNOWN_S`), all readings are NaN. Rows that are even, of this
    period, without gaps, and whose commands are all known are kept as they are. In any case
    `Recording.sampling` of the result says how the rows were sampled.

    Args:
        recording: the recording, with ascending times.
        period: period of the samples, s.
        held: names of the channels that are commanded; all others are measured.
    """
    sampling, channels = sampling_of(recording.time_s, period), recording.channels
    own = sampling.period
    same = sampling.even and not sampling.gaps and abs(own / period - 1.0) <= PERIOD_TOLERANCE
    if same and all(np.isfinite(channels[name]).all() for name in held):
        return replace(recording, sampling=sampling)
    grid = _Grid(recording.time_s, own, period)
    lost = np.zeros(len(grid.time_s), dtype=np.bool_)
    for name in held:
        lost |= grid.unknown(channels[name])
    made = {"time_s": grid.time_s}
    for name, values in channels.items():
        if name in held:
            made[name] = grid.held(values)
        elif name != "time_s":
            made[name] = np.where(lost, np.nan, grid.measured(values))
    return replace(recording, channels=made, sampling=sampling)


class _Grid:
    """An even grid of samples on which rows at ascending times are put; it begins at the first row.

    Args:
        rows_s: times of the rows, (n,), s.
        own: period of the rows, s.
        period: period of the samples, s.
    """

    def __init__(self, rows_s: FloatArray, own: float, period: float) -> None:
        self.rows_s, self.own, self.period = rows_s, own, period
        self._places = np.floor((rows_s - rows_s[0]) / period + 0.5).astype(np.int64)
        self.time_s = rows_s[0] + period * np.arange(int(self._places[-1]) + 1)

    def measured(self, values: FloatArray) -> FloatArray:
        """Return readings (n,) as samples (m,); a sample to which no reading is nearest is NaN.

        Each sample is the mean of its readings, moved to its time by their rate of change.
        """
        known = np.isfinite(values)
        places, count = self._places[known], len(self.time_s)
        number = np.bincount(places, minlength=count)
        with np.errstate(invalid="ignore"):
            mean = np.bincount(places, values[known], count) / number
            taken = np.bincount(places, self.rows_s[known] - self.time_s[places], count) / number
        made = np.full(count, np.nan)
        filled = np.flatnonzero(number)
        value, at = mean[filled], self.time_s[filled] + taken[filled]
        rate = self._rates(at, value)
        made[filled] = value - taken[filled] * rate
        return made

    def _rates(self, at: FloatArray, value: FloatArray) -> FloatArray:
        """Return the rates of change of values (k,) at times (k,), s, by both neighbours of each.

        A neighbour that is further than `_NEIGHBOURS` periods, as at a gap, does not count. A value
        without a neighbour has the rate 0.
        """
        if len(at) < 2:
            return np.zeros(len(at))
        longest = _NEIGHBOURS * max(self.period, self.own)
        apart = np.diff(at)
        near = apart <= longest
        risen = np.where(near, np.diff(value), 0.0)
        passed = np.where(near, apart, 0.0)
        risen = np.append(risen, 0.0) + np.append(0.0, risen)
        passed = np.append(passed, 0.0) + np.append(0.0, passed)
        return np.divide(risen, passed, out=np.zeros(len(at)), where=passed > 0.0)

    def _known(self, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return times and values of a command's known rows, with further rows in each gap.

        The further rows are one period of the rows apart, on a straight line. A command that is NaN
        throughout is 0 from the first row on.
        """
        known = np.isfinite(values)
        at, value = self.rows_s[known], values[known]
        if not len(at):
            return self.rows_s[:1], np.zeros(1)
        extra = [
            at[k] + self.own * np.arange(1, int((at[k + 1] - at[k]) / self.own + 0.5))
            for k in np.flatnonzero(np.diff(at) > GAP * self.own)
        ]
        if not extra:
            return at, value
        every = np.sort(np.concatenate([at, *extra]))
        return every, np.interp(every, at, value)

    def held(self, values: FloatArray) -> FloatArray:
        """Return a command (n,), which acts from its row to the next, as samples (m,).

        A sample is the mean of what acts from its time to the next sample's.
        """
        at, value = self._known(values)
        total = np.concatenate([[0.0], np.cumsum(value[:-1] * np.diff(at))])
        slack = 1e-6 * self.period
        ends = self.time_s + self.period
        first = np.maximum(np.searchsorted(at, self.time_s + slack, side="right") - 1, 0)
        last = np.maximum(np.searchsorted(at, ends - slack, side="left") - 1, 0)

        def until(times: FloatArray, row: NDArray[np.intp]) -> FloatArray:
            return np.asarray(total[row] + value[row] * (times - at[row]))

        mean = (until(ends, last) - until(self.time_s, first)) / self.period
        return np.where(first == last, value[first], mean)

    def unknown(self, values: FloatArray) -> NDArray[np.bool_]:
        """Return for each sample, bool (m,), whether a command (n,) was unknown for long there."""
        known = self.rows_s[np.isfinite(values)]
        ends = np.concatenate([[-np.inf], known, [np.inf]])
        row = np.searchsorted(ends, self.time_s + 1e-6 * self.period, side="right") - 1
        gap = ends[row + 1] - ends[row] > max(UNKNOWN_S, UNKNOWN_ROWS * self.own)
        return np.asarray(gap & (self.time_s - ends[row] >= max(self.own, self.period)))
