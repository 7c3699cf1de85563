"""The charts show the last seconds of samples, a hundred points a second, in units of the screen.

Only every tenth sample (at 1 kHz) becomes a point, but all samples enter the moving averages and
the history. A device that is slower than the loop has no value in most rows: a point then has the
newest value before it.
"""

from collections import deque
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from rig.channels import CELSIUS, KN, KPA, LITRES_PER_MINUTE, MM, MPA, VOLT, Unit
from rig.stream import Window

from .history import Taken

Array = NDArray[np.float64]

SHOWN_S: Final = 10.0
POINT_S: Final = 0.01
POINTS: Final = round(SHOWN_S / POINT_S)
HELD_S: Final = 0.1
"""Longest time in s for which a point shows an older value; a longer one without any is a gap."""
AVERAGED_S: Final = 4.0
"""Length in s of the moving average of absolute innovations, as in the thesis (section 4.4)."""

LARGEST: Final = 1e9
"""Values whose magnitude reaches this, in units of the screen, are left out as None.

JSON cannot hold infinity, and an axis whose steps are below its rounding error would never be
drawn to its end.
"""

PLAIN: Final = {
    "position_mm": ("position_m", MM, 2),
    "setpoint_mm": ("setpoint_m", MM, 2),
    "pressure_1_MPa": ("pressure_1_Pa", MPA, 4),
    "pressure_2_MPa": ("pressure_2_Pa", MPA, 4),
    "estimate_1_MPa": ("est_pressure_1_Pa", MPA, 4),
    "estimate_2_MPa": ("est_pressure_2_Pa", MPA, 4),
    "supply_MPa": ("supply_pressure_Pa", MPA, 4),
    "leak_L_per_min": ("decided_leak_m3_per_s", LITRES_PER_MINUTE, 4),
    "leak_low_L_per_min": ("decided_leak_low_m3_per_s", LITRES_PER_MINUTE, 4),
    "leak_high_L_per_min": ("decided_leak_high_m3_per_s", LITRES_PER_MINUTE, 4),
}
"""Curves that show a channel itself: the channel, the unit of the screen, and decimal digits."""
AVERAGED: Final = {
    "average_1_kPa": "innovation_pressure_1_Pa",
    "average_2_kPa": "innovation_pressure_2_Pa",
}
CURVES: Final = (*PLAIN, *AVERAGED)
FURTHER: Final[dict[str, tuple[str, Unit]]] = {
    "command_V": ("command_V", VOLT),
    "spool_mm": ("spool_m", MM),
    "load_kN": ("load_N", KN),
    "compensation_V": ("compensation_V", VOLT),
    "tank_C": ("tank_temperature_K", CELSIUS),
    "oil_C": ("oil_temperature_K", CELSIUS),
}
"""Further curves of the history, which no chart of the last seconds shows."""
KEPT: Final = (*CURVES, *FURTHER)
"""Names of the curves of the history, which end in the unit of the screen."""
CHANNELS: Final = (
    *(channel for channel, _, _ in PLAIN.values()),
    *AVERAGED.values(),
    *(channel for channel, _ in FURTHER.values()),
)
"""Channels that the curves need from the stream."""


class MovingAverage:
    """The mean of the absolute values of the last `count` samples, without NaN and infinity."""

    def __init__(self, count: int) -> None:
        self._last = np.full(count, np.nan)

    def take(self, values: Array) -> Array:
        """Add the next values (n,), and return the mean (n,) after each of them.

        The mean is NaN while no finite value is among the last `count`.
        """
        count = len(self._last)
        joined = np.concatenate([self._last, np.abs(values)])
        self._last = joined[-count:]
        there = np.isfinite(joined)
        sums = np.concatenate([[0.0], np.cumsum(np.where(there, joined, 0.0))])
        counts = np.concatenate([[0], np.cumsum(there)])
        with np.errstate(invalid="ignore"):
            means = (sums[count:] - sums[:-count]) / (counts[count:] - counts[:-count])
        return np.asarray(means[1:], np.float64)


class Holding:
    """Puts the newest value of a channel in the place of missing ones, up to `HELD_S` later."""

    def __init__(self) -> None:
        self._row, self._value = -np.inf, np.nan

    def take(self, rows: NDArray[np.int64], values: Array, period_s: float) -> Array:
        """Return the next values (n,), whose rows are given, with missing ones (NaN) replaced."""
        known = np.concatenate([[self._value], values])
        of = np.concatenate([[self._row], rows])
        newest = np.maximum.accumulate(np.where(np.isnan(known), 0, np.arange(len(known))))[1:]
        self._row, self._value = of[newest[-1]], known[newest[-1]]
        is_new = (rows - of[newest]) * period_s <= HELD_S
        return np.where(is_new, known[newest], np.nan)


