"""This module linearises innovations by the parameters, and sums the products block by block.

The innovations e(theta), with given gains, are linearised about the present values. From their
products, summed in blocks, every least-squares fit of some of the columns follows without another
run: its gain in the sum of squares, and its standard errors. These hold for innovations that are
correlated in time, as long as the blocks are not (sandwich of block scores).
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.plant import Array, BoolArray, Record

BLOCK_S: Final = 0.5
"""Length of a block, s. The ram's slowest motion of its own, the settling of the position loop, is
shorter."""
SETTLING_S: Final = 0.5
"""Time at the start of a record in which the filter settles, s."""
LEAST_SAMPLES: Final = 20
"""Least number of samples in a block and in the settling. Where samples are more than 25 ms apart,
both are longer than half a second."""
HUBER: Final = 5.0
"""Standard deviations. Larger innovations count in proportion and not squared, because a ram that
breaks away is nowhere near linear."""


@dataclass(frozen=True, slots=True)
class Column:
    """One direction in which parameters may change.

    The change of the innovations by a unit step along it is a column of the linear fit.

    Attributes:
        name: name of the direction.
        values: values of all parameters after the change.
        size: size of that change, in the unit of the steps along this direction.
        lower: least step.
        upper: greatest step.
    """

    name: str
    values: Mapping[str, float]
    size: float
    lower: float = -np.inf
    upper: float = np.inf


def mean_squares(errors: Array) -> Array:
    """Return the mean squares (outputs,) of errors (n, outputs), without NaN; NaN if all are."""
    known = ~np.isnan(errors)
    with np.errstate(all="ignore"):
        return np.asarray(np.square(np.where(known, errors, 0.0)).sum(0) / known.sum(0))


def settling(period: float) -> int:
    """Return the number of samples, of this period (s), in which the filter settles."""
    return max(round(SETTLING_S / period), LEAST_SAMPLES)


def slices_of(record: Record, period: float) -> list[slice]:
    """Return a record's blocks as slices, without the settling and an incomplete last block."""
    first, length = settling(period), max(round(BLOCK_S / period), LEAST_SAMPLES)
    return [slice(k, k + length) for k in range(first, len(record) - length + 1, length)]


def cost_of(innovations: Array) -> Array:
    """Return twice Huber's cost of each innovation: its square, or less if it is an outlier.

    An unstable model may miss by so much that its cost is infinite.
    """
    size = np.abs(innovations)
    inside = np.minimum(size, HUBER)
    with np.errstate(over="ignore"):
        return np.asarray(inside * (2.0 * size - inside))


class Linear:
    """Products of a linearisation, summed over each block.

    Attributes:
        columns: directions in which parameters may change.
        products: float64 (blocks, columns, columns), products of the columns with each other.
        slopes: float64 (blocks, columns), products of the columns with the innovations.
        squares: float64 (blocks,), squares of the innovations.
        quartics: float64 (columns,), fourth powers of the columns, summed over all blocks.
        samples: number of readings used.
    """

    def __init__(
        self, columns: Sequence[Column], products: Array, slopes: Array, squares: Array,
        quartics: Array, samples: int,
    ) -> None:  # fmt: skip
        self.columns = tuple(columns)
        self.products, self.slopes, self.squares = products, slopes, squares
        self.quartics, self.samples = quartics, samples
        self._index = {column.name: i for i, column in enumerate(columns)}

    def indices(self, names: Sequence[str]) -> list[int]:
        """Return the indices of columns, given their names."""
        return [self._index[name] for name in names]

    def solve(self, names: Sequence[str]) -> tuple[Array, float]:
        """Return the best steps along named columns, and how much they lower the sum of squares.

        The steps (names,) are within the columns' bounds. They and the lowering are 0 where the
        model breaks down, so that the sums are not finite.
        """
        index = self.indices(names)
        matrix = self.products.sum(0)[np.ix_(index, index)]
        slope = self.slopes.sum(0)[index]
        lower = np.array([self.columns[i].lower for i in index])
        upper = np.array([self.columns[i].upper for i in index])
        if not (np.isfinite(matrix).all() and np.isfinite(slope).all()):
            return np.zeros(len(index)), 0.0  # The model breaks down here: no direction is known.
        steps = bounded_least_squares(matrix, slope, lower, upper)
        return steps, float(-(2.0 * slope @ steps + steps @ matrix @ steps))

    def errors(self, names: Sequence[str], steps: Array) -> Array:
        """Return standard errors (names,) of steps (names,) along columns, by the blocks' scatter.

        Bounds of the columns are not allowed for.
        """
        index = self.indices(names)
        matrix = self.products[:, index][:, :, index]
        scores = self.slopes[:, index] + matrix @ steps
        return standard_errors(matrix, scores)


