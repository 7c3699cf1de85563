"""Reduces signals to the points that a screen can show, and packs them for plotly.js.

A trace names a role (`chamber_1`, `found`, ...), for which the page's style sheet has one colour
for light and one for dark screens.
"""

import base64
from dataclasses import dataclass
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

POINTS: Final = 1600
"""Greatest number of points of a reduced signal: two for each of some 800 pixels."""

# The values of a diverged filter may exceed a 32-bit float.
_LARGEST: Final = 1e30


@dataclass(frozen=True)
class Trace:
    """A curve, dots or a band over time.

    Attributes:
        name: name in the plot's legend.
        role: role by which the style sheet chooses the colour.
        shape: whether a curve, dots or a band is drawn.
        time_s, values: points of the curve or of the band's outline, float64 (n,), in the units of
            the plot; NaN makes a gap.
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
    """Return a signal as a curve in a `Trace`'s style, reduced by `envelope` to `points`."""
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
