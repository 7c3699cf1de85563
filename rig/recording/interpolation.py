"""Channels that were sampled more slowly than their rows say are recognised here.

A log of 100 Hz that is written at 1 kHz has either each reading ten times, or straight lines
between the readings. A filter that takes such rows for readings believes far too much in them.
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .recording import FloatArray

LEAST: Final = 350
SHARE: Final = 0.9
SINGLE: Final = 0.52
"""A channel counts as interpolated if its course breaks at least 350 times after a stretch without
a break, at least 90 % of these stretches have one of two adjacent lengths, and at most 52 % of all
breaks follow one another directly.

Readings that are independent break at random: the lengths of the stretches are geometric, and with
a share p of direct followers the likeliest pair of lengths, 2 and 3, has the share 1 - (1 - p)^2 of
the others, 77 % at most. That 90 % or more of 350 have it has a probability below
e^(-350 * 0.057) = 2e-9 (Chernoff), or 3e-8 for six channels and both kinds."""
_STEP: Final = 1.5
"""Counts by which a channel that repeats its readings must usually change, where it changes. An
encoder that moves evenly steps at even times too, but by one count."""
_BEND: Final = 2.5
"""A change of slope is a break if it is larger than this many counts of the channel. That of an
interpolation which is rounded to counts is two at most."""
_ROUNDED: Final = 1e-6
"""A difference that is smaller than this part of the mean step between rows is rounding."""
_OFF: Final = 0.05
"""Greatest share of a channel's breaks off the true samples of another channel, if it is to have
the same true samples."""


@dataclass(frozen=True)
class Interpolated:
    """A channel whose rows are not all readings.

    Attributes:
        held: whether each reading is repeated; otherwise straight lines join the readings.
        rows: usual number of rows from one reading to the next.
    """

    held: bool
    rows: int

    @property
    def words(self) -> str:
        """What was done to the channel, in words that follow its name."""
        how = "repeats each reading" if self.held else "joins readings by straight lines"
        return f"{how}: only about one row in {self.rows} was measured"


def _breaks(values: FloatArray, held: bool) -> tuple[NDArray[np.intp], float]:
    """Return the rows at which values (n,) break, and the least step between values, their count.

    A break is a step if readings are `held`, else a change of slope; differences that are due to
    rounding do not count.
    """
    distinct = np.unique(values)
    if len(distinct) < 2:
        return np.empty(0, dtype=np.intp), 0.0
    moved = np.diff(values)
    last_bits = float(16.0 * np.finfo(np.float64).eps * np.abs(distinct).max())
    rounding = max(last_bits, float(_ROUNDED * np.mean(np.abs(moved))))
    steps = np.diff(distinct)
    # Interpolated numbers differ in their last bits, by the rounding of times; these are no counts.
    count = float(np.min(steps[steps > rounding], initial=np.inf))
    if held:
        return np.flatnonzero(np.abs(moved) > rounding) + 1, count
    bent = np.abs(values[2:] - 2.0 * values[1:-1] + values[:-2])
    return np.flatnonzero(bent > max(_BEND * count, rounding)) + 1, count


def _course(values: FloatArray, held: bool) -> tuple[Interpolated, NDArray[np.intp]] | None:
    """Return how values (n,) are interpolated, and their breaks; None if they are not interpolated.

    `held` says what is looked for: repeated readings, or else readings joined by straight lines. Of
    several breaks in adjacent rows only the first is returned.
    """
    rows, count = _breaks(values, held)
    lengths = np.diff(rows)
    longer = lengths[lengths > 1]
    if len(longer) < LEAST or len(longer) < (1.0 - SINGLE) * len(lengths):
        return None
    after = rows[1:][lengths > 1]
    if held and np.median(np.abs(values[after] - values[after - 1])) < _STEP * count:
        return None
    counts = np.bincount(np.minimum(longer, 10_000))
    pairs = counts[:-1] + counts[1:]
    if pairs.max() < SHARE * len(longer):
        return None
    # Where a reading lies between two rows, the slope changes at both, and the second is left out.
    single = rows[np.concatenate([[True], lengths > 1])]
    return Interpolated(held, round(float(np.median(np.diff(single))))), single


def _true_rows(breaks: NDArray[np.intp], every: int, count: int) -> NDArray[np.bool_]:
    """Return a mask (count,) of the rows that were measured.

    These are the `breaks`, and from each break on every `every`-th row until shortly before the
    next one.
    """
    true = np.zeros(count, dtype=np.bool_)
    for row, end in pairwise(np.append(breaks, count).tolist()):
        true[row : max(end - every // 2, row + 1) : every] = True
    return true


def without_interpolated(
    channels: dict[str, FloatArray], measured: list[str]
) -> tuple[dict[str, FloatArray], dict[str, Interpolated]]:
    """Return all channels, with NaN where a row is no reading, and those found interpolated.

    If some channel is found interpolated, the rows that were measured of the one that breaks most
    often are taken for those of the other tried channels, too. A channel with a missing value, or
    with more than 5 % of its own breaks in other rows, is left as it is.

    Args:
        channels: all channels, each (n,); they are not changed.
        measured: names of the channels that are tried.

    Returns:
        The channels, and name -> how it is interpolated for those that are.
    """
    courses = {}
    for name in measured:
        values = channels[name][np.isfinite(channels[name])]
        found = _course(values, held=True) or _course(values, held=False)
        if found is not None:
            courses[name] = found
    if not courses:
        return channels, {}
    made, found_in = dict(channels), dict[str, Interpolated]()
    for name, (how, breaks) in courses.items():
        found_in[name] = how
        known = np.flatnonzero(np.isfinite(channels[name]))
        true = np.zeros(len(channels[name]), dtype=np.bool_)
        true[known] = _true_rows(breaks, how.rows, len(known))
        made[name] = np.where(true, channels[name], np.nan)
    pattern = max(courses, key=lambda name: len(courses[name][1]))
    true = np.isfinite(made[pattern])
    for name in measured:
        values = channels[name]
        if name in courses or not np.isfinite(values).all():
            continue
        breaks = _breaks(values, found_in[pattern].held)[0]
        if np.count_nonzero(~true[breaks]) <= _OFF * len(breaks):
            made[name] = np.where(true, values, np.nan)
            found_in[name] = found_in[pattern]
    return made, found_in
