"""Sums over oil accounts, whose size is bounded however long the rig runs.

A regression of the accounts needs sums of products only. They are stored for all blocks up to now,
and for the blocks before each mark; a mark is a place between blocks at which a fault may begin.
When the marks are full, some are removed: the last 50 s keep a mark for every block, and earlier
marks get sparser with age.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.plant import LITRE_PER_MINUTE

from .flow import AccountBlock
from .nuisances import NUISANCE_COUNT
from .row import FAULT_COUNT

Array = NDArray[np.float64]

MARKS: Final = 240
"""Greatest number of marks: one for every half second of two minutes."""
_SHARP: Final = 100
"""Number of latest blocks (50 s) that all keep their marks."""
_PARTS: Final = (32, 16, 8, 4, 2)
"""Divisors that set the spacing of older marks: up to their age divided by this. They are tried in
turn until a quarter of the marks is free."""

SHIFT: Final = FAULT_COUNT
"""Index, after those of the faults, of a shift of the spool's null. It is no fault, but it may look
like the beginning of one."""
SHAPE_COUNT: Final = FAULT_COUNT + 1

_N: Final = NUISANCE_COUNT
_M: Final = SHAPE_COUNT
# One row of sums, packed: nuisances with nuisances and missing flow, missing flow squared, faults
# with faults, nuisances and missing flow, sizes of the faults times seconds, seconds, blocks,
# measured supply pressure.
_FF: Final = 0
_FY: Final = _FF + _N * _N
_YY: Final = _FY + _N
_LL: Final = _YY + 1
_LF: Final = _LL + _M * _M
_LY: Final = _LF + _M * _N
_SIZE: Final = _LY + _M
_SECONDS: Final = _SIZE + _M
_BLOCKS: Final = _SECONDS + 1
_SUPPLY: Final = _BLOCKS + 1
WIDTH: Final = _SUPPLY + 3
"""Number of sums in a packed row."""


class Places:
    """Where in a packed row of sums each kind of sum begins, for compiled code that reads them.

    `FAULT_` marks sums of the six fault columns, of which the last is the null's shift (`SHIFT`).
    """

    SQUARES: Final = _FF
    PRODUCTS: Final = _FY
    MISSING: Final = _YY
    FAULT_SQUARES: Final = _LL
    FAULT_CROSSED: Final = _LF
    FAULT_PRODUCTS: Final = _LY
    SIZES: Final = _SIZE
    SECONDS: Final = _SECONDS
    BLOCKS: Final = _BLOCKS


_FAULT_PARTS: Final = (_LL, _LF, _LY, _SIZE, _SECONDS, _BLOCKS, _SUPPLY)


@njit(cache=True, error_model="numpy")
def _add_products(missing, nuisances, faults, total):
    """Add the products of a block to the packed sums `total` (see above for their order)."""
    for c in range(2):
        y = missing[c]
        total[_YY] += y * y
        for a in range(_N):
            f = nuisances[c, a]
            total[_FY + a] += f * y
            for b in range(_N):
                total[_FF + a * _N + b] += f * nuisances[c, b]
        for i in range(_M):
            u = faults[c, i]
            total[_LY + i] += u * y
            for j in range(_M):
                total[_LL + i * _M + j] += u * faults[c, j]
            for a in range(_N):
                total[_LF + i * _N + a] += u * nuisances[c, a]


class AccountSums:
    """Sums of products over all blocks so far, and over the blocks before each mark.

    Attributes:
        blocks: number of blocks added.
        marks: number of marks at present; mark j lies before block `mark_blocks[j]`.
    """

    def __init__(self) -> None:
        self.blocks = 0
        self.marks = 0
        self._total = np.zeros(WIDTH)
        self._before = np.zeros((MARKS + 1, WIDTH))
        self._mark_blocks = np.zeros(MARKS, dtype=np.int64)
        self._starts = np.zeros(MARKS)
        # Least and greatest position of the ram in the blocks between a mark and the next.
        self._low = np.zeros(MARKS)
        self._high = np.zeros(MARKS)

    @property
    def mark_blocks(self) -> NDArray[np.int64]:
        """Return the index of the block that follows each mark: int64 (marks,)."""
        return self._mark_blocks[: self.marks]

    @property
    def starts_s(self) -> Array:
        """Return the time in s at which the block after each mark starts: (marks,)."""
        return self._starts[: self.marks]

    @property
    def packed(self) -> tuple[Array, Array]:
        """Return the packed sums over all blocks (width,), and those before each mark.

        The latter are (marks, width). Both are in the order of `Places`, and must not be changed.
        """
        return self._total, self._before[: self.marks]

    def add(
        self,
        block: AccountBlock,
        rows: tuple[Array, Array, Array],
        kept: Collection[int] = (),
    ) -> None:
        """Add a block and a mark before it; if the marks are full, thin them out first.

        Args:
            block: the block.
            rows: the block's missing flow (2,), nuisances (2, n), and faults with null shift
                (2, 6), in units of its expected noise.
            kept: indices of blocks whose marks must not be removed.
        """
        if self.marks == MARKS:
            self._thin(kept)
        at = self.marks
        self._before[at] = self._total
        self._mark_blocks[at] = self.blocks
        self._starts[at] = block.start_s
        self._low[at], self._high[at] = block.position_range
        self.marks += 1
        self.blocks += 1
        _add_products(*rows, self._total)
        seconds = block.end_s - block.start_s
        self._total[_SIZE : _SIZE + FAULT_COUNT] += block.sizes * (seconds / LITRE_PER_MINUTE)
        self._total[_SECONDS] += seconds
        self._total[_BLOCKS] += 1.0
        if np.isfinite(block.supply_pressure):
            pressure = block.supply_pressure
            self._total[_SUPPLY:] += (1.0, pressure, pressure * pressure)

    def _thin(self, kept: Collection[int]) -> None:
        for parts in _PARTS:
            stay = self._spaced(parts, kept)
            if stay.size <= 3 * MARKS // 4:
                break
        count = stay.size
        self._low[:count] = np.minimum.reduceat(self._low, stay)
        self._high[:count] = np.maximum.reduceat(self._high, stay)
        for array in (self._before, self._mark_blocks, self._starts):
            array[:count] = array[stay]
        self.marks = count

    def _spaced(self, parts: int, kept: Collection[int]) -> NDArray[np.int64]:
        """Return the indices of the marks to keep so that gaps stay below their age / parts.

        Marks of the last `_SHARP` blocks and of the blocks in `kept` are always among them.
        """
        blocks = [*self._mark_blocks.tolist(), self.blocks]
        stay = [0]
        for j in range(1, MARKS):
            gap = blocks[j + 1] - blocks[stay[-1]]
            age = self.blocks - blocks[j + 1] - _SHARP
            if gap * parts > age or blocks[j] in kept:
                stay.append(j)
        return np.array(stay)

    def mark_of(self, block: int) -> int:
        """Return the index of the mark before a block, or of the next mark if that was removed.

        It is `marks` if there is no such mark.
        """
        return int(self._mark_blocks[: self.marks].searchsorted(block))

    def start_s(self, mark: int) -> float:
        """Return the time in s at which the block after a mark (index below `marks`) starts."""
        return float(self._starts[mark])

    def mark_at(self, time_s: float) -> int:
        """Return the index of the first mark at or after a time in s; `marks` if there is none."""
        return int(self._starts[: self.marks].searchsorted(time_s - 1e-6))

    def travel(self, mark: int) -> float:
        """Return the ram's greatest less its least position in m since a mark (below `marks`)."""
        since = slice(mark, self.marks)
        return float(self._high[since].max() - self._low[since].min())

    def nuisances(self, without: Sequence[tuple[int, int]] = ()) -> tuple[Array, Array, float]:
        """Return the sums of the products that involve no faults.

        Args:
            without: pairs of marks; the blocks between the two marks of a pair do not count.

        Returns:
            Nuisances with nuisances (n, n), nuisances with missing flow (n,), and the missing flow
            squared.
        """
        total = self._total
        for first, last in without:
            total = total - self._at(last) + self._at(first)
        return total[_FF:_FY].reshape(_N, _N), total[_FY:_YY], float(total[_YY])

    def _at(self, mark: int) -> Array:
        return self._total if mark == self.marks else self._before[mark]

    def faults_since(self) -> "FaultProducts":
        """Return the sums of all products with faults, from each mark up to now."""
        since = self._total[_LL:_SUPPLY] - self._before[: self.marks, _LL:_SUPPLY]
        parts = (since[:, a - _LL : b - _LL] for a, b in pairwise(_FAULT_PARTS))
        squares, crossed, products, sizes, seconds, blocks = parts
        return FaultProducts(
            squares.reshape(-1, _M, _M),
            crossed.reshape(-1, _M, _N),
            products,
            sizes[:, :FAULT_COUNT] / seconds,
            blocks[:, 0],
        )

    def weighted(self, weights: Array, first: int, last: int) -> Array:
        """Return weighted sums of the products between each mark and the next.

        Args:
            weights: columns from `estimator.accounts.fit_sums`, float64 (width, k).
            first: index of the first mark.
            last: index of the last mark; `marks` stands for now.

        Returns:
            float64 (last - first, k); row i covers the blocks from mark first + i to the next.
        """
        sums = self._before[first : last + 1] @ weights
        if last == self.marks:
            sums[-1] = self._total @ weights
        return np.asarray(sums[1:] - sums[:-1])

    def mean_sizes(self, mark: int, last: int | None = None) -> Array:
        """Return the faults' mean absolute flows per unit coefficient (5,), L/min.

        Args:
            mark: index of the mark from which they are averaged.
            last: index of the mark up to which they are averaged; None means up to now.
        """
        end = self._total if last is None else self._at(last)
        sums = end - self._before[mark]
        return np.asarray(sums[_SIZE : _SIZE + FAULT_COUNT] / sums[_SECONDS])

    def seconds(self, first: int, last: int | None = None) -> float:
        """Return the duration in s of the blocks between marks `first` and `last` (None: now)."""
        end = self._total if last is None else self._before[last]
        return float(end[_SECONDS] - self._before[first, _SECONDS])

    @property
    def supply_measured(self) -> bool:
        """Return whether any block has a measured supply pressure."""
        return bool(self._total[_SUPPLY])

    def supply(self, first: int, last: int | None = None) -> tuple[float, float, float]:
        """Return count, mean and standard deviation of the measured supply pressures of blocks.

        The blocks are those from mark `first` to mark `last` (None: to now). Pressures are in Pa.
        The count is of blocks with a supply pressure; if it is 0, mean and deviation are NaN.
        """
        end = self._total if last is None else self._before[last]
        count, total, squares = end[_SUPPLY:] - self._before[first, _SUPPLY:]
        if count == 0.0:
            return 0.0, float("nan"), float("nan")
        mean = total / count
        return float(count), float(mean), float(np.sqrt(max(squares / count - mean * mean, 0.0)))


@dataclass(frozen=True)
class FaultProducts:
    """Sums of the products with faults, over the blocks from each mark up to now.

    The six fault columns are the five of `FAULTS` and a shift of the spool's null (`SHIFT`).

    Attributes:
        squares: products of fault columns with each other, float64 (marks, 6, 6).
        crossed: products of fault columns with nuisances, float64 (marks, 6, n).
        products: products of fault columns with missing flow, float64 (marks, 6).
        sizes: mean absolute flow of each fault per unit coefficient, L/min, float64 (marks, 5).
        blocks: number of blocks, float64 (marks,).
    """

    squares: Array
    crossed: Array
    products: Array
    sizes: Array
    blocks: Array
