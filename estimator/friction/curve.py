"""Friction against velocity: the curve that a motion shows, and its change from run to run.

This is the thesis's offline friction estimator (section 7.1.1, figure 7.26), extended so that wear
can be followed over months: each parameter has a standard error or, if the motion did not show it,
the description of a motion that would.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import hypot, isfinite
from statistics import NormalDist
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.leaks import filter_recording, samples_of
from rig.plant import DATA_SHEET, Model, Parameters, SensorParameters, quantities
from rig.recording import Recording

from .fit import NO_FIT, PARAMETERS, StribeckFit, fit_stribeck
from .samples import (
    BlockCollector,
    FrictionSamples,
    LoadLag,
    MotionBlocks,
    Spring,
    friction_samples,
    load_lag,
)

Array = NDArray[np.float64]

BINS: Final = 12
"""Number of velocity bins in each direction, evenly spaced in the logarithm of the speed."""
LEAST_PRECISION: Final = 0.25
"""Largest standard error of an identified parameter, as a part of its value.

For the viscous part it is the error of the force at the highest speed seen, as a part of the slip
friction. A 95 % interval then spans a factor of 3."""
LARGEST_SCATTER: Final = 0.1
"""Scatter of the force at one velocity, as a part of the force, above which the force is not
friction alone. Quasi-steady friction scatters by less than 1 % on simulated rigs
(docs/friction.md)."""
CHANGE_PROBABILITY: Final = 0.01
"""Probability that two runs of unchanged friction are said to differ in any parameter."""

_GOOD_MOTION: Final = "20 s or more of a sine of 0.5 Hz and 0.2 m, as in the campaign friction_3_1"
_RIGHT_WAY_ROUND: Final = (
    "transducers the right way round: what they show drives the ram instead of braking it, as "
    "where pressure_1_Pa and pressure_2_Pa are swapped, or position_m counts the wrong way"
)


@dataclass(frozen=True)
class FrictionBin:
    """Friction within a range of velocities of one direction.

    Attributes:
        velocity: median velocity, m/s, positive when extending.
        force: median friction, N.
        spread: robust standard deviation of the force, N.
        count: number of blocks of 10 ms.
    """

    velocity: float
    force: float
    spread: float
    count: int


@dataclass(frozen=True)
class FrictionEstimate:
    """One estimated parameter of the friction curve, SI.

    Attributes:
        value, standard_error: the estimate and its standard error; None if not identified.
        unit: the SI unit of both.
        needs: words on what the recording would need to show the parameter; empty if identified.
    """

    value: float | None
    standard_error: float | None
    unit: str
    needs: str = ""

    @property
    def identified(self) -> bool:
        """Return whether the motion has shown the parameter."""
        return self.value is not None


@dataclass(frozen=True)
class FrictionCurve:
    """What one recording shows of friction.

    Attributes:
        estimates: the estimate of each of `fit.PARAMETERS`, by its name.
        bins: the bins in the order of velocity, retracting first; empty bins are left out.
        fit: the fit behind the estimates; it also has values that are not identified.
        slowest, fastest: least and greatest speed of quasi-steady sliding, m/s; None without any.
        strokes: number of strokes with quasi-steady sliding.
        spring: the spring whose force was taken off the load.
        lag_s: lag of the filter's load state, s.
    """

    estimates: Mapping[str, FrictionEstimate]
    bins: tuple[FrictionBin, ...]
    fit: StribeckFit
    slowest: float | None
    fastest: float | None
    strokes: int
    spring: Spring
    lag_s: float

    @property
    def drawable(self) -> bool:
        """Return whether there is a curve between `slowest` and `fastest` to draw.

        That is so if at least one parameter is identified.
        """
        return any(estimate.identified for estimate in self.estimates.values())

    def force(self, velocity: Array) -> Array:
        """Return the fitted friction in N at velocities (m/s) other than zero, same shape.

        An asymmetry that was not fitted counts as 0. Without a fit (`NO_FIT`) all is NaN.
        """
        *others, asymmetry = self.fit.values
        return slip_curve(velocity, [*others, asymmetry if isfinite(asymmetry) else 0.0])


def slip_curve(velocity: Array, values: Iterable[float]) -> Array:
    """Return friction in N at velocities in m/s for parameters in the order of `PARAMETERS`.

    At velocity 0, where friction is undetermined, it is the asymmetry alone.
    """
    coulomb, stiction, alpha, viscous, asymmetry = values
    level = coulomb + (stiction - coulomb) * np.exp(-np.abs(velocity) / alpha)
    return np.asarray(np.sign(velocity) * level + viscous * velocity + asymmetry)


def model_curve(velocity: Array, parameters: Parameters) -> Array:
    """Return the friction in N that a model's parameters give at velocities in m/s."""
    return slip_curve(velocity, (getattr(parameters, name) for name in PARAMETERS))


def identify_friction(
    blocks: MotionBlocks, lag: LoadLag, spring: Spring, parameters: Parameters
) -> FrictionCurve:
    """Return the friction curve that the blocks of a recording show.

    Args:
        blocks: blocks of the recording (`samples.BlockCollector`).
        lag: lag of the filter (`samples.load_lag`).
        spring: the spring that the ram runs against.
        parameters: parameters of the rig that the filter assumed.
    """
    samples = friction_samples(blocks, lag, spring, parameters)
    fit = fit_stribeck(samples)
    speed = np.abs(samples.velocity)
    return FrictionCurve(
        dict(_estimates(samples, fit)),
        tuple(_bins(samples)),
        fit,
        float(speed.min()) if speed.size else None,
        float(speed.max()) if speed.size else None,
        int(np.unique(samples.stroke).size),
        spring,
        lag.load_s,
    )


