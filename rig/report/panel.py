"""Defines the plots of the report, its panels and their traces, and the data that they show.

A trace is reduced to the points that a screen can show, and packed for plotly.js. It names a role
(`chamber_1`, `found`, ...), for which the page's style sheet has one colour for light and one for
dark screens.
"""

import base64
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

from estimator.evidence import AccountHistory
from rig.plant import Parameters
from rig.recording import Recording
from rig.runner.outcomes import TestOutcome

Array = NDArray[np.float64]

POINTS: Final = 1600
"""Greatest number of points of a reduced signal: two for each of some 800 pixels."""

# The values of a diverged filter may exceed a 32-bit float.
_LARGEST: Final = 1e30


@dataclass(frozen=True)
class Trace:
    """A curve, dots or a band over time, or over another quantity that its panel gives.

    Attributes:
        name: name in the plot's legend.
        role: role by which the style sheet chooses the colour.
        shape: whether a curve, dots or a band is drawn.
        time_s, values: horizontal and vertical positions of the curve's points, of the dots, or of
            the outline of the band, float64 (n,), in the units of the plot; NaN makes a gap.
        width, dash, opacity: style of a curve.
    """

    name: str
    role: str
    shape: Literal["line", "dots", "band"]
    time_s: Array
    values: Array
    width: float = 1.3
    dash: Literal["solid", "dash"] = "solid"
    opacity: float = 1.0

    @property
    def plotly(self) -> dict[str, Any]:
        """The trace as plotly.js takes it, without the colour, which the page's script adds."""
        drawn: dict[str, Any] = {"mode": "markers", "marker": {"size": 5}}
        if self.shape == "band":
            drawn = {"mode": "lines", "line": {"width": 0}, "fill": "toself", "hoverinfo": "skip"}
        elif self.shape == "line":
            style = {"width": self.width, "dash": self.dash}
            drawn = {"mode": "lines", "line": style, "opacity": self.opacity}
        points = {"type": "scatter", "x": packed(self.time_s), "y": packed(self.values)}
        return {"name": self.name, "meta": {"role": self.role}, **points, **drawn}


