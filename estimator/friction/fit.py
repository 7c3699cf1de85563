"""The fit of the Stribeck curve to friction at many velocities, by robust separable least squares.

F = sgn(v) (f_sl + (f_st - f_sl) exp(-|v|/alpha) + d |v|) + F_as (eq. 2.8, section 3.2.1), plus the
inertia of a mass that the filter's model lacks. For a given alpha all other parameters are linear,
so that only alpha is searched (variable projection, Golub and Pereyra 1973).
"""

from dataclasses import dataclass
from math import inf, nan, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.accounts import student_quantile

from .samples import FrictionSamples

Array = NDArray[np.float64]

PARAMETERS: Final = ("coulomb", "stiction", "stribeck_velocity", "viscous", "friction_asymmetry")
"""Fields of `Parameters` that are fitted, with units N, N, m/s, N s/m and N."""
LEAST_STROKES: Final = 6
"""Fewest strokes for a fit; the standard errors rest on the differences between strokes."""
LEAST_SAMPLES: Final = 30
_GRID: Final = 48
_GROUPS: Final = 40
"""Greatest number of groups of speeds, each with its own scatter."""
_ROUNDS: Final = 6
_HUBER: Final = 2.0
"""Residuals beyond this many standard deviations count linearly (Huber 1964)."""
LAG_KNOWN_TO: Final = 0.2
"""Relative standard deviation of the correction for lags. The lags of filter and bristles follow
from the model's stiffness of the oil (known to 15 %) and of the bristles."""
_GOLDEN: Final = 0.5 * (sqrt(5.0) - 1.0)


@dataclass(frozen=True)
class StribeckFit:
    """A fitted friction curve.

    Attributes:
        values: the parameters in the order of `PARAMETERS`, float64 (5,), SI; NaN if not fitted
            (the asymmetry alone with strokes in one direction only, or all: `NO_FIT`).
        covariance: covariance of the values, (5, 5); variances are infinite if not fitted.
        spread: robust standard deviation of a sample's residual, N.
        alpha_bounded: whether the search for alpha ended at a bound of its range.
    """

    values: Array
    covariance: Array
    spread: float
    alpha_bounded: bool


NO_FIT: Final = StribeckFit(np.full(5, nan), np.full((5, 5), inf), nan, True)


def fit_stribeck(samples: FrictionSamples) -> StribeckFit:
    """Return the curve fitted to samples; `NO_FIT` with too few samples or strokes.

    Residuals may be alike within a stroke. They may also be alike at one velocity in all strokes,
    as a periodic motion repeats the encoder's rounding, and as the rig may have another curve. The
    covariance therefore treats strokes, and groups of velocities, as the independent units (two-way
    clusters: Cameron, Gelbach and Miller 2011), each by the linearised jackknife, widened by
    Student's t. The uncertainty of the lags is added. With strokes in one direction only, the
    asymmetry is not fitted.
    """
    strokes = np.unique(samples.stroke)
    if samples.velocity.size < LEAST_SAMPLES or strokes.size < LEAST_STROKES:
        return NO_FIT
    problem = _Problem(samples)
    slowest, fastest = np.quantile(np.abs(samples.velocity), [0.02, 1.0])
    grid = np.geomspace(0.25 * slowest, fastest, _GRID)
    weights = np.ones_like(samples.force)
    losses = [problem.solve(alpha, weights).loss for alpha in grid]
    best = int(np.argmin(losses))
    step = float(grid[1] / grid[0])
    alpha = float(grid[best])
    spread = np.ones_like(weights)
    for _ in range(_ROUNDS):
        alpha = problem.search(alpha / step, alpha * step, weights)
        residual = problem.solve(alpha, weights).residual
        spread = _spread(np.abs(samples.velocity), residual)
        weights = np.minimum(1.0, _HUBER * spread / np.maximum(np.abs(residual), 1e-9)) / spread**2
    solved = problem.solve(alpha, weights)
    inlying = (np.abs(solved.residual) < _HUBER * spread) / spread**2
    jacobian = problem.jacobian(alpha, solved.linear)
    covariance = _covariance(jacobian, weights * solved.residual, inlying, samples)
    linear = solved.linear
    asymmetry = linear[3] if problem.both_ways else nan
    values = np.array([linear[0], linear[1], alpha, linear[2], asymmetry])
    kept = np.array([0, 1, 5 if problem.both_ways else 4, 2, 3])
    reduced = covariance[np.ix_(kept, kept)]
    if not problem.both_ways:
        reduced[4, :] = reduced[:, 4] = 0.0
        reduced[4, 4] = inf
    bounded = not grid[0] * step < alpha < grid[-1] / step
    return StribeckFit(values, reduced, float(np.median(spread)), bounded)


class _Solution(NamedTuple):
    linear: Array
    residual: Array
    loss: float


