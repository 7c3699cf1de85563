"""Shapes in which an unknown disturbance may depend on one quantity, as columns of a linear fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import atan2, hypot
from typing import Final

import numpy as np

from estimator.gap.plant import (
    DIRECTION,
    KNOTS,
    MEMORIES,
    PHASES,
    TIME_NAME,
    Addition,
    Array,
    Region,
    memory_columns,
    wave,
)

WAVES: Final = 250
"""Greatest number of wave periods that are tried along a length. They are evenly spaced in
1 / period, by half of 1 / the range that the motion covers, from half that range down."""
_SAMPLES: Final = 10.0
"""Least number of samples in the shortest period that is tried, at the median speed."""
_MOVING: Final = 0.05
"""Part of the greatest step from sample to sample above which the quantity counts as moving."""
BUMPS: Final = 12
"""Number of places along a length at which bumps are tried, each with three widths."""
_FINER: Final = 9
"""Number of periods that are tried about the period of a wave."""
_BINS: Final = 32
"""Number of bins of a quantity's range in which values are counted, to find clusters of them."""
_CLUSTERS: Final = 4
"""Greatest number of clusters that are told apart."""
_EMPTY: Final = 2
"""Number of bins in a row with hardly any values that separate two clusters."""
_HARDLY: Final = 0.05
"""Hardly any values are fewer than this part of those that evenly spread ones would be."""
RECORDING: Final = "recording"
"""Among the quantities along a course, the number of its recording."""
STARTS: Final = "starts"
"""Among the quantities along a course, 1 where a stretch of samples begins, else 0."""
CORNERS: Final = ("hinge", "beyond")
"""Forms that have a corner."""
_HINGES: Final = 11
"""Number of places at which a corner is tried."""
_LIMITS_NEAR: Final = (0.6, 0.7, 0.8, 0.9, 1.0, 1.1, 1.25, 1.4, 1.7)
"""Limits that are tried about one, as parts of it."""
_PLAYS_NEAR: Final = (0.6, 0.72, 0.85, 1.0, 1.17, 1.38, 1.65)
"""Widths of a play that are tried about one, as parts of it."""
_ROUGH: Final = (1e-4, 3e-2)
"""Weights that are tried for the roughness of a table, as parts of its columns' mean square."""