class Curves:
    """The newest points of a rig's charts, made from windows of samples.

    All points are counted, so that a viewer need only be sent those after the ones it has.

    Attributes:
        epoch: number that grows whenever the curves begin anew, so that viewers drop old points.
        count: number of points so far, including those that are dropped already.
        next_row: number of the first row that was not added yet.
        points: the newest points, oldest first: time in s since row 0 of the run, number of the
            test, and a value for each of `CURVES`, in the unit that its name gives.
    """

    def __init__(self) -> None:
        self.epoch = 0
        self.count = 0
        self.next_row = 0
        self.points: deque[tuple[float | None, ...]] = deque(maxlen=POINTS)
        self._averaged_row = 0
        """The first row whose averages were not handed over to the history yet."""
        self._test: int | None = None
        self._averages: dict[str, MovingAverage] = {}
        self._holding: dict[str, Holding] = {}

    def begin(self) -> None:
        """Drop all points and begin a new epoch, so that rows that were added can be added anew.

        `count` is not reset.
        """
        self.epoch += 1
        self.next_row = 0
        self.points.clear()
        self._test = None
        self._holding.clear()

    def take(self, window: Window, period_s: float) -> Taken | None:
        """Add points, one every `POINT_S`, for those rows of a window that were not added yet.

        If all rows of the window are before the last one that was added, the curves begin anew.

        Args:
            window: samples with all of `CHANNELS`.
            period_s: time in s between two samples.

        Returns:
            All rows that were added, with the curves `KEPT`; None if there are none.
        """
        if len(window.row) and window.row[-1] + 1 < self.next_row:
            self.begin()
        begin = int(np.searchsorted(window.row, self.next_row))
        if begin == len(window.row):
            return None
        rows = window.row[begin:]
        self.next_row = int(rows[-1]) + 1
        values = {name: window.values[name][begin:].astype(np.float64) for name in window.values}
        test = window.test[begin:]
        shown = np.flatnonzero(rows % max(1, round(POINT_S / period_s)) == 0)
        means = self._means(values, test, period_s)
        held = {
            channel: self._holding.setdefault(channel, Holding()).take(
                rows, values[channel], period_s
            )
            for channel, _, _ in PLAIN.values()
        }
        columns = _columns(held, means, shown)
        times = np.round(rows[shown] * period_s, 3).tolist()
        self.points.extend(zip(times, test[shown].tolist(), *columns, strict=True))
        self.count += len(shown)
        # Averages that begin anew have seen too few samples: the first ones are kept.
        if rows[-1] + 1 < self._averaged_row:
            self._averaged_row = 0
        means = [np.where(rows >= self._averaged_row, each, np.nan) for each in means]
        self._averaged_row = max(self._averaged_row, self.next_row)
        plain = [unit.shown(values[channel]) for channel, unit, _ in PLAIN.values()]  # type: ignore[arg-type]
        further = [unit.shown(values[channel]) for channel, unit in FURTHER.values()]  # type: ignore[arg-type]
        return Taken(rows, period_s, np.stack([*plain, *means, *further]))

    def since(self, count: int) -> dict[str, Any] | None:
        """Return all points after the first `count` that are still stored; None if there are none.

        The result holds the number `epoch`, and lists of equal length: `time_s`, `test`, and one by
        the name of each curve.
        """
        missing = min(self.count - count, len(self.points))
        if missing <= 0:
            return None
        found = [self.points[-k] for k in range(missing, 0, -1)]
        columns = map(list, zip(*found, strict=True))
        names = ("epoch", "time_s", "test", *CURVES)
        return dict(zip(names, (self.epoch, *columns), strict=True))

    def _means(
        self, values: Mapping[str, Array], test: NDArray[np.int64], period_s: float
    ) -> list[Array]:
        """Return the moving averages `AVERAGED` (n,) in kPa, at every sample."""
        averages: dict[str, list[Array]] = {name: [] for name in AVERAGED}
        # The averages begin anew with each test, as the filter does.
        edges = [0, *(np.flatnonzero(np.diff(test)) + 1).tolist(), len(test)]
        for begin, end in pairwise(edges):
            if self._test != test[begin]:
                self._test = int(test[begin])
                length = max(1, round(AVERAGED_S / period_s))
                self._averages = {name: MovingAverage(length) for name in AVERAGED}
            for name, channel in AVERAGED.items():
                averages[name].append(self._averages[name].take(values[channel][begin:end]))
        return [np.concatenate(parts) * KPA.factor for parts in averages.values()]


def _columns(
    values: Mapping[str, Array], means: list[Array], shown: NDArray[np.int64]
) -> list[list[float | None]]:
    plain = [
        _listed(values[channel][shown] * unit.factor, digits)
        for channel, unit, digits in PLAIN.values()
    ]
    return [*plain, *(_listed(each[shown], 2) for each in means)]


def _listed(values: Array, digits: int) -> list[float | None]:
    found = np.round(values, digits).tolist()
    return [value if abs(value) < LARGEST else None for value in found]