class _Problem:
    """The weighted least squares problem of some samples, which is linear for a given alpha."""

    def __init__(self, samples: FrictionSamples) -> None:
        self._speed = np.abs(samples.velocity)
        self._sign = np.sign(samples.velocity)
        self._samples = samples
        self.both_ways = bool(np.any(self._sign > 0.0) and np.any(self._sign < 0.0))

    def solve(self, alpha: float, weights: Array) -> _Solution:
        """Return the fit for a given alpha: linear parameters, residuals (n,) in N, and loss.

        The parameters are f_sl, f_st, d, F_as if there are strokes both ways, and the mass. The
        loss is the weighted sum of squared residuals.
        """
        design = self._design(alpha)
        root = np.sqrt(weights)
        weighted = self._samples.force * root
        linear = np.asarray(np.linalg.lstsq(design * root[:, None], weighted, rcond=None)[0])
        residual = self._samples.force - design @ linear
        return _Solution(linear, residual, float(weights @ residual**2))

    def search(self, lower: float, upper: float, weights: Array) -> float:
        """Return the best alpha in m/s between two bounds, by golden section of its logarithm."""
        a, b = np.log(lower), np.log(upper)
        c, d = b - _GOLDEN * (b - a), a + _GOLDEN * (b - a)
        loss_c, loss_d = (self.solve(float(np.exp(x)), weights).loss for x in (c, d))
        while b - a > 1e-4:
            if loss_c < loss_d:
                b, d, loss_d = d, c, loss_c
                c = b - _GOLDEN * (b - a)
                loss_c = self.solve(float(np.exp(c)), weights).loss
            else:
                a, c, loss_c = c, d, loss_d
                d = a + _GOLDEN * (b - a)
                loss_d = self.solve(float(np.exp(d)), weights).loss
        return float(np.exp(0.5 * (a + b)))

    def jacobian(self, alpha: float, linear: Array) -> Array:
        """Return the derivatives of the force by the linear parameters and alpha: (n, 5 or 6)."""
        decay = np.exp(-self._speed / alpha)
        by_alpha = self._sign * (linear[1] - linear[0]) * decay * self._speed / alpha**2
        return np.column_stack([self._design(alpha), by_alpha])

    def _design(self, alpha: float) -> Array:
        decay = np.exp(-self._speed / alpha)
        columns = [self._sign * (1.0 - decay), self._sign * decay, self._samples.velocity]
        if self.both_ways:
            columns.append(np.ones_like(decay))
        return np.column_stack([*columns, self._samples.acceleration])


def _spread(speed: Array, residual: Array) -> Array:
    """Return the robust standard deviation of the residuals at each sample's speed, (n,) in N.

    It depends on the speed, as on the steep part of the curve an error of the velocity makes one of
    the force.
    """
    spread = np.empty_like(residual)
    order = np.argsort(speed)
    groups = max(1, min(_GROUPS, speed.size // LEAST_SAMPLES))
    for group in np.array_split(order, groups):
        spread[group] = 1.4826 * np.median(np.abs(residual[group]))
    return np.maximum(spread, 1e-6 * np.abs(residual).max() + 1e-9)


def _covariance(
    jacobian: Array, weighted_residual: Array, weights: Array, samples: FrictionSamples
) -> Array:
    """Return the covariance of the linear parameters and alpha, in the order of the Jacobian.

    Args:
        jacobian: derivatives of the force, (n, parameters).
        weighted_residual: residuals times their weights, (n,).
        weights: weights of the samples, (n,); 0 for outliers, which no longer influence the fit.
        samples: the samples.
    """
    scale = np.linalg.norm(jacobian, axis=0)
    scaled = jacobian / np.where(scale > 0.0, scale, 1.0)
    bread = np.linalg.pinv((scaled.T * weights) @ scaled)
    by_stroke = _jackknife(scaled, weighted_residual, weights, samples.stroke)
    by_velocity = _jackknife(scaled, weighted_residual, weights, _speeds(samples.velocity))
    alone = (scaled @ bread) * weighted_residual[:, None]
    # Covariance that samples of one velocity share, in addition to their own noise.
    values, vectors = np.linalg.eigh(by_velocity - alone.T @ alone)
    shared = (vectors * np.maximum(values, 0.0)) @ vectors.T
    misplaced = bread @ (scaled.T @ (weights * LAG_KNOWN_TO * samples.lag_correction))
    covariance = by_stroke + shared + np.outer(misplaced, misplaced)
    return np.asarray(covariance / np.outer(scale, scale))


def _speeds(velocity: Array) -> NDArray[np.int64]:
    """Return for each sample the number of its group of neighbouring velocities, (n,)."""
    groups = np.empty(velocity.size, dtype=np.int64)
    for index, group in enumerate(np.array_split(np.argsort(velocity), 2 * _GROUPS)):
        groups[group] = index
    return groups


def _jackknife(
    jacobian: Array, weighted_residual: Array, weights: Array, groups: NDArray[np.int64]
) -> Array:
    """Return the covariance of the parameters by the jackknife: each group is left out in turn."""
    information = (jacobian.T * weights) @ jacobian
    names = np.unique(groups)
    changes = []
    for name in names:
        own = groups == name
        part = jacobian[own]
        without = np.linalg.pinv(information - (part.T * weights[own]) @ part)
        changes.append(without @ (part.T @ weighted_residual[own]))
    freedom = names.size - 1.0
    widening = student_quantile(0.025, freedom) / 1.96
    change = np.array(changes)
    return np.asarray(freedom / names.size * widening**2 * change.T @ change)