def identify_recording(
    recording: Recording,
    model: Model,
    spring: Spring,
    sensors: SensorParameters = DATA_SHEET,
) -> FrictionCurve:
    """Run the product filter over a recording and return the friction curve that it shows.

    Args:
        recording: the recording, with command, position and both pressures.
        model: model of the rig that the filter assumes.
        spring: the spring that the ram runs against.
        sensors: data sheet of the transducers.
    """
    collector = BlockCollector(model.parameters)
    run = filter_recording(recording, model, sensors=sensors)
    collector.take(samples_of(recording), run)
    lag = load_lag(model, sensors)
    return identify_friction(collector.blocks, lag, spring, model.parameters)


def _estimates(
    samples: FrictionSamples, fit: StribeckFit
) -> Iterator[tuple[str, FrictionEstimate]]:
    errors = np.sqrt(np.diag(fit.covariance))
    wanting = _wanting(samples, fit)
    for name, value, error in zip(PARAMETERS, fit.values, errors, strict=True):
        unit = quantities()[name].unit
        if needs := wanting.get(name, ""):
            yield name, FrictionEstimate(None, None, unit, needs)
        else:
            yield name, FrictionEstimate(float(value), float(error), unit)


def _wanting(samples: FrictionSamples, fit: StribeckFit) -> dict[str, str]:
    """Return, by its name, for each parameter that is not identified, words on what would show it.

    The result is empty if all parameters are identified.
    """
    if fit is NO_FIT:
        return dict.fromkeys(PARAMETERS, f"more steady sliding: {_GOOD_MOTION}")
    speed, level = np.abs(samples.velocity), float(np.median(np.abs(samples.force)))
    if fit.spread > LARGEST_SCATTER * level:
        scatter = f"the force scatters by {fit.spread:.0f} N at one velocity"
        return dict.fromkeys(PARAMETERS, f"the load that was there ({scatter}): --spring")
    if np.median(np.sign(samples.velocity) * samples.force) < 0.0:
        return dict.fromkeys(PARAMETERS, _RIGHT_WAY_ROUND)
    coulomb, stiction, alpha, _, _ = fit.values
    errors = np.sqrt(np.diag(fit.covariance))
    fastest = float(speed.max())
    wanting = {}
    slow = f"steady sliding slower than the {1e3 * speed.min():.0f} mm/s seen: {_GOOD_MOTION}"
    falling = stiction - coulomb
    if fit.alpha_bounded or not errors[2] <= LEAST_PRECISION * alpha:
        wanting["stribeck_velocity"] = slow
    if fit.alpha_bounded or not errors[1] <= LEAST_PRECISION * abs(falling):
        wanting["stiction"] = slow
    if not errors[0] <= LEAST_PRECISION * abs(coulomb):
        wanting["coulomb"] = f"steady sliding over more speeds: {_GOOD_MOTION}"
    if not errors[3] * fastest <= LEAST_PRECISION * abs(coulomb) or fit.alpha_bounded:
        wanting["viscous"] = f"steady sliding faster than the {1e3 * fastest:.0f} mm/s seen"
    if not isfinite(errors[4]):
        wanting["friction_asymmetry"] = "steady sliding both ways"
    return wanting


def _bins(samples: FrictionSamples) -> Iterator[FrictionBin]:
    speed = np.abs(samples.velocity)
    if speed.size == 0:
        return
    edges = np.geomspace(speed.min(), speed.max(), BINS + 1)
    edges[-1] = np.inf
    place = np.searchsorted(edges, speed, "right")
    for direction, order in ((-1.0, range(BINS, 0, -1)), (1.0, range(1, BINS + 1))):
        for index in order:
            chosen = (place == index) & (np.sign(samples.velocity) == direction)
            if not chosen.any():
                continue
            force = samples.force[chosen]
            median = float(np.median(force))
            spread = 1.4826 * float(np.median(np.abs(force - median)))
            velocity = float(np.median(samples.velocity[chosen]))
            yield FrictionBin(velocity, median, spread, int(chosen.sum()))


@dataclass(frozen=True)
class FrictionChange:
    """The change of one friction parameter between two recordings.

    Attributes:
        name: name of the parameter in `fit.PARAMETERS`.
        difference: value in the last recording less that in the first, SI.
        score: difference divided by its standard error.
        significant: whether the change is too great for chance. If friction has not changed, one or
            more of the changes that are tested together are said to be so with a probability of
            `CHANGE_PROBABILITY`.
    """

    name: str
    difference: float
    score: float
    significant: bool


def friction_changes(first: FrictionCurve, last: FrictionCurve) -> tuple[FrictionChange, ...]:
    """Return the changes of the parameters identified in both recordings; () if there is none."""
    pairs = [
        (name, a.value, b.value, hypot(a.standard_error or 0.0, b.standard_error or 0.0))
        for name in PARAMETERS
        for a, b in [(first.estimates[name], last.estimates[name])]
        if a.value is not None and b.value is not None
    ]
    if not pairs:
        return ()
    limit = NormalDist().inv_cdf(1.0 - 0.5 * CHANGE_PROBABILITY / len(pairs))
    return tuple(
        FrictionChange(name, b - a, (b - a) / error, abs(b - a) > limit * error)
        for name, a, b, error in pairs
    )