@dataclass(frozen=True)
class Shape:
    """One way in which a disturbance may depend on a quantity.

    Attributes:
        of: name of the quantity; "" for none.
        times: name of the quantity that the disturbance is multiplied by; "" for none.
        form: one of `FORMS`.
        at: knots of a table; period of a wave or tone; middle and width of a bump; place of a
            hinge, or the limit beyond which a disturbance acts on either side; time constant of a
            lag; frequency, Hz, and damping ratio of a resonance; half the width of a play; empty
            for the others.
        recordings: numbers of the recordings that a tone has a phase in; empty for other forms.
        held: of a lag or a resonance, whether the quantity stays as it is from sample to sample.
    """

    of: str
    times: str
    form: str
    at: tuple[float, ...] = ()
    recordings: tuple[int, ...] = ()
    held: bool = False

    @property
    def count(self) -> int:
        """Return the number of coefficients."""
        several = {
            "table": len(self.at), "wave": 2, "tone": 2 * len(self.recordings), "resonance": 2
        }  # fmt: skip
        return several.get(self.form, 1)

    def columns(self, along: Mapping[str, Array]) -> Array:
        """Return for each coefficient the disturbance if it is 1 and all others are 0, (n, count).

        `along` has the quantities (n,) by name. For a tone, all samples must be of one recording,
        whose number is the first element of the quantity `RECORDING`. For a lag or a resonance they
        must be evenly spaced in stretches, whose beginnings are marked in the quantity `STARTS`.
        """
        x = along[self.of] if self.of else np.ones(len(next(iter(along.values()))))
        if self.form == "table":
            found = hats(x, np.array(self.at))
        elif self.form == "tone":
            found = np.zeros((len(x), self.count))
            first = 2 * self.recordings.index(int(along[RECORDING][0]))
            phase = 2.0 * np.pi * x / self.at[0]
            found[:, first : first + 2] = np.column_stack([np.sin(phase), np.cos(phase)])
        elif self.form in MEMORIES:
            time = along[TIME_NAME]
            starts, period = along[STARTS].astype(np.int64), float(time[1] - time[0])
            found = memory_columns(self.form, self.at, x, starts, period, self.held)
        elif self.form == "wave":
            phase = 2.0 * np.pi * x / self.at[0]
            found = np.column_stack([np.sin(phase), np.cos(phase)])
        else:
            found = Addition("", self.of, "", self.form, self.at, (1.0,)).shape(x)[:, None]
        return np.asarray(found * along[self.times][:, None] if self.times else found)

    def roughness(self) -> tuple[Array, ...]:
        """Return matrices (count, count) to be tried as penalties on bends of a table.

        They hold for columns whose mean square is one. Other forms have a single one, which is 0.
        """
        if self.form != "table" or len(self.at) < 3:
            return (np.zeros((self.count, self.count)),)
        at = np.array(self.at)
        steps = np.diff(at) / (at[-1] - at[0]) * (len(at) - 1)
        bend = np.zeros((len(at) - 2, len(at)))
        for k in range(len(at) - 2):
            bend[k, k] = 1.0 / steps[k]
            bend[k, k + 2] = 1.0 / steps[k + 1]
            bend[k, k + 1] = -bend[k, k] - bend[k, k + 2]
        return tuple(weight * bend.T @ bend for weight in _ROUGH)

    def addition(self, place: str, coefficients: Array) -> Addition:
        """Return the disturbance of a place with these coefficients (count,), SI.

        A tone gets one size, the root mean square of its sizes in the recordings, and its own phase
        in each.
        """
        own = tuple(float(c) for c in coefficients)
        if self.form == "wave":
            return wave(place, self.of, self.at[0], *own)
        if self.form == "tone":
            phases = [0.0] * PHASES
            for number, sine, cosine in zip(self.recordings, own[::2], own[1::2], strict=True):
                phases[number] = atan2(cosine, sine)
            size = hypot(*own) / len(self.recordings) ** 0.5
            return Addition(place, self.of, "", "tone", (self.at[0], *phases), (size,))
        return Addition(place, self.of, self.times, self.form, self.at, own)


def hats(values: Array, knots: Array) -> Array:
    """Return hat functions (n, knots) of values (n,), which add up to one for each value.

    The knots must be ascending, and at least two. A value beyond the outermost knots counts as at
    them.
    """
    inside = np.clip(values, knots[0], knots[-1])
    above = np.clip(np.searchsorted(knots, inside, side="right"), 1, len(knots) - 1)
    low, high = knots[above - 1], knots[above]
    share = (inside - low) / (high - low)
    found = np.zeros((len(values), len(knots)))
    rows = np.arange(len(values))
    found[rows, above - 1] = 1.0 - share
    found[rows, above] = share
    return found


def knots_of(values: Array) -> tuple[float, ...]:
    """Return the knots of a table along a quantity (n,), at most nine; () if it hardly changes.

    They are half way between those that are evenly spread from its 1 % to its 99 % quantile and
    those that have equally many samples between them: closer where the motion was often. A quantity
    that is always at one of these ends or 0, such as the direction, has only the two ends. If the
    quantity has clusters with hardly a sample between them, each has knots of its own, and those
    between them are left out.
    """
    low, high = (float(end) for end in np.quantile(values, (0.01, 0.99)))
    if not high > low:
        return ()
    if np.all((values == low) | (values == high) | (values == 0.0)):
        return (low, high)
    parts = clusters(values)
    found: list[float] = []
    for part, count in zip(parts, _shared(parts), strict=True):
        low, high = (float(end) for end in np.quantile(part, (0.01, 0.99)))
        even = np.linspace(low, high, count)
        often = np.quantile(part, np.linspace(0.01, 0.99, count))
        found += [float(np.median(part))] if count == 1 else [*map(float, 0.5 * (even + often))]
    return tuple(found)