def envelope(time_s: Array, values: Array, points: int = POINTS) -> tuple[Array, Array]:
    """Return times and values of at most `points` samples of a signal, among them every spike.

    The signal is cut into buckets of equally many samples, of which the least and the greatest
    sample are kept at their own times. NaN is kept only where a whole bucket is NaN. A signal of at
    most `points` samples is returned unchanged.

    Args:
        time_s: float64 (n,).
        values: float64 (n,), NaN where missing.
        points: greatest number of samples, which is even.

    Returns:
        Two arrays, float64 (m,) each.
    """
    if values.size <= points:
        return time_s, values
    buckets = points // 2
    width = -(-values.size // buckets)
    buckets = -(-values.size // width)
    padded = np.full(buckets * width, np.nan)
    padded[: values.size] = values
    table = padded.reshape(buckets, width)
    missing = np.isnan(table)
    lowest = np.where(missing, np.inf, table).argmin(axis=1)
    highest = np.where(missing, -np.inf, table).argmax(axis=1)
    order = np.sort(np.column_stack([lowest, highest]), axis=1)
    chosen = (np.arange(buckets)[:, None] * width + order).ravel()
    return time_s[chosen], values[chosen]


def packed(values: Array) -> dict[str, str]:
    """Return an array as a typed array of plotly.js: 32-bit floats in base64, NaN for a gap.

    Infinite values become NaN, and values beyond 1e30 are clipped.
    """
    finite = np.where(np.isfinite(values), values, np.nan)
    narrow = np.clip(finite, -_LARGEST, _LARGEST).astype("<f4")
    return {"dtype": "f4", "bdata": base64.b64encode(narrow.tobytes()).decode("ascii")}


def line(
    name: str, role: str, time_s: Array, values: Array, *, points: int = POINTS, **style: Any
) -> Trace:
    """Return a signal as a curve, reduced by `envelope` to at most `points` points.

    `style` gives any of width, dash and opacity of the `Trace`.
    """
    return Trace(name, role, "line", *envelope(time_s, values, points), **style)


def steps(name: str, role: str, start_s: Array, end_s: Array, values: Array) -> Trace:
    """Return values that are each constant from `start_s` to `end_s` as a staircase, (n,) each.

    There is a gap where one interval does not begin at the end of the interval before.
    """
    time_s = np.column_stack([start_s, end_s]).ravel()
    levels = np.repeat(values, 2)
    gaps = 2 * (1 + np.flatnonzero(start_s[1:] > end_s[:-1] + 1e-6))
    time_s = np.insert(time_s, gaps, time_s[gaps])
    levels = np.insert(levels, gaps, np.nan)
    # Thinned, it would lose gaps and corners.
    return line(name, role, time_s, levels, width=2.2, points=levels.size)


def ribbon(name: str, role: str, time_s: Array, lower: Array, upper: Array) -> Trace:
    """Return the area between a lower and an upper signal as a band, with gaps at NaN.

    Args:
        name: name in the plot's legend.
        role: role by which the style sheet chooses the colour.
        time_s: times of the signals, s, float64 (n,).
        lower: lower signal, float64 (n,).
        upper: upper signal, float64 (n,).
    """
    known = np.isfinite(time_s + lower + upper)
    edges = np.flatnonzero(np.diff(known.astype(np.int8), prepend=0, append=0))
    outline_s, outline = [np.empty(0)], [np.empty(0)]
    for start, end in edges.reshape(-1, 2):
        part, gap = slice(start, end), np.full(1, np.nan)
        outline_s += [time_s[part], time_s[part][::-1], gap]
        outline += [lower[part], upper[part][::-1], gap]
    return Trace(name, role, "band", np.concatenate(outline_s), np.concatenate(outline))


def band(name: str, role: str, start_s: float, end_s: float, lower: float, upper: float) -> Trace:
    """Return a rectangular band from `start_s` to `end_s` and from `lower` to `upper`."""
    time_s = np.array([start_s, end_s, end_s, start_s, start_s])
    return Trace(name, role, "band", time_s, np.array([lower, lower, upper, upper, lower]))


@dataclass(frozen=True)
class TestData:
    """The data of one test from which its panels are drawn.

    Attributes:
        outcome: the test's outcome.
        recording: the test's recording.
        filter_name: name of the campaign's filter.
        parameters: the parameters that the filter assumed; None if they are not recorded.
        accounts: the oil accounts; None if there are none for this filter or recording.
        points: greatest number of points of a trace.
    """

    __test__ = False  # not a pytest class, whatever its name

    outcome: TestOutcome
    recording: Recording
    filter_name: str
    parameters: Parameters | None = None
    accounts: AccountHistory | None = None
    points: int = POINTS

    def channel(self, name: str) -> Array | None:
        """Return a channel of the recording, (n,); None if it is absent or never finite."""
        if name not in self.recording or not np.isfinite(self.recording[name]).any():
            return None
        return self.recording[name]

    def line(self, name: str, role: str, values: Array, **style: Any) -> Trace:
        """Return a signal (n,) as a curve over the time of the test's recording.

        `style` gives any of width, dash and opacity of the `Trace`, or another greatest number of
        `points` than the test's.
        """
        return line(name, role, self.recording.time_s, values, **{"points": self.points} | style)


@dataclass(frozen=True)
class Panel:
    """One plot of a test, with its traces, its texts and its axes.

    Attributes:
        key: distinguishes the panel from the other panels of the test.
        title: names the quantity that is drawn.
        caption: says what to look for.
        unit: unit of the vertical axis.
        traces: the curves, from back to front.
        limits: lowest and highest value that the vertical axis shows at first; None to fit all.
        across: quantity and unit of the horizontal axis; None for time in s.
    """

    key: str
    title: str
    caption: str
    unit: str
    traces: tuple[Trace, ...]
    limits: tuple[float, float] | None = None
    across: tuple[str, str] | None = None

    @property
    def figure(self) -> dict[str, Any]:
        """The data from which the page's script draws the panel, JSON-able."""
        traces = [trace.plotly for trace in self.traces]
        across = self.across and self.across[1]
        return {"traces": traces, "unit": self.unit, "limits": self.limits, "across": across}


def limits_of(shown: Sequence[Array], least: float = 0.0) -> tuple[float, float] | None:
    """Return the lowest and the highest value that an axis shows at first.

    The axis shows all values except extreme ones, so that a diverging filter does not flatten all
    other curves. It reaches beyond the middle 99 % of the values by their span at most, and a
    margin of 6 %. The result is None if no value is finite, or if all are equal and `least` is 0.

    Args:
        shown: the signals, float64 arrays; NaN and infinite values do not count.
        least: smallest span of the axis, in the signals' unit.
    """
    values = np.concatenate([array.ravel() for array in shown]) if shown else np.empty(0)
    values = values[np.isfinite(values)]
    if values.size == 0:
        return None
    low, high = (float(q) for q in np.quantile(values, [0.005, 0.995]))
    reach = max(high - low, least)
    low = max(float(values.min()), low - reach)
    high = min(float(values.max()), high + reach)
    margin = 0.06 * max(high - low, least) + 0.5 * max(least - (high - low), 0.0)
    return (low - margin, high + margin) if margin > 0.0 else None
