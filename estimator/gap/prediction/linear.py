"""How innovations change with parameters, to first order: block by block, for all at once.

Innovations e(theta) of given gains are linearised about the present values. From their products,
summed in blocks, every nested least-squares fit follows without another run: its gain in the sum of
squares, and standard errors that hold for innovations which are correlated in time, as long as the
blocks are not (sandwich of block scores).
"""

from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Final

import numpy as np

from estimator.gap.plant import Array, BoolArray, Record

BLOCK_S: Final = 0.5
"""s. The ram's slowest mode of its own, the settling of the position loop, is shorter."""
SETTLING_S: Final = 0.5
"""s at the start of a record, in which the filter settles."""
HUBER: Final = 5.0
"""Innovations beyond so many standard deviations count in proportion, not squared: breaking away,
the ram is nowhere near linear."""


@dataclass(frozen=True, slots=True)
class Column:
    """One direction in which parameters may change.

    Attributes:
        name: of it.
        values: of all parameters at the end of the change.
        size: of the change, in the units in which steps along it are given.
        lower: least step.
        upper: greatest step.
    """

    name: str
    values: Mapping[str, float]
    size: float
    lower: float = -np.inf
    upper: float = np.inf


def mean_squares(errors: Array) -> Array:
    """Return the mean squares (outputs,) of errors (n, outputs) that are known, NaN of none."""
    known = ~np.isnan(errors)
    with np.errstate(all="ignore"):
        return np.asarray(np.square(np.where(known, errors, 0.0)).sum(0) / known.sum(0))


def slices_of(record: Record, period: float) -> list[slice]:
    """Return the blocks of a record, the settling left out."""
    first, length = round(SETTLING_S / period), round(BLOCK_S / period)
    return [slice(k, k + length) for k in range(first, len(record) - length + 1, length)]


def cost_of(innovations: Array) -> Array:
    """Return Huber's cost, twice, of innovations: their square where they are not outliers."""
    size = np.abs(innovations)
    return np.where(size < HUBER, size * size, HUBER * (2.0 * size - HUBER))


class Linear:
    """Block sums of a linearisation.

    Attributes:
        columns: the directions.
        products: float64 (blocks, columns, columns), of the columns with each other.
        slopes: float64 (blocks, columns), of the columns with the innovations.
        squares: float64 (blocks,), of the innovations.
        quartics: float64 (columns,), of the columns' fourth powers.
        samples: readings used.
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
        """Return the places of columns by their names."""
        return [self._index[name] for name in names]

    def solve(self, names: Sequence[str]) -> tuple[Array, float]:
        """Return steps along columns within their bounds, and what the sum of squares gains."""
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
        """Return standard errors of steps, from the scatter of the blocks' scores."""
        index = self.indices(names)
        matrix = self.products[:, index][:, :, index]
        scores = self.slopes[:, index] + matrix @ steps
        return standard_errors(matrix, scores)


def standard_errors(products: Array, scores: Array) -> Array:
    """Return standard errors of steps (k,), from the scatter of the blocks' scores there.

    Args:
        products: float64 (blocks, k, k), of the columns with each other.
        scores: float64 (blocks, k), of the columns with what the steps leave of the innovations.
    """
    total = products.sum(0)
    scale = 1.0 / np.sqrt(np.maximum(np.diag(total), 1e-300))
    inverse = np.linalg.pinv(total * np.outer(scale, scale), rcond=1e-10) * np.outer(scale, scale)
    scatter = scores.T @ scores * len(scores) / max(len(scores) - scores.shape[1], 1)
    return np.asarray(np.sqrt(np.maximum(np.diag(inverse @ scatter @ inverse), 0.0)))


def bounded_least_squares(matrix: Array, slope: Array, lower: Array, upper: Array) -> Array:
    """Return x within bounds that minimises x' matrix x + 2 slope' x, by cyclic descent."""
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
        # On the face that the bounds leave, the solution is exact.
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
    """Return a linearisation from what records gave.

    Args:
        columns: the directions.
        bases: of each record float64 (n, outputs): its innovations.
        changes: of each column and record float64 (n, outputs): change of these by a unit step.
        used: of each record bool (n, outputs): whether a reading is used.
        blocks: of each record.
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
