"""Gaussian process on the disturbances (Kennedy and O'Hagan 2001), by scikit-learn."""

import warnings
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from estimator.gap.plant import Array
from tools.peers.discrepancy import Learned, Learner, Samples, Target
from tools.peers.folds import left_out, parts_of
from tools.peers.optional import needed

SMOOTH: Final = "squared exponential"
ROUGH: Final = "Matern 3/2"
TRIED: Final = 250
"""Samples to which a process is fitted where it is tried."""
FITTED: Final = 600
"""Samples to which the best kernel is fitted in the end. The cost goes with the cube of it."""
_ROWS: Final = 4000
"""Rows that are predicted at once, for the sake of memory."""


def gaussian(seed: int = 1) -> Learner:
    """Return the learner, which draws its samples with a seed.

    Raises:
        MissingPeerError: scikit-learn is not installed.
    """
    process = needed("sklearn.gaussian_process", "scikit-learn")
    kernels = needed("sklearn.gaussian_process.kernels", "scikit-learn")

    def fit(samples: Sequence[Samples], target: Target, last: bool) -> tuple[Learned | None, str]:
        rng = np.random.default_rng(seed)
        if last:
            return _fitted(process, kernels, samples, (SMOOTH, ROUGH), FITTED, rng)
        return _fitted(process, kernels, samples, (ROUGH,), TRIED, rng)

    return Learner("Gaussian process", fit)


def _fitted(
    process: Any, kernels: Any, samples: Sequence[Samples], shapes: Sequence[str], count: int,
    rng: np.random.Generator,
) -> tuple[Learned | None, str]:  # fmt: skip
    """Return a process fitted to `count` samples, with that of the kernels that predicts best.

    Of several kernels, the best predicts samples best that it was not fitted to. With a single one
    nothing is tried.
    """
    if len(samples) == 1:
        samples = parts_of(samples[0])
    together = np.concatenate([each.quantities for each in samples])
    middle, spread = together.mean(0), together.std(0)
    varies = np.flatnonzero(spread > 1e-9 * np.abs(together).max(0))
    values = np.concatenate([each.values for each in samples])
    scale = max(float(np.sqrt(np.mean(values**2))), 1e-300)
    if not len(varies):
        return None, ""

    def scaled(quantities: Array) -> Array:
        return np.asarray(((quantities - middle) / np.maximum(spread, 1e-300))[:, varies])

    lengths, bounds = np.ones(len(varies)), (0.05, 1e3)
    kernel_of = {
        SMOOTH: kernels.RBF(lengths, bounds),
        ROUGH: kernels.Matern(lengths, bounds, nu=1.5),
    }

    def made(shape: str, of: Sequence[Samples], count: int) -> Any:
        rows = scaled(np.concatenate([each.quantities for each in of]))
        targets = np.concatenate([each.values for each in of]) / scale
        chosen = rng.permutation(len(rows))[:count]
        kernel = kernels.ConstantKernel(0.5, (1e-4, 1e3)) * kernel_of[shape]
        kernel = kernel + kernels.WhiteKernel(0.5, (1e-5, 1e1))
        regressor = process.GaussianProcessRegressor(kernel, random_state=0)
        with warnings.catch_warnings():
            # A length at its bound says that a quantity does not matter.
            warnings.simplefilter("ignore")
            return regressor.fit(rows[chosen], targets[chosen])

    def cost(shape: str) -> float:
        return sum(
            float(
                np.sum(
                    (one.values / scale - _mean(made(shape, others, TRIED), scaled(one.quantities)))
                    ** 2
                )
            )
            for one, others in left_out(samples)
        )

    best = shapes[0]
    if len(shapes) > 1:
        costs = {shape: cost(shape) for shape in shapes}
        best = min(costs, key=lambda shape: costs[shape])
        if not costs[best] < float(np.sum((values / scale) ** 2)):
            return None, ""
    model = made(best, samples, count)
    return lambda quantities: scale * _mean(model, scaled(quantities)), f"{best}: {model.kernel_}"


def _mean(model: Any, rows: Array) -> Array:
    parts = [model.predict(rows[k : k + _ROWS]) for k in range(0, len(rows), _ROWS)]
    return np.concatenate(parts) if parts else np.zeros(0)
