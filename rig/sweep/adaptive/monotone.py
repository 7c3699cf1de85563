"""Estimates the size at which a wanted share of leaks is found, if larger ones are found oftener.

The interval is that of the likelihood ratio for a monotone function (Banerjee and Wellner 2001,
"Likelihood ratio tests for monotone functions", Annals of Statistics 29, 1699): a size belongs to
it if the outcomes are nearly as likely under a share that grows with the size and passes the wanted
share there, as under the best share that grows with the size anyhow. No form of curve is assumed.
"""

from math import log
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DRAWN: Final = 2.29
"""95 % quantile of twice the logarithm of the likelihood ratio at the true size. Its limit for many
outcomes is the same for all curves that rise (Banerjee and Wellner 2001). Draws lie about the
interval that follows from it."""
TOLD: Final = 3.84
"""Limit of twice that logarithm for an interval that is told, and that may end a sweep: the 95 %
quantile for a curve of known form (chi-squared with one degree of freedom). An interval that is
looked at after each batch, and told when it happens to be narrow, would hold the true size in 82 to
87 of 100 sweeps by the smaller limit, and does in 93 to 98 by this one (decision 51)."""


_EQUAL: Final = 1e-9
"""Sizes of which twice the logarithm of the likelihood differs by less are equally likely."""


class Crossing(NamedTuple):
    """Where the share of leaks that are found passes the wanted share.

    Sizes are on the scale on which they were given. A bound is -infinity if it is below all sizes
    that were tried, and infinity if it is above them.

    Attributes:
        low: lower end of the 95 % interval that is told.
        high: its upper end.
        middle: the most likely size; NaN if all sizes are equally likely.
        near_low: lower end of the interval about which the next sizes are drawn.
        near_high: its upper end.
    """

    low: float
    high: float
    middle: float
    near_low: float
    near_high: float


def crossing(sizes: Array, found: NDArray[np.bool_], share: float) -> Crossing:
    """Return where the share that is found, which grows with the size, passes the wanted share.

    Args:
        sizes: sizes of leaks on any scale that grows, (n,).
        found: whether each was found, (n,).
        share: the wanted share, above 0 and below 1.
    """
    levels, tried, right = _levels(sizes, found)
    ends = np.concatenate([[-np.inf], levels, [np.inf]])
    best = _likelihoods(tried, right, 1.0)[-1]
    below = _likelihoods(tried, right, share)
    above = _likelihoods(tried[::-1], (tried - right)[::-1], 1.0 - share)[::-1]
    # Entry i belongs to a crossing between level i - 1 and level i.
    ratio = 2.0 * (best - below - above)

    def within(limit: float) -> tuple[float, float]:
        inside = np.flatnonzero(ratio <= limit)
        return float(ends[inside[0]]), float(ends[inside[-1] + 1])

    first, last = within(float(ratio.min()) + _EQUAL)
    if np.isinf(first) and np.isinf(last):
        middle = np.nan
    elif np.isinf(first) or np.isinf(last):
        middle = first if np.isinf(first) else last
    else:
        middle = 0.5 * (first + last)
    return Crossing(*within(TOLD), middle, *within(DRAWN))


def steps(sizes: Array, found: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Return the most likely share that grows with the size: the sizes tried, and its value there.

    Args:
        sizes: sizes of leaks, (n,).
        found: whether each was found, (n,).

    Returns:
        The different sizes in ascending order, (m,), and the share at each, (m,).
    """
    levels, tried, right = _levels(sizes, found)
    blocks = _Blocks()
    for of, count in zip(tried.tolist(), right.tolist(), strict=True):
        blocks.add(of, count)
    shares = [count / of for of, count in zip(blocks.tried, blocks.right, strict=True)]
    return levels, np.repeat(np.array(shares), np.array(blocks.levels, dtype=np.intp))


def _levels(sizes: Array, found: NDArray[np.bool_]) -> tuple[Array, Array, Array]:
    """Return the different sizes in ascending order, how many had each, and how many were found."""
    levels, at = np.unique(sizes, return_inverse=True)
    tried = np.bincount(at, minlength=levels.size).astype(np.float64)
    right = np.bincount(at, weights=found.astype(np.float64), minlength=levels.size)
    return levels.astype(np.float64), tried, right.astype(np.float64)


class _Blocks:
    """The most likely growing share of the levels that were added, as blocks of equal share.

    Neighbouring levels are pooled while a later one has no greater share (Ayer et al. 1955).

    Attributes:
        tried, right, levels: of each block, how many outcomes it has, how many of them were found,
            and how many levels it has.
    """

    def __init__(self) -> None:
        self.tried: list[float] = []
        self.right: list[float] = []
        self.levels: list[int] = []

    def add(self, tried: float, right: float) -> int:
        """Add the next level, and return how many of the last blocks it was pooled with."""
        pooled, levels = 0, 1
        while self.tried and self.right[-1] * tried >= right * self.tried[-1]:
            tried += self.tried.pop()
            right += self.right.pop()
            levels += self.levels.pop()
            pooled += 1
        self.tried.append(tried)
        self.right.append(right)
        self.levels.append(levels)
        return pooled


def _likelihoods(tried: Array, right: Array, most: float) -> Array:
    """Return for each number of first levels the greatest log-likelihood of a growing share.

    The share is at most `most`. The best such share is the best one without that limit, cut off at
    it, so that each block of it has a likelihood of its own.

    Args:
        tried: number of outcomes of each level, (m,).
        right: how many of them were found, (m,).
        most: greatest share allowed.

    Returns:
        The log-likelihood of the first 0, 1, ... m levels, (m + 1,).
    """
    blocks, sums, found = _Blocks(), [0.0], [0.0]
    for of, count in zip(tried.tolist(), right.tolist(), strict=True):
        pooled = blocks.add(of, count)
        del sums[len(sums) - pooled :]
        sums.append(sums[-1] + _log_likelihood(blocks.tried[-1], blocks.right[-1], most))
        found.append(sums[-1])
    return np.array(found)


def _log_likelihood(tried: float, right: float, most: float) -> float:
    """Return the log-likelihood of a block's outcomes at its share, which is at most `most`."""
    share, missed = min(right / tried, most), tried - right
    return (right * log(share) if right else 0.0) + (missed * log(1.0 - share) if missed else 0.0)
