"""The history holds the last hours of a rig's curves, as the least and greatest value of each step.

It is kept in memory only, and is empty after a restart of the console: recordings keep everything.
"""

import json
from dataclasses import dataclass
from math import ceil
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEVELS: Final = ((0.01, 600.0), (0.1, 3600.0), (1.0, 8 * 3600.0))
"""The step and the reach of each level, both in s, the finest first.

The finest step is that of the charts of the last seconds. Each level reaches as far back as the
page's spans need it: a minute can be looked at in steps of 0.1 s for an hour, and 8 h is a shift.
"""
MOST_STEPS: Final = 1200
"""Most steps in one answer: a chart on a usual screen is not wider than so many pixels."""
MOST_RIGS: Final = 16
"""Most rigs whose history is kept. One of 18 curves takes 19 MB when it is full, after 8 h: 124 800
steps, of 8 bytes each and two values of 4 bytes for each curve. All rigs take 304 MB at most."""
RESET_S: Final = 0.5
"""Largest distance in s between the time of arrival and that by the number of the row.

Beyond it, as after a pause between two runs, the times of the rows are counted from the arrival.
It is longer than messages of the stream are usually delayed."""


class Taken(NamedTuple):
    """Samples that are to be kept, oldest first.

    Attributes:
        rows: (n,) numbers of their rows within the run.
        period_s: time in s between two rows.
        curves: (number of curves, n) values in units of the screen; NaN where there is none.
    """

    rows: NDArray[np.int64]
    period_s: float
    curves: Array


@dataclass(frozen=True)
class Stretch:
    """The part of a history that was asked for.

    Attributes:
        begin_s: beginning of the first step, in s since 1970.
        step_s: length of each step in s.
        names: names of the curves.
        low: (number of curves, number of steps) least values; NaN where nothing was measured.
        high: the greatest values, likewise.
    """

    begin_s: float
    step_s: float
    names: tuple[str, ...]
    low: NDArray[np.float32]
    high: NDArray[np.float32]

    def header(self) -> str:
        """Return all but the values as one line of JSON, with the times in ms."""
        head: dict[str, Any] = {
            "begin_ms": round(self.begin_s * 1e3),
            "step_ms": round(self.step_s * 1e3),
            "count": self.low.shape[1],
            "names": self.names,
        }
        return json.dumps(head)

    def body(self) -> bytes:
        """Return the least values, curve by curve, then the greatest, as little-endian floats."""
        return np.stack([self.low, self.high]).astype("<f4").tobytes()


