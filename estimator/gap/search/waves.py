"""This module selects those waves along a quantity that are worth an exact look.

Hundreds of periods are possible along a stroke, and to follow each through the linearised course
takes most of the time of a search. By how much a wave would lower the cost follows from two
figures, to second order: the slope of the cost, and its curvature. The slopes of all waves follow
from one run backwards along the course (`Attribution.pull`). The curvature changes slowly with the
period, so that it is computed for a few periods and interpolated between them.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from estimator.gap.plant import Array

from .disturbances import Attribution, Place
from .shapes import Shape

FEW: Final = 24
"""Number of waves up to which all are looked at."""
_EVERY: Final = 16
"""The curvature is computed for one of so many waves."""
_LOOKED_AT: Final = 6
"""Number of waves that are selected."""
_BINS: Final = 8192
"""Number of bins along the quantity in which pulls are summed. The shortest of 250 waves, half the
range apart in 1 / period, has 64 of them in a period."""


def promising(
    attribution: Attribution, place: Place, waves: Sequence[Shape], along: Sequence[Array],
    least: float = 0.0,
) -> list[Shape]:  # fmt: skip
    """Return the `_LOOKED_AT` waves that promise the most, by falling period; all if they are few.

    Of more than a few, those that promise to lower the cost by less than `least` are left out.

    Args:
        attribution: linearised courses, with what is to be explained.
        place: place where the disturbance enters.
        waves: waves of one quantity, by falling period.
        along: that quantity at each sample of each course, (m,) each, SI.
        least: least promise that is worth a look.
    """
    if len(waves) <= FEW:
        return list(waves)
    periods = np.array([wave.at[0] for wave in waves])
    slopes = _slopes(attribution.pull(place), along, periods)
    some = np.unique(np.r_[np.arange(0, len(waves), _EVERY), len(waves) - 1])
    columns = [
        np.concatenate([waves[k].columns({waves[k].of: values}) for k in some], axis=1)
        for values in along
    ]
    ((products, _),) = attribution.summed(place, columns, [2 * len(some)])
    squares = np.diag(products.sum(0))[-2 * len(some) :].reshape(-1, 2).mean(1)
    curvatures = np.interp(np.arange(len(waves)), some, squares)
    gains = np.abs(slopes) ** 2 / np.maximum(curvatures, 1e-12 * curvatures.max())
    return [waves[k] for k in np.sort(np.argsort(-gains)[:_LOOKED_AT]) if gains[k] >= least]


def _slopes(pulls: Sequence[Array], along: Sequence[Array], periods: Array) -> Array:
    """Return the slope of the cost by the sine and cosine of each period, complex (periods,).

    The cosine's slope is the real part. `pulls` has the slope by a disturbance at each sample of
    each course, (m,) each.
    """
    pull, values = np.concatenate(pulls), np.concatenate(along)
    low, high = float(values.min()), float(values.max())
    place = (values - low) * (_BINS - 1) / (high - low)
    below = np.minimum(place.astype(np.int64), _BINS - 2)
    share = place - below
    summed = np.bincount(below, pull * (1.0 - share), _BINS)
    summed += np.bincount(below + 1, pull * share, _BINS)
    middles = np.linspace(low, high, _BINS)
    return np.asarray(np.exp(2j * np.pi * np.outer(1.0 / periods, middles)) @ summed)
