"""The joint fit of one friction curve to all measurements of the experiment of section 3.1.

Fast strokes that slow down show the whole curve except stiction, which they only extrapolate
(`estimator.friction.curve`). Break-aways show stiction itself. Strokes at constant speed show the
level at speeds at which friction does not fall with velocity. Each measurement has a covariance;
the parameters that fit all of them best follow by weighted least squares (Gauss and Newton).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import exp, expm1, hypot, isfinite, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import Parameters, quantities

from .break_away import presliding_creep
from .curve import FrictionCurve, FrictionEstimate, slip_curve
from .fit import PARAMETERS
from .steady_strokes import SteadySpeed
from .stiction import StictionLevel

Array = NDArray[np.float64]
_Residual = Callable[[Array], Array]

DEFICIT_KNOWN_TO: Final = 0.5
"""Relative standard deviation of the deficit, by which break-aways are below stiction. It varies
with the root of the bristles' stiffness, which nobody measures."""
LARGEST_FALL: Final = 0.5
"""Greatest slope of the falling Stribeck part, as a part of the rising viscous slope, at which a
stroke at constant speed is used.

On a rig drawn at random the two slopes balanced at 0.17 m/s, and strokes that looked steady there
were 8 N off."""
DISAGREEMENT: Final = 4.0
"""Number of standard errors between extrapolated and measured stiction from which the friction law
is doubted. In 40 rigs that obey the law it was 3.4 at most (docs/friction.md)."""
_ROUNDS: Final = 20


@dataclass(frozen=True)
class JointFit:
    """The friction law that fits all measurements.

    Attributes:
        estimates: the estimate of each of `fit.PARAMETERS`, by its name; all are identified.
        covariance: covariance of the estimates in the order of `fit.PARAMETERS`, (5, 5); a `misfit`
            above 1 has been multiplied into it, and thus into the estimates' errors.
        measured_stiction: stiction by the break-aways alone, with the deficit added, N; NaN if
            there were too few of them for a level (`stiction.NO_LEVEL`).
        measured_error: standard error of `measured_stiction`, N; infinite without a level.
        deficit: force by which the break-aways are below stiction, N; NaN without a level.
        disagreement: measured stiction less the one that sliding extrapolates, divided by the
            standard error of this difference; NaN without a level.
        misfit: chi^2 of the fit over its degrees of freedom.
    """

    estimates: Mapping[str, FrictionEstimate]
    covariance: Array
    measured_stiction: float
    measured_error: float
    deficit: float
    disagreement: float
    misfit: float

    @property
    def values(self) -> tuple[float, ...]:
        """Return the parameters in the order of `PARAMETERS`, SI."""
        return tuple(self.estimates[name].value or 0.0 for name in PARAMETERS)

    def parameters(self, parameters: Parameters) -> Parameters:
        """Return a rig's parameters with those of friction replaced by the fitted values."""
        return parameters._replace(**dict(zip(PARAMETERS, self.values, strict=True)))

    def force(self, velocity: Array) -> Array:
        """Return friction in N at velocities (m/s) other than zero, (n,)."""
        return slip_curve(velocity, self.values)

    def force_error(self, velocity: Array) -> Array:
        """Return the standard error in N of `force` at velocities (m/s) other than zero, (n,)."""
        steps = 1e-4 * np.sqrt(np.diag(self.covariance))
        moved, here = np.array(self.values) + np.diag(steps), self.force(velocity)
        jacobian = np.column_stack([slip_curve(velocity, each) - here for each in moved]) / steps
        return np.asarray(np.sqrt(np.einsum("ij,jk,ik->i", jacobian, self.covariance, jacobian)))


