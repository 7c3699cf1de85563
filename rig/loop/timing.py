"""How well the loop kept its time: statistics of each stage of a tick, taken from its rows.

Times are counted in histograms of constant size, so that a run of any length can be counted while
it goes on. A percentile is interpolated within its bin, 5 % wide; the greatest value is exact.
"""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STAGES: Final = ("wakeup", "tick_to_command", "exchange", "compute", "tick_to_reply", "period")
"""The stages of a tick that are timed. From the time of the tick: `wakeup` until the loop woke,
`tick_to_command` until the kernel had the frame with the command, `tick_to_reply` until the sample
came. `exchange` is from the frame's making until the sample came, `compute` is filter, interlock
and record, and `period` is from one waking to the next."""

TIMING: Final = "timing"
"""Kind of the event that contains `Timing.summary` as JSON in a recording."""

_TIMED: Final = ("wakeup_s", "sent_s", "exchange_s", "compute_s")

PERCENTILES: Final = (50.0, 99.0, 99.9)

_EDGES: Final = np.logspace(-7.0, 1.0, 8 * 50 + 1)
"""Edges of bins from 0.1 us to 10 s, 50 in a decade; other times fall into the outermost bins."""


class StageTimes:
    """A histogram of the times of one stage, with the greatest time."""

    def __init__(self) -> None:
        self._counts = np.zeros(_EDGES.size - 1, np.int64)
        self._greatest = 0.0

    def take(self, times: Array) -> None:
        """Count times in s, float64 (n,); NaN and infinity are left out."""
        known = times[np.isfinite(times)]
        if known.size:
            self._greatest = max(self._greatest, float(known.max()))
            self._counts += np.histogram(np.clip(known, _EDGES[0], _EDGES[-1]), _EDGES)[0]

    @property
    def count(self) -> int:
        """Number of times that were counted."""
        return int(self._counts.sum())

    def percentile(self, percent: float) -> float | None:
        """Return the time in s that `percent` % of all times do not exceed; None without times."""
        if not self.count:
            return None
        cumulative = np.concatenate([[0], np.cumsum(self._counts)])
        wanted = percent / 100.0 * self.count
        at = max(int(np.searchsorted(cumulative, wanted, side="left")), 1)
        part = (wanted - cumulative[at - 1]) / self._counts[at - 1]
        value = float(_EDGES[at - 1] * (_EDGES[at] / _EDGES[at - 1]) ** part)
        return min(value, self._greatest)

    def summary(self) -> dict[str, Any]:
        """Return count, percentiles, greatest time and histogram as JSON values; times in s.

        The histogram lists the bins that are not empty: [lower edge, number of times].
        """
        occupied = np.flatnonzero(self._counts)
        return {
            "count": self.count,
            **{f"p{percent:g}_s": self.percentile(percent) for percent in PERCENTILES},
            "max_s": self._greatest if self.count else None,
            "histogram": [[float(_EDGES[i]), int(self._counts[i])] for i in occupied],
        }


class Timing:
    """Statistics of the stages of all ticks whose rows were passed to `take`.

    Args:
        channels: names of the rows' columns (`rig.loop.wire.layout.wire_channels`).
        period_s: period of the loop, s.

    Attributes:
        stages: the times of each stage so far, by its name in `STAGES`.
        ticks: number of rows so far.
        missed: number of these rows that are of missed ticks.
        missed_squares: sum of the squares of the numbers of ticks that were missed in a row: by it
            the standard error of the number of missed ticks is known (`figures_of`).
    """

    def __init__(self, channels: Sequence[str], period_s: float) -> None:
        self._columns = [channels.index(name) for name in _TIMED]
        self._period_s = period_s
        self._last_wakeup = np.full(1, np.nan)
        self.stages = {name: StageTimes() for name in STAGES}
        self.ticks = 0
        self.missed = 0
        self.missed_squares = 0
        self._in_a_row = 0

    def take(self, rows: Array) -> None:
        """Count the times in the next rows, float64 (n, channels).

        They must follow on the rows of the last call.
        """
        wakeup, sent, exchange, compute = (rows[:, column] for column in self._columns)
        wakeups = np.concatenate([self._last_wakeup, wakeup])
        self._last_wakeup = wakeups[-1:].copy()
        period = self._period_s + np.diff(wakeups)
        times = (wakeup, sent, exchange, compute, wakeup + exchange, period)
        for stage, taken in zip(self.stages.values(), times, strict=True):
            stage.take(taken)
        self.ticks += len(rows)
        self._count_missed(np.isnan(wakeup))

    def _count_missed(self, missed: NDArray[np.bool_]) -> None:
        """Count missed ticks, (n,), and the squares of how many were missed in a row.

        Ticks that are missed at the end of one call and at the beginning of the next are one row.
        """
        self.missed += int(np.count_nonzero(missed))
        edges = np.flatnonzero(np.diff(np.concatenate([[False], missed, [False]])))
        begins, ends = edges[::2].tolist(), edges[1::2].tolist()
        before = self._in_a_row
        self._in_a_row = 0
        for begin, end in zip(begins, ends, strict=True):
            earlier = before if begin == 0 else 0
            count = earlier + end - begin
            # A row of the last call that goes on was counted there as far as it went.
            self.missed_squares += count**2 - earlier**2
            if end == len(missed):
                self._in_a_row = count

    def summary(self) -> dict[str, Any]:
        """Return the statistics of all rows so far by stage, as JSON values; times in s."""
        stages = {name: stage.summary() for name, stage in self.stages.items()}
        return {
            "ticks": self.ticks, "missed": self.missed, "missed_squares": self.missed_squares,
            "stages": stages,
        }  # fmt: skip


def in_short(summary: Mapping[str, Any]) -> str:
    """Return a line on missed ticks, and median and 99th percentile of the most important stages.

    Where no tick was counted, the line is empty.

    Args:
        summary: the result of `Timing.summary`, or the content of an event of kind `timing`.
    """
    ticks = summary["ticks"]
    shown = [f"{summary['missed']} of {ticks} ticks missed"] if ticks else []
    for name, words in (
        ("wakeup", "wakes"),
        ("tick_to_command", "has its command out"),
        ("tick_to_reply", "has its reply"),
    ):
        # Recordings that are older than a stage do not contain it.
        stage = summary["stages"].get(name, {})
        p50, p99 = (stage.get(key) for key in ("p50_s", "p99_s"))
        if p50 is not None and p99 is not None:
            shown.append(f"{words} after {1e6 * p50:.0f} us (p99 {1e6 * p99:.0f} us)")
    return ", ".join(shown)
