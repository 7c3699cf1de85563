"""Sparse regression of disturbances on a library of candidate terms (Brunton 2016), by PySINDy."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from estimator.gap.plant import Array
from tools.peers.discrepancy import Learned, Learner, Samples, Target
from tools.peers.folds import left_out, parts_of
from tools.peers.optional import needed

THRESHOLDS: Final = (0.02, 0.05, 0.1, 0.2, 0.4)
"""Least coefficients that are kept, in root mean squares of the target for one of a column."""
RIDGES: Final = (1e-4, 1e-2)
"""Weights on the squared coefficients, for each sample."""
WAVES: Final = 12
"""Number of sines and cosines along a periodic quantity: half a wave to six over the range."""
HINGES: Final = (0.25, 0.5, 0.75)
"""Quantiles of each quantity at which a hinge, max(0, x - at), begins."""
STEEP: Final = 0.05
"""The sign of x is tanh(x / STEEP), x being scaled."""
SIMPLER: Final = 0.02
"""A model with fewer terms is taken if it loses at most this part of what the best explains."""
SAME: Final = 0.999
"""Two columns whose cosine is as large are the same term; the one that is listed first is kept."""
_DEPENDENT: Final = 1e-9


class Library:
    """The candidate terms, of quantities that are scaled by their root mean squares.

    They are a constant, powers up to the third, |x|, x |x|, the sign, hinges, products of two
    quantities and of one with the modulus or the square of another, and waves along periodic ones.
    Each column is scaled to a root mean square of one.

    Args:
        quantities: float64 (n, d), to be fitted to.
        target: what is fitted, with the names of the quantities.

    Attributes:
        names: of the columns.
    """

    def __init__(self, quantities: Array, target: Target) -> None:
        self._low, self._span = quantities.min(0), np.ptp(quantities, axis=0)
        self._scale = np.maximum(np.sqrt(np.mean(quantities**2, axis=0)), 1e-300)
        self._hinges = np.quantile(quantities, HINGES, axis=0)
        varies = np.flatnonzero(self._span > 1e-9 * self._scale)
        self._varies = [int(k) for k in varies]
        self._waves = [k for k in self._varies if target.quantities[k] in target.periodic]
        self.names = self._named(target.quantities)
        self._kept, self._columns = np.arange(len(self.names)), np.ones(len(self.names))
        columns = self(quantities)
        sizes = np.maximum(np.sqrt(np.mean(columns**2, axis=0)), 1e-300)
        self._kept = _distinct(columns / sizes)
        self._columns = sizes[self._kept]
        self.names = [self.names[k] for k in self._kept]

    def _named(self, names: Sequence[str]) -> list[str]:
        found = ["1"]
        for x in (names[k] for k in self._varies):
            found += [x, f"|{x}|", f"{x}^2", f"{x} |{x}|", f"{x}^3", f"sgn({x})"]
            found += [f"max(0, {x} - {part:.0%} quantile)" for part in HINGES]
        for k in self._waves:
            pitches = 2.0 * self._span[k] / np.arange(1, WAVES + 1)
            for pitch in pitches:
                found += [f"{wave}(2 pi {names[k]} / {pitch:.3g})" for wave in ("sin", "cos")]
        for a, b in combinations([names[k] for k in self._varies], 2):
            found += [f"{a} {b}", f"{a} |{b}|", f"|{a}| {b}", f"{a}^2 {b}", f"{a} {b}^2"]
        return found

    def __call__(self, quantities: Array) -> Array:
        """Return the columns (n, terms) at quantities (n, d)."""
        x = quantities / self._scale
        columns = [np.ones(len(x))]
        for k in self._varies:
            each = x[:, k]
            columns += [each, np.abs(each), each**2, each * np.abs(each), each**3]
            columns.append(np.tanh(each / STEEP))
            columns += [np.maximum(0.0, quantities[:, k] - at) for at in self._hinges[:, k]]
        for k in self._waves:
            place = np.pi * (quantities[:, k] - self._low[k]) / self._span[k]
            for wave in range(1, WAVES + 1):
                columns += [np.sin(wave * place), np.cos(wave * place)]
        for a, b in combinations(x.T[self._varies], 2):
            columns += [a * b, a * np.abs(b), np.abs(a) * b, a**2 * b, a * b**2]
        return np.asarray(np.column_stack(columns)[:, self._kept] / self._columns)


def _distinct(columns: Array) -> NDArray[np.int64]:
    """Return the indices of columns (n, terms) that are not the same as one before them."""
    alike = np.abs(columns.T @ columns) / len(columns)
    kept: list[int] = []
    for k in range(len(alike)):
        if not kept or alike[k, kept].max() < SAME:
            kept.append(k)
    return np.array(kept)


@dataclass(frozen=True, eq=False)
class _Sums:
    """Sums over samples, by which every least-squares fit to them is known.

    Attributes:
        products: float64 (terms, terms), products of the columns.
        slopes: float64 (terms,), products of the columns with the target.
        squares: squares of the target.
        count: number of samples.
    """

    products: Array
    slopes: Array
    squares: float
    count: int

    def __add__(self, other: "_Sums") -> "_Sums":
        return _Sums(
            self.products + other.products, self.slopes + other.slopes,
            self.squares + other.squares, self.count + other.count,
        )  # fmt: skip

    def error(self, coefficients: Array) -> float:
        """Return the sum of the squares of what coefficients (terms,) leave."""
        fitted = coefficients @ self.products @ coefficients
        return float(self.squares - 2.0 * coefficients @ self.slopes + fitted)

    def solved(self, pysindy: Any, threshold: float, ridge: float) -> Array:
        """Return the coefficients (terms,) of a sequentially thresholded least-squares fit.

        The optimizer gets a square root of the sums in place of the samples: the least squares are
        the same, and it is quicker by as much as there are more samples than terms.
        """
        regular = self.products + _DEPENDENT * self.count * np.eye(len(self.slopes))
        root = np.linalg.cholesky(regular).T
        target = np.linalg.solve(root.T, self.slopes)
        optimizer = pysindy.STLSQ(threshold=threshold, alpha=ridge * self.count, max_iter=20)
        with warnings.catch_warnings():
            # It warns where no term is left, which is an answer.
            warnings.simplefilter("ignore")
            optimizer.fit(root, target[:, None])
        return np.asarray(optimizer.coef_)[0]


def sparse() -> Learner:
    """Return the learner.

    Raises:
        MissingPeerError: PySINDy is not installed.
    """
    pysindy = needed("pysindy")

    def fit(samples: Sequence[Samples], target: Target, last: bool) -> tuple[Learned | None, str]:
        return _fitted(pysindy, samples, target)

    return Learner("sparse regression", fit)


def _fitted(pysindy: Any, samples: Sequence[Samples], target: Target) -> tuple[Learned | None, str]:
    """Return the curve whose threshold and ridge predict samples best that it was not fitted to."""
    if len(samples) == 1:
        samples = parts_of(samples[0])
    library = Library(np.concatenate([each.quantities for each in samples]), target)
    scale = max(float(np.sqrt(np.mean(np.concatenate([s.values for s in samples]) ** 2))), 1e-300)
    sums = []
    for each in samples:
        columns, values = library(each.quantities), each.values / scale
        sums.append(
            _Sums(columns.T @ columns, columns.T @ values, float(values @ values), len(values))
        )
    tried = []
    for threshold, ridge in product(THRESHOLDS, RIDGES):
        error, terms = 0.0, 0
        for left, others in left_out(sums):
            coefficients = _total(others).solved(pysindy, threshold, ridge)
            error += left.error(coefficients)
            terms += int(np.count_nonzero(coefficients))
        tried.append((error, terms, threshold, ridge))
    best, nothing = min(tried)[0], sum(each.squares for each in sums)
    if not best < nothing:
        return None, ""
    good = [each for each in tried if each[0] <= best + SIMPLER * (nothing - best)]
    _, _, threshold, ridge = min(good, key=lambda each: (each[1], each[0]))
    coefficients = _total(sums).solved(pysindy, threshold, ridge)
    if not coefficients.any():
        return None, ""
    order = np.argsort(-np.abs(coefficients))
    terms_text = [f"{coefficients[k]:+.3g} {library.names[k]}" for k in order if coefficients[k]]
    text = f"{scale:.3g} {target.equation.unit} ({' '.join(terms_text)})"
    return lambda quantities: scale * (library(quantities) @ coefficients), text


def _total(sums: Sequence[_Sums]) -> _Sums:
    whole = sums[0]
    for each in sums[1:]:
        whole = whole + each
    return whole