class Level:
    """A ring of steps of equal length; the steps are numbered from 1970 on.

    Args:
        step_s: length of a step in s.
        reach_s: length in s of all steps together.
        curves: number of the curves.
    """

    def __init__(self, step_s: float, reach_s: float, curves: int) -> None:
        self.step_s = step_s
        self.reach_s = reach_s
        self._count = round(reach_s / step_s)
        self._number = np.full(self._count, -1, np.int64)
        """The number of the step that each place holds now; -1 if it holds none yet."""
        # Memory that was never written is not taken from the machine.
        self._low = np.empty((curves, self._count), np.float32)
        self._high = np.empty((curves, self._count), np.float32)

    def take(self, times_s: Array, low: Array, high: Array) -> None:
        """Widen steps by values; a step that is not held yet replaces the oldest one.

        Args:
            times_s: (n,) times in s since 1970, ascending.
            low: (number of curves, n) values, NaN where there is none.
            high: as `low`; where values are already the extremes of shorter steps, the greatest.
        """
        numbers = np.floor(times_s / self.step_s + 1e-6).astype(np.int64)
        firsts = np.flatnonzero(np.diff(numbers, prepend=-1))
        numbers = numbers[firsts]
        least = np.fmin.reduceat(low, firsts, axis=1)
        greatest = np.fmax.reduceat(high, firsts, axis=1)
        places = numbers % self._count
        held = self._number[places] == numbers
        # What is older than all that is held has no place any more.
        kept = held | (self._number[places] < numbers)
        new = places[kept & ~held]
        self._low[:, new] = np.nan
        self._high[:, new] = np.nan
        self._number[places[kept]] = numbers[kept]
        at = places[kept]
        self._low[:, at] = np.fmin(self._low[:, at], least[:, kept])
        self._high[:, at] = np.fmax(self._high[:, at], greatest[:, kept])

    def between(self, first: int, last: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return least and greatest values of the steps from `first` to `last`, NaN where none."""
        numbers = np.arange(first, last + 1)
        places = numbers % self._count
        there = self._number[places] == numbers
        return (
            np.where(there, self._low[:, places], np.float32(np.nan)),
            np.where(there, self._high[:, places], np.float32(np.nan)),
        )


def _empty_levels(curves: int) -> tuple[Level, ...]:
    return tuple(Level(step, reach, curves) for step, reach in LEVELS)


class History:
    """The history of one rig's curves, against the wall clock of this machine.

    Values are kept by their extremes, so that a peak of one sample is seen over eight hours too.
    Samples may be taken twice: the extremes do not change by that. When the clock is set back, what
    is held is dropped.

    Args:
        names: names of the curves.
    """

    def __init__(self, names: tuple[str, ...]) -> None:
        self.names = names
        self._levels = _empty_levels(len(names))
        self._row_0_s: float | None = None

    def take(self, taken: Taken, now_s: float) -> None:
        """Keep samples.

        Args:
            taken: the samples, the last of which has just arrived.
            now_s: time of its arrival, in s since 1970.
        """
        if not len(taken.rows):
            return
        by_row_s = taken.rows[-1] * taken.period_s
        if self._row_0_s is None or abs(self._row_0_s + by_row_s - now_s) > RESET_S:
            self._row_0_s = now_s - by_row_s
        if now_s < self.newest_s - RESET_S:
            # The clock was set back: what is held has times that come again, and is not mixed up.
            self._levels = _empty_levels(len(self.names))
        times_s = np.asarray(self._row_0_s + taken.rows * taken.period_s, np.float64)
        for level in self._levels:
            level.take(times_s, taken.curves, taken.curves)

    def stretch(
        self, end_s: float, span_s: float, names: tuple[str, ...] = (), steps: int = MOST_STEPS
    ) -> Stretch:
        """Return a stretch by the finest level that reaches back to its beginning.

        Where that has more steps than asked for, neighbouring ones are joined.

        Args:
            end_s: end of the stretch, in s since 1970.
            span_s: its length in s.
            names: names of the curves, all if empty; unknown ones are left out.
            steps: most steps, at least 1 and at most `MOST_STEPS`.
        """
        begin_s = end_s - span_s
        newest_s = self.newest_s
        steps = min(max(steps, 1), MOST_STEPS)
        level = next(
            (
                each
                for each in self._levels
                if newest_s - begin_s <= each.reach_s and span_s / each.step_s <= 12 * steps
            ),
            self._levels[-1],
        )
        joined = max(1, ceil(span_s / level.step_s / steps))
        # Steps that are joined begin at whole multiples, and so stay the same as time goes on.
        first = int(begin_s / level.step_s / joined) * joined
        count = min(steps, ceil(span_s / level.step_s / joined) + 1)
        low, high = level.between(first, first + count * joined - 1)
        wanted = [k for k, name in enumerate(self.names) if not names or name in names]
        shape = (len(wanted), count, joined)
        return Stretch(
            first * level.step_s,
            level.step_s * joined,
            tuple(self.names[k] for k in wanted),
            np.fmin.reduce(low[wanted].reshape(shape), axis=2),
            np.fmax.reduce(high[wanted].reshape(shape), axis=2),
        )

    @property
    def newest_s(self) -> float:
        """End of the newest step that is held, in s since 1970; 0 if nothing is held."""
        finest = self._levels[0]
        return float((finest._number.max() + 1) * finest.step_s)