def clusters(values: Array) -> list[Array]:
    """Return values (n,) in clusters with hardly a value between them, ascending; at most four.

    Between two clusters there is a stretch of a 16th of the range (1 % to 99 % quantile) or more
    with less than a 20th of the values that it would have if they were evenly spread. The values in
    there belong to no cluster.
    """
    low, high = np.quantile(values, (0.01, 0.99))
    edges = np.linspace(low, high, _BINS + 1)
    full = np.flatnonzero(np.histogram(values, edges)[0] >= _HARDLY * len(values) / _BINS)
    gaps = np.diff(full)
    # The widest gaps are kept if there are too many of them.
    wide = sorted(np.flatnonzero(gaps > _EMPTY), key=lambda k: -gaps[k])[: _CLUSTERS - 1]
    ends = [(edges[full[k] + 1], edges[full[k + 1]]) for k in sorted(wide)]
    begins, stops = [-np.inf, *(end[1] for end in ends)], [*(end[0] for end in ends), np.inf]
    return [
        values[(values >= begin) & (values <= stop)]
        for begin, stop in zip(begins, stops, strict=True)
    ]


def _shared(parts: Sequence[Array]) -> list[int]:
    """Return how many knots of a table each cluster gets: one if it is narrow, else two or more.

    They are `KNOTS` together, or fewer if all clusters are narrow.
    """
    if len(parts) == 1:
        return [KNOTS]
    widths = [float(np.ptp(np.quantile(part, (0.05, 0.95)))) for part in parts]
    whole = float(parts[-1].max() - parts[0].min())
    counts = [2 if width * _BINS > _EMPTY * whole else 1 for width in widths]
    while max(counts) > 1 and sum(counts) < KNOTS:
        worst = max(range(len(parts)), key=lambda k: widths[k] / counts[k] * (counts[k] > 1))
        counts[worst] += 1
    return counts


def tables(quantities: Mapping[str, Array], of: Sequence[str], turned: bool) -> list[Shape]:
    """Return tables along quantities; those that do not change are left out.

    Args:
        quantities: float64 (n,) by name.
        of: names of those along which tables are made.
        turned: whether there are also tables that are multiplied by the direction of motion, along
            all quantities but the direction and the velocity.
    """
    found = []
    for name in of:
        knots = knots_of(quantities[name])
        if not knots:
            continue
        found.append(Shape(name, "", "table", knots))
        if turned and name not in (DIRECTION, "velocity"):
            found.append(Shape(name, DIRECTION, "table", knots))
    return found


def fine_shapes(name: str, values: Array, turned: bool) -> list[Shape]:
    """Return waves and bumps along a quantity; none if it does not change.

    Args:
        name: name of the quantity, along which a disturbance may repeat.
        values: float64 (n,), the quantity sample by sample.
        turned: whether there are also bumps that are multiplied by the direction of motion.
    """
    low, high = (float(end) for end in np.quantile(values, (0.01, 0.99)))
    span = high - low
    if not span > 0.0:
        return []
    inverses = 2.0 / span + 0.5 / span * np.arange(WAVES)
    inverses = inverses[inverses <= 1.0 / _shortest(values)]
    found = [Shape(name, "", "wave", (float(1.0 / inverse),)) for inverse in inverses]
    step = span / (BUMPS - 1)
    for middle in np.linspace(low, high, BUMPS):
        for width in (0.4 * step, step, 2.5 * step):
            found += [
                Shape(name, times, "bump", (float(middle), float(width)))
                for times in (("", DIRECTION) if turned else ("",))
            ]
    return found


