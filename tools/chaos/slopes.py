"""How fast a process's memory, descriptors or disk grow, with an interval, and what is a leak."""

from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

BLOCKS: Final = 12
"""Number of stretches of equal length of which the means are taken. Samples within one depend on
each other, as memory is taken and given back with each test; the means of long stretches do not."""
WARM_UP: Final = 0.25
"""Part of a run, at its beginning, that is left out: libraries are loaded and buffers filled."""
_T_95: Final = 2.228
"""95 % quantile (both sides) of Student's t with `BLOCKS` - 2 degrees of freedom."""
WEEK_H: Final = 168.0
"""A week without a stop, h: what a rig is to run through."""


class Resource(NamedTuple):
    """Something that may leak.

    Attributes:
        name: what it is.
        unit: its unit, in which it is shown.
        bound: growth per hour above which it is a leak, in this unit.
        why: what the bound follows from.
    """

    name: str
    unit: str
    bound: float
    why: str


MEMORY: Final = Resource("memory", "MB", 1000.0 / WEEK_H, "1 GB in a week of one process")
DESCRIPTORS: Final = Resource(
    "descriptors", "", 900.0 / WEEK_H, "900 in a week, of the 1024 that a process usually may have"
)
DISK: Final = Resource(
    "disk", "MB", 1000.0 / WEEK_H, "1 GB in a week beside recordings, whose size docs/runs.md tells"
)
RESOURCES: Final = (MEMORY, DESCRIPTORS, DISK)


class Slope(NamedTuple):
    """Growth per hour, with the ends of its 95 % interval."""

    per_h: float
    low: float
    high: float


def slope(times_s: ArrayLike, values: ArrayLike) -> Slope:
    """Return how fast a series grows after its warm-up.

    A line is fitted to the means of `BLOCKS` stretches, and its interval follows from how the means
    scatter about it.

    Args:
        times_s: (n,) times of the samples, s, increasing.
        values: (n,) the samples.

    Raises:
        ValueError: there are fewer than two samples for each stretch.
    """
    times, series = np.asarray(times_s, float), np.asarray(values, float)
    begin = times[0] + WARM_UP * (times[-1] - times[0]) if times.size else 0.0
    times, series = times[times >= begin] / 3600.0, series[times >= begin]
    if times.size < 2 * BLOCKS:
        raise ValueError(f"{times.size} samples after the warm-up, not {2 * BLOCKS}: soak longer")
    hours = np.array([part.mean() for part in np.array_split(times, BLOCKS)])
    means = np.array([part.mean() for part in np.array_split(series, BLOCKS)])
    centred = hours - hours.mean()
    spread = float(centred @ centred)
    per_h = float(centred @ means) / spread
    rest = means - means.mean() - per_h * centred
    half = _T_95 * sqrt(float(rest @ rest) / (BLOCKS - 2) / spread)
    return Slope(per_h, per_h - half, per_h + half)


def is_leak(found: Slope, resource: Resource) -> bool:
    """Return whether all of a slope's interval lies above the resource's bound."""
    return found.low > resource.bound
