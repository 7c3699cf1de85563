"""One friction curve through all that the experiment of section 3.1 shows.

Slowing down from fast strokes shows the whole curve but stiction, which it extrapolates
(`estimator.friction.curve`); break-aways show stiction itself, and strokes at constant speed the
level where friction does not fall with velocity. Each is a measurement with its own covariance; the
parameters that fit all of them best follow by weighted least squares (Gauss and Newton).
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
"""Share of what makes up for pre-sliding that may be wrong: one standard deviation. It goes with
the root of the bristles' stiffness, which nobody measures."""
LARGEST_FALL: Final = 0.5
"""Greatest fall of Stribeck's part with speed, as a share of the viscous part's rise, at which a
stroke is used. Where they balanced, at 0.17 m/s on a drawn rig, strokes that looked steady were
8 N off."""
DISAGREEMENT: Final = 4.0
"""Standard errors between extrapolated and measured stiction, from which the law is doubted. Rigs
that obey the law came to 3.4 at most, in 40 (docs/friction.md)."""
_ROUNDS: Final = 20


@dataclass(frozen=True)
class JointFit:
    """The fitted friction law.

    Attributes:
        estimates: by name, those of `fit.PARAMETERS`.
        covariance: (5, 5), in that order.
        measured_stiction, measured_error: of the break-aways alone, pre-sliding made up for, N.
        deficit: what was made up for, N.
        disagreement: measured less extrapolated stiction, over its standard error.
        misfit: chi^2 over its degrees of freedom; beyond 1 the covariance was widened by it.
    """

    estimates: Mapping[str, FrictionEstimate]
    covariance: Array
    measured_stiction: float
    measured_error: float
    deficit: float
    disagreement: float
    misfit: float

    @property
    def values(self) -> tuple[float, float, float, float, float]:
        """The parameters in the order of `PARAMETERS`, SI."""
        coulomb, stiction, alpha, viscous, asymmetry = (
            self.estimates[name].value or 0.0 for name in PARAMETERS
        )
        return coulomb, stiction, alpha, viscous, asymmetry

    def parameters(self, parameters: Parameters) -> Parameters:
        """Return a rig's parameters with the friction that was found."""
        return parameters._replace(**dict(zip(PARAMETERS, self.values, strict=True)))

    def force(self, velocity: Array) -> Array:
        """Return friction in N at velocities (m/s) other than zero, (n,)."""
        return slip_curve(velocity, self.values)

    def force_error(self, velocity: Array) -> Array:
        """Return the standard error of that, N, (n,)."""
        steps = 1e-4 * np.sqrt(np.diag(self.covariance))
        values = np.array(self.values)
        columns = []
        for index, step in enumerate(steps):
            moved = values.copy()
            moved[index] += step
            columns.append((slip_curve(velocity, _five(moved)) - self.force(velocity)) / step)
        jacobian = np.column_stack(columns)
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
        sliding: identified from fast strokes that slow down.
        level: of the break-aways.
        speeds: strokes at constant speed; those that `steady_among` leaves out do not count.
        parameters: of the valve and the bristles, as far as known.
        slope_V_per_s: of the break-aways' ramps.
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
        """Return by how much stiction is above the friction of the creeping ram, N."""
        found = parameters._replace(**dict(zip(PARAMETERS, values.tolist(), strict=True)))
        creep = max(level.creep, presliding_creep(found, slope_V_per_s))
        fallen = (values[1] - values[0]) * -expm1(-creep / values[2])
        return float(fallen - values[3] * creep)

    def residual(values: Array) -> Array:
        parts = [root @ ((values - prior) / scale)]
        if settled:
            parts.append((slip_curve(velocity, _five(values)) - force) / errors)
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
    """Return the strokes that settled, at speeds at which friction clearly rises with velocity.

    Where it falls or is level, the ram may tremble faster than the transducers show, and the mean
    force of that is no friction at the mean speed.
    """
    coulomb, stiction, alpha, viscous, _ = sliding.fit.values
    return [
        each
        for each in speeds
        if each.settled
        and LARGEST_FALL * viscous > (stiction - coulomb) / alpha * exp(-abs(each.velocity) / alpha)
    ]


def _five(values: Array) -> tuple[float, float, float, float, float]:
    coulomb, stiction, alpha, viscous, asymmetry = values.tolist()
    return coulomb, stiction, alpha, viscous, asymmetry


def _well_scaled(covariance: Array) -> Array:
    scale = np.sqrt(np.diag(covariance))
    # Jackknifed covariances may be singular to rounding.
    return np.asarray(covariance / np.outer(scale, scale) + 1e-6 * np.eye(scale.size))


def _jacobian(residual: _Residual, values: Array, scale: Array) -> Array:
    """Return derivatives of the residuals by the values in units of `scale`, by differences."""
    here = residual(values)
    columns = []
    for index, unit in enumerate(scale):
        moved = values.copy()
        moved[index] += 1e-3 * unit
        columns.append((residual(moved) - here) / 1e-3)
    return np.column_stack(columns)