def joint_fit(
    sliding: FrictionCurve,
    level: StictionLevel,
    speeds: Sequence[SteadySpeed],
    parameters: Parameters,
    slope_V_per_s: float,  # noqa: N803
) -> JointFit | None:
    """Return the law that fits all measurements; None if sliding did not show all parameters.

    Args:
        sliding: the curve identified from fast strokes that slow down.
        level: stiction by the break-aways; with `NO_LEVEL` (too few) the fit does without.
        speeds: strokes at constant speed; those that `steady_among` leaves out do not count.
        parameters: assumed parameters of the rig, of which valve, supply and bristles are used.
        slope_V_per_s: slope of the command in the break-aways' ramps, V/s.
    """
    if not all(estimate.identified for estimate in sliding.estimates.values()):
        return None
    prior = sliding.fit.values
    root = np.linalg.cholesky(np.linalg.inv(_well_scaled(sliding.fit.covariance))).T
    settled = steady_among(speeds, sliding)
    velocity = np.array([each.velocity for each in settled])
    force = np.array([each.force for each in settled])
    errors = np.array([each.standard_error for each in settled])
    scale = np.sqrt(np.diag(sliding.fit.covariance))
    measured = isfinite(level.level)

    def deficit_of(values: Array) -> float:
        """Return by how many N stiction is above the friction of the ram as it creeps in a ramp.

        `values` (5,) are the parameters in the order of `PARAMETERS`.
        """
        found = parameters._replace(**dict(zip(PARAMETERS, values.tolist(), strict=True)))
        creep = max(level.creep, presliding_creep(found, slope_V_per_s))
        fallen = (values[1] - values[0]) * -expm1(-creep / values[2])
        return float(fallen - values[3] * creep)

    def residual(values: Array) -> Array:
        parts = [root @ ((values - prior) / scale)]
        if settled:
            parts.append((slip_curve(velocity, values) - force) / errors)
        if measured:
            shown = values[1] - deficit_of(values)
            wrong = hypot(level.level_error, DEFICIT_KNOWN_TO * deficit_of(values))
            parts.append(np.array([(shown - level.level) / wrong]))
            parts.append(np.array([(values[4] - level.offset) / level.offset_error]))
        return np.concatenate(parts)

    values = prior.copy()
    for _ in range(_ROUNDS):
        jacobian = _jacobian(residual, values, scale)
        step = np.linalg.lstsq(jacobian, -residual(values), rcond=None)[0]
        values = values + scale * step
        if np.abs(step).max() < 1e-6:
            break
    last = residual(values)
    misfit = float(last @ last) / max(last.size - values.size, 1)
    jacobian = _jacobian(residual, values, scale)
    covariance = np.linalg.inv(jacobian.T @ jacobian) * np.outer(scale, scale)
    covariance *= max(1.0, misfit)
    deficit = deficit_of(values)
    stiction = level.level + deficit
    wrong = hypot(level.level_error, DEFICIT_KNOWN_TO * deficit)
    return JointFit(
        {
            name: FrictionEstimate(float(value), sqrt(variance), quantities()[name].unit)
            for name, value, variance in zip(PARAMETERS, values, np.diag(covariance), strict=True)
        },
        covariance,
        float(stiction),
        wrong,
        deficit,
        float((stiction - prior[1]) / hypot(wrong, scale[1])),
        misfit,
    )


def steady_among(speeds: Sequence[SteadySpeed], sliding: FrictionCurve) -> list[SteadySpeed]:
    """Return the settled strokes at speeds at which friction clearly rises with velocity.

    Where friction falls or is level, the ram may oscillate faster than the transducers show. The
    mean force is then not the friction at the mean speed.
    """
    coulomb, stiction, alpha, viscous, _ = sliding.fit.values
    return [
        each
        for each in speeds
        if each.settled
        and LARGEST_FALL * viscous > (stiction - coulomb) / alpha * exp(-abs(each.velocity) / alpha)
    ]


def _well_scaled(covariance: Array) -> Array:
    scale = np.sqrt(np.diag(covariance))
    # Jackknifed covariances may be singular to rounding.
    return np.asarray(covariance / np.outer(scale, scale) + 1e-6 * np.eye(scale.size))


def _jacobian(residual: _Residual, values: Array, scale: Array) -> Array:
    """Return the derivatives of the residuals by values / scale, by finite differences.

    The result is float64 (residuals, values).
    """
    moved, here = values + np.diag(1e-3 * scale), residual(values)
    return np.column_stack([residual(each) - here for each in moved]) / 1e-3
