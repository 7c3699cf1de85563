"""A leak that grows within seconds to minutes, and is steady from then on or grows still.

A sudden leak leaves much of such a leak unexplained, from block to block with the same sign. That
counts as noise that lasts, so that no onset is ever sure. Here each leak is fitted as one that grew
from nothing along a straight line over time (`estimator.accounts.Ramp`), from each of some onsets
and over each of some durations.
"""

from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import (
    SHIFT,
    AccountSums,
    Intervals,
    LikelyRamp,
    Ramp,
    RampFit,
    RampRules,
    RecentBlocks,
    last_mark,
    lasting_noise,
    likeliest_ramp,
)

from .fault_scores import RIVAL_GAIN, SETTLED_PART, WITNESSES
from .finding import Finding

Array = NDArray[np.float64]

DURATIONS_S: Final = tuple(4.0 * 2.0 ** (k / 2.0) for k in range(11))
"""Durations of growth that are tried, s: 4 to 128 in steps of a factor of the root of two. A leak
that grows faster is found as a sudden one, and one that grows more slowly by `fault_size`. Between
two durations a ramp is off by a fifth of its duration at most, until it is refined."""
ONSETS: Final = 40
"""Greatest number of onsets that are tried before the best one is refined. In the first two minutes
they are at most 3 s apart, three quarters of the shortest duration."""
RAMP_PART: Final = 0.05
"""Part of the stated rate of false alarms at which noise may pass for a leak that grows, divided
evenly among the durations. Of the sum of all tests' rates it is a twentieth at most. It is next to
nothing in fact, as a ramp must also be likelier than any sudden fault by odds of e^10. The scores z
of a ramp that goes on and of the sudden fault most like it are correlated by 0.943 (the greatest
value, over a, of (1 + a) sqrt(3 (1 - a)) / 2), so that noise with z = 6 for the ramp, which leaves
5.7 +- 0.33 for the sudden fault, falls short of the 4 that the odds ask for by 5 deviations."""
_RULES: Final = RampRules(
    DURATIONS_S[0], DURATIONS_S[-1], ONSETS, WITNESSES, SETTLED_PART, RIVAL_GAIN
)


def grown_ramp(sums: AccountSums, least: float, begin: Ramp | None = None) -> LikelyRamp | None:
    """Return the leak that most likely grew within the blocks so far; None if none is likely.

    The result is None if a pressure of the lines or a null that moves along a ramp explains as
    much, to odds of e^10, or if the blocks last less than the shortest duration. The leak is taken
    to grow still, unless the odds that it has stopped are e^10.

    Args:
        sums: sums over the blocks.
        least: lower bound of the estimated noise variance.
        begin: a ramp to begin the search at; None to try the ramps of a grid first.
    """
    starts = sums.starts_s
    end_s = float(starts[-1]) + sums.seconds(sums.marks - 1)
    last = last_mark(starts, end_s, DURATIONS_S[0])
    if last < 0:
        return None
    if begin is None:
        marks, seconds = _grid(starts, end_s, last)
    else:
        mark = min(int(np.searchsorted(starts, begin.begin_s - 1e-6)), last)
        since = end_s - float(starts[mark])
        marks = np.array([mark, mark])
        seconds = np.clip([min(begin.seconds, since), since], DURATIONS_S[0], DURATIONS_S[-1])
    if not marks.size:
        return None
    best = likeliest_ramp(sums, least, marks, seconds, _RULES)
    return None if best.gain <= 0.0 or best.rival > best.gain - RIVAL_GAIN else best


def _grid(starts: Array, end_s: float, last: int) -> tuple[NDArray[np.int64], Array]:
    """Return mark and duration of the ramps that are tried first.

    From each onset they have the durations that have passed, and the time since the onset.

    Args:
        starts: time at which the block after each mark starts, s, (marks,).
        end_s: time at which the last block ends, s.
        last: the last mark at which a ramp may begin.
    """
    marks = np.unique(np.linspace(0, last, min(ONSETS, last + 1)).astype(int))
    since = end_s - starts[marks, None]
    seconds = np.hstack([np.broadcast_to(DURATIONS_S, (marks.size, len(DURATIONS_S))), since])
    tried = np.hstack([seconds[:, :-1] < since, since <= DURATIONS_S[-1]])
    return marks[np.nonzero(tried)[0]], seconds[tried]


def grown_leak(
    sums: AccountSums,
    recent: RecentBlocks,
    likely: LikelyRamp,
    dead_zone: Array,
    model_error: float,
) -> Finding:
    """Return the finding of a leak that grew, with statistic and size.

    Args:
        sums: sums over the blocks.
        recent: the latest blocks, which show whether noise lasts from block to block.
        likely: the leak, from `grown_ramp`.
        dead_zone: flow in L/min that each fault must exceed to be claimed, float64 (5,).
        model_error: factor on what is allowed for errors of the model.

    Returns:
        The finding, whose `statistic` is that of a sudden fault: it holds without any one block.
        Its `limit` is left at 0 for the caller to set.
    """
    intervals, mark, fault = Intervals(sums), likely.mark, likely.fault
    ramp = ramp_of(sums, likely)
    level = intervals.level(ramp)
    shapes, levels = [SHIFT, fault], np.stack([level, level])
    fit = RampFit(intervals, shapes, levels, likely.variance)
    # Departures from a straight line must not count as noise, as in `FaultSizes.sudden`.
    blocks = level.size - mark
    loose = fit
    if blocks >= 3 * WITNESSES:
        thirds = np.array([[mark + blocks // 3], [mark + 2 * blocks // 3]])
        changes = (np.arange(level.size) >= thirds).astype(float)
        both = np.vstack([changes, levels])
        loose = RampFit(intervals, [fault, fault, *shapes], both, likely.variance)
    lasting = lasting_noise(recent.residuals(loose.nuisances, loose.terms()), model_error)
    dead = float(dead_zone[fault] / sums.mean_sizes(mark)[fault])
    rest, error = fit.left_out()
    statistic = float(((rest - dead) / np.sqrt(error * lasting)).min())
    deviation = sqrt(max(fit.error, fit.uneven_error()) * lasting)
    size, mean = float(fit.coefficients[-1]), float(level[mark:].mean())
    return Finding(
        fault, int(sums.mark_blocks[mark]), size * mean, deviation * mean, statistic,
        likely.gain, ramp.begin_s, lasting, size * float(level[-1]), ramp=ramp,
    )  # fmt: skip


def ramp_of(sums: AccountSums, likely: LikelyRamp) -> Ramp:
    """Return the ramp along which a leak grew."""
    return Ramp(sums.start_s(likely.mark), likely.seconds)
