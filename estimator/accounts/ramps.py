"""Faults that grow in the oil accounts: their products and their fit with nuisances.

A fault that begins suddenly has the same coefficient in all blocks from a mark on. One that grows
has a level in each block, between 0 before it begins and 1 once it has grown: its coefficient is
that of the grown fault, times the level. Products of such a column are sums over the intervals
between marks, weighted by the level in each.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from .joint_fit import MOST_LEVERAGE, inverse_of
from .nuisances import NUISANCE_COUNT, NULL_SHIFT
from .sums import SHAPE_COUNT, SHIFT, AccountSums, Places

Array = NDArray[np.float64]

_N = NUISANCE_COUNT
_M = SHAPE_COUNT


@dataclass(frozen=True)
class Ramp:
    """A fault's growth: from nothing in a straight line over time, and steady from then on.

    Attributes:
        begin_s: time at which the growth begins, s.
        seconds: how long the fault grows, s; above 0.
    """

    begin_s: float
    seconds: float


class Intervals:
    """The sums of products between each mark and the next, as they are now.

    Args:
        sums: sums over the blocks so far.

    Attributes:
        sums: as given.
        middle_s: time in the middle of each interval, s, float64 (marks,).
        end_s: time at which the last block ends, s.
    """

    def __init__(self, sums: AccountSums) -> None:
        self.sums = sums
        total, before = sums.packed
        self._rows = np.diff(np.vstack([before, total]), axis=0)
        starts = sums.starts_s
        self.end_s = float(starts[-1]) + sums.seconds(sums.marks - 1)
        self.middle_s = 0.5 * (starts + np.append(starts[1:], self.end_s))

    def _part(self, place: int, *shape: int) -> Array:
        width = int(np.prod(shape))
        return self._rows[:, place : place + width].reshape(-1, *shape)

    @cached_property
    def nuisance_squares(self) -> Array:
        """Return the nuisances' products with each other, (marks, n, n)."""
        return self._part(Places.SQUARES, _N, _N)

    @cached_property
    def nuisance_products(self) -> Array:
        """Return the nuisances' products with the missing flow, (marks, n)."""
        return self._part(Places.PRODUCTS, _N)

    @cached_property
    def squares(self) -> Array:
        """Return the products of faults and null shift with each other, (marks, 6, 6)."""
        return self._part(Places.FAULT_SQUARES, _M, _M)

    @cached_property
    def crossed(self) -> Array:
        """Return the products of faults and null shift with the nuisances, (marks, 6, n)."""
        return self._part(Places.FAULT_CROSSED, _M, _N)

    @cached_property
    def products(self) -> Array:
        """Return the products of faults and null shift with the missing flow, (marks, 6)."""
        return self._part(Places.FAULT_PRODUCTS, _M)

    def level(self, ramp: Ramp) -> Array:
        """Return the level, 0 to 1, of a ramp in each interval, (marks,)."""
        return np.clip((self.middle_s - ramp.begin_s) / ramp.seconds, 0.0, 1.0)


class RampFit:
    """Least squares of the missing flows on all nuisances and some faults, each with its levels.

    Args:
        intervals: the sums between marks.
        faults: indices into `FAULTS`, or `SHIFT`, which has a prior of `NULL_SHIFT`.
        levels: level of each fault in each interval, (faults, marks).
        variance: noise variance, in units of the expected noise.

    Attributes:
        faults, levels: as given.
        nuisances: sizes of the nuisances in standard deviations, float64 (n,).
        coefficients: coefficients of the faults at level 1, SI units, float64 (faults,).
        error: variance of the last coefficient if noise is the same in all blocks.
        explained: reduction of the weighted sum of squares by all columns together.
    """

    def __init__(
        self, intervals: Intervals, faults: Sequence[int], levels: Array, variance: float
    ) -> None:
        self._intervals, self.faults, self.levels = intervals, faults, levels
        of = np.asarray(faults)
        squares, products, _ = intervals.sums.nuisances()
        normal = np.empty((_N + of.size, _N + of.size))
        normal[:_N, :_N] = squares + variance * np.eye(_N)
        crossed = np.einsum("cj,jca->ca", levels, intervals.crossed[:, of])
        normal[_N:, :_N], normal[:_N, _N:] = crossed, crossed.T
        pairs = intervals.squares[:, of[:, None], of]
        normal[_N:, _N:] = np.einsum("cj,dj,jcd->cd", levels, levels, pairs)
        normal[_N:, _N:] += np.diag(np.where(of == SHIFT, variance / NULL_SHIFT**2, 0.0))
        right = np.append(products, np.einsum("cj,jc->c", levels, intervals.products[:, of]))
        inverse = inverse_of(normal)
        self._direction = inverse[-1]
        self._fitted = inverse @ right
        self.explained = float(self._fitted @ right)
        self.nuisances, self.coefficients = self._fitted[:_N], self._fitted[_N:]
        self.error = variance * float(inverse[-1, -1])

    def terms(self) -> list[tuple[int, int, float]]:
        """Return the faults as sudden ones that add up to them, for `RecentBlocks.residuals`.

        Each is the fault's index, the index of its first block, and its coefficient in SI units.
        """
        blocks = self._intervals.sums.mark_blocks
        steps = np.diff(self.levels, axis=1, prepend=0.0)
        return [
            (fault, int(blocks[mark]), float(size * step[mark]))
            for fault, size, step in zip(self.faults, self.coefficients, steps, strict=True)
            for mark in np.flatnonzero(step)
        ]

    def _in_each(self, vector: Array) -> tuple[Array, Array]:
        """Return a vector's part of the nuisances (n,), and of the faults in each interval.

        The latter is (marks, faults).
        """
        return vector[:_N], vector[_N:] * self.levels.T

    def _form(self, left: Array, right: Array) -> Array:
        """Return left' X'X right of the blocks in each interval, (marks,)."""
        of, here = np.asarray(self.faults), self._intervals
        a, c = self._in_each(left)
        b, d = self._in_each(right)
        crossed = here.crossed[:, of]
        found = np.einsum("a,jab,b->j", a, here.nuisance_squares, b, optimize=True)
        found += np.einsum("jc,jc->j", c, crossed @ b) + np.einsum("jc,jc->j", d, crossed @ a)
        pairs = here.squares[:, of[:, None], of]
        return np.asarray(found + np.einsum("jc,jcd,jd->j", c, pairs, d))

    @cached_property
    def _influences(self) -> tuple[Array, Array]:
        """Return each interval's influence on the last coefficient, and its leverage, (marks,)."""
        a, c = self._in_each(self._direction)
        products = self._intervals.products[:, np.asarray(self.faults)]
        influence = self._intervals.nuisance_products @ a + (c * products).sum(axis=1)
        influence -= self._form(self._direction, self._fitted)
        leverage = self._form(self._direction, self._direction) / self._direction[-1]
        return influence, np.clip(leverage, 0.0, MOST_LEVERAGE)

    def uneven_error(self) -> float:
        """Return the variance of the last coefficient if noise differs from block to block.

        It is that of `JointFit.uneven_error`.
        """
        influence, leverage = self._influences
        return float((influence**2 / (1.0 - leverage)).sum())

    def left_out(self) -> tuple[Array, Array]:
        """Return what the last coefficient would be without the blocks of each interval.

        Returns:
            The coefficients and their variances, (marks,) each, as of `JointFit.left_out`.
        """
        influence, leverage = self._influences
        kept = 1.0 - leverage
        shares = influence**2 / kept
        uneven = shares.sum() - shares
        return self._fitted[-1] - influence / kept, np.maximum(self.error, uneven) / kept