def _shortest(values: Array) -> float:
    """Return the shortest period along a quantity (n,), sample by sample, that can be followed.

    The quantity may jump where one stretch of samples ends and another begins.
    """
    steps = np.abs(np.diff(values))
    return _SAMPLES * float(np.median(steps[steps > _MOVING * np.quantile(steps, 0.99)]))


def finer(shape: Shape, span: float) -> list[Shape]:
    """Return variants of a wave or bump, itself among them, with periods or places near its own.

    A bump varies in its middle and width, a hinge in its place, what is beyond a limit in that, a
    lag in its time constant, a resonance in frequency and damping, and a play in its width. A shape
    of another form is returned alone. `span` is the range of the quantity, SI, which sets how far
    the periods of waves and the places of hinges lie apart.
    """
    if shape.form == "hinge":
        (at,), step = shape.at, span / (_HINGES + 1)
        return [replace(shape, at=(at + part * step,)) for part in (-0.6, -0.3, 0.0, 0.3, 0.6)]
    if shape.form == "beyond":
        return [replace(shape, at=(shape.at[0] * factor,)) for factor in _LIMITS_NEAR]
    if shape.form == "lag":
        return [replace(shape, at=(shape.at[0] * factor,)) for factor in (0.7, 0.84, 1.0, 1.2, 1.4)]
    if shape.form == "play":
        return [replace(shape, at=(shape.at[0] * factor,)) for factor in _PLAYS_NEAR]
    if shape.form == "resonance":
        frequency, damping = shape.at
        return [
            replace(shape, at=(frequency * factor, damping * times))
            for factor in (0.9, 0.95, 1.0, 1.05, 1.1)
            for times in (0.5, 1.0, 1.7)
        ]
    if shape.form == "wave":
        inverses = 1.0 / shape.at[0] + np.linspace(-1.0, 1.0, _FINER) / span
        return [
            Shape(shape.of, shape.times, "wave", (float(1.0 / inverse),))
            for inverse in inverses
            if inverse > 0.0
        ]
    if shape.form == "bump":
        middle, width = shape.at
        return [
            Shape(shape.of, shape.times, "bump", (middle + shift * width, factor * width))
            for shift in (-0.6, -0.3, 0.0, 0.3, 0.6)
            for factor in (0.6, 0.8, 1.0, 1.25, 1.6)
        ]
    return [shape]


def symbols(table: Shape, values: Array) -> list[Shape]:
    """Return forms in symbols that may stand in the place of a table along a quantity (n,)."""
    if table.of == DIRECTION:
        return [Shape(table.of, table.times, "x"), Shape("", table.times, "constant")]
    low, high = (float(end) for end in np.quantile(values, (0.01, 0.99)))
    forms = ["x", "x^2"] if low >= 0.0 else ["x", "|x|", "x^2", "x |x|"]
    found = [Shape(table.of, table.times, form) for form in forms]
    found.append(Shape("", table.times, "constant"))
    if table.of != TIME_NAME:
        inner = np.linspace(low, high, _HINGES + 2)[1:-1]
        found += [Shape(table.of, table.times, "hinge", (float(at),)) for at in inner]
        if low < 0.0 < high:
            # Limits lie where the quantity often is, as the knots of a table do.
            limits = np.unique(np.quantile(np.abs(values), np.linspace(0.05, 0.95, _HINGES)))
            found += [
                Shape(table.of, table.times, "beyond", (float(at),)) for at in limits if at > 0.0
            ]
    return found


def corners(shapes: Sequence[Shape]) -> list[Shape]:
    """Return those of some shapes that have a corner at a place, which can be refined (`finer`)."""
    return [shape for shape in shapes if shape.form in CORNERS]


def periodic(regions: Mapping[str, Region], names: Sequence[str]) -> list[str]:
    """Return those of some names of regions along whose quantity a disturbance may repeat."""
    return [name for name in names if name in regions and regions[name].periodic]