def standard_errors(products: Array, scores: Array) -> Array:
    """Return standard errors of steps (k,), from the scatter of the blocks' scores.

    Args:
        products: float64 (blocks, k, k), products of the columns with each other.
        scores: float64 (blocks, k), products of the columns with the innovations after the steps.
    """
    total = products.sum(0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = np.linalg.pinv(total * np.outer(scale, scale), rcond=1e-10) * np.outer(scale, scale)
    scatter = scores.T @ scores * len(scores) / max(len(scores) - scores.shape[1], 1)
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse @ scatter @ inverse), 0.0)))


def bounded_least_squares(matrix: Array, slope: Array, lower: Array, upper: Array) -> Array:
    """Return x within bounds that minimises x' matrix x + 2 slope' x, by cyclic descent.

    `matrix` (k, k) must be symmetric and have no negative eigenvalue; all others are (k,). Bounds
    may be infinite.
    """
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    m = matrix * np.outer(scale, scale)
    s, low, high = slope * scale, lower / scale, upper / scale
    free = np.linalg.lstsq(m + 1e-10 * np.eye(len(s)), -s, rcond=None)[0]
    if np.all((free >= low) & (free <= high)):
        return np.asarray(free * scale)
    x = np.clip(free, low, high)
    for _ in range(500):
        before = x.copy()
        for i in range(len(x)):
            rest = s[i] + m[i] @ x - m[i, i] * x[i]
            x[i] = min(max(-rest / max(m[i, i], 1e-12), low[i]), high[i])
        # With the variables at their bounds fixed, the solution for all others is exact.
        inner = (x > low) & (x < high)
        if inner.any():
            rest = -(s[inner] + m[np.ix_(inner, ~inner)] @ x[~inner])
            face = np.linalg.lstsq(
                m[np.ix_(inner, inner)] + 1e-10 * np.eye(inner.sum()), rest, rcond=None
            )[0]
            if np.all((face >= low[inner]) & (face <= high[inner])):
                x[inner] = face
        if np.max(np.abs(x - before)) < 1e-9 * (1.0 + np.max(np.abs(x))):
            break
    return np.asarray(x * scale)


def assemble(
    columns: Sequence[Column], bases: Sequence[Array], changes: Sequence[Sequence[Array]],
    used: Sequence[BoolArray], blocks: Sequence[Sequence[slice]], pool: ThreadPoolExecutor,
) -> Linear:  # fmt: skip
    """Return the linearisation that follows from innovations and their changes.

    As in the cost, innovations beyond `HUBER` count less. There must be at least one block.

    Args:
        columns: directions in which parameters may change.
        bases: for each record float64 (n, outputs), its innovations.
        changes: for each column and each record float64 (n, outputs), the change of the innovations
            by a unit step.
        used: for each record bool (n, outputs), whether a reading is used.
        blocks: for each record, its blocks as slices.
        pool: threads to run in.
    """

    def summed(task: tuple[int, slice]) -> tuple[Array, Array, float, Array, int]:
        number, block = task
        base = bases[number][block]
        roots = np.sqrt(np.minimum(1.0, HUBER / np.maximum(np.abs(base), 1e-12)))
        jacobian = np.empty((len(columns), base.size))
        for place, column in enumerate(changes):
            np.multiply(column[number][block], roots, out=jacobian[place].reshape(base.shape))
        residual = (base * roots).ravel()
        squared = np.square(jacobian)
        return (
            jacobian @ jacobian.T, jacobian @ residual, float(residual @ residual),
            np.einsum("ij,ij->i", squared, squared), int(used[number][block].sum()),
        )  # fmt: skip

    tasks = [(number, block) for number in range(len(bases)) for block in blocks[number]]
    products, slopes, squares, quartics, samples = zip(*pool.map(summed, tasks), strict=True)
    return Linear(
        columns, np.array(products), np.array(slopes), np.array(squares), np.sum(quartics, axis=0),
        sum(samples),
    )  # fmt: skip
