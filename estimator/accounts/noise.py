"""Noise of an account by the sensors and by errors of the model, and the dead zones of faults."""

from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import LITRE_PER_MINUTE

from .flow import AccountBlock
from .nuisances import NUISANCES, nuisance_index

Array = NDArray[np.float64]

MODEL_NOISE: Final = 0.01
"""Standard deviation in L/min of a block's missing flow that errors of the model are expected to
make."""
SENSOR_ERRORS: Final = {
    "spool_null_bias": 2.9e-8,
    "pressure_1_bias": 1.4e3,
    "pressure_2_bias": 1.4e3,
}
"""Standard deviations of block means by the sensors' noise, in m and Pa.

They follow from 1 um and 30 kPa a sample over 500 samples; the filter removes two fifths of the
spool's (docs/detection.md). Each enters both chambers' accounts like the nuisance of its name."""
OWN_NOISE: Final = 0.0006
"""Further noise of each chamber alone, L/min: pressures and position at the ends of a block are not
known exactly."""
DEAD_ZONE: Final = (0.01, 0.01, 0.015, 0.04, 0.04)
"""Flow in L/min that each of `FAULTS` must exceed to be claimed: the error of the model that may be
left after the nuisances.

0.1 um of metering edge is 0.01 L/min. Edges near null, where a ram that is held works, look most
like an internal leak. Supply and return pressures wander by more than leaks."""
_DEAD_ZONE: Final = np.array(DEAD_ZONE)
_LEAST_PART: Final = np.array([0.0, 0.0, 0.0, 0.25, 0.25])
"""Part of each fault's dead zone that stays even if the model is said to be exact. The accounts
follow supply and return linearly in their tolerances, which is not quite right."""
RELATIVE_DEAD_ZONE: Final = 0.05
"""Part of a leak's flow by which the leak law may be wrong. A second fault must exceed this part of
the first one's flow, and a fault that has fallen to this part of its size counts as ended."""
MOST_MODEL_ERROR: Final = 10.0
"""Greatest permitted value of `model_error`, the factor on what is allowed for model errors."""
SPOOL_KEPT: Final = 2.9e-8 / (1e-6 / 500**0.5)
"""Part of the spool transducer's noise (1 um a sample, 500 samples a block) that the filter leaves
in a block's mean opening; the rest of the mean comes from the command."""
SENSOR_PLACES: Final = [nuisance_index(name) for name in SENSOR_ERRORS]
"""Indices in `NUISANCES` of the sensors' errors, in the order of `SENSOR_ERRORS`."""
SENSOR_PARTS: Final = np.array(
    [
        error / NUISANCES[at].sigma
        for error, at in zip(SENSOR_ERRORS.values(), SENSOR_PLACES, strict=True)
    ]
)
"""These errors as parts of the tolerances of the nuisances."""


def checked_model_error(model_error: float) -> float:
    """Return `model_error` unchanged if it is a permitted factor.

    Raises:
        ValueError: it is not within 0 to `MOST_MODEL_ERROR`.
    """
    if not 0.0 <= model_error <= MOST_MODEL_ERROR:
        raise ValueError(
            f"model_error: {model_error} is outside 0 (the model is exact) to {MOST_MODEL_ERROR:g}"
        )
    return model_error


def sensor_noise(block: AccountBlock, spool_correction: float = 0.0) -> Array:
    """Return the covariance (2, 2) of a block's missing flows by sensor noise, in (m^3/s)^2.

    Args:
        block: the account.
        spool_correction: part of the spool's mean departure by which the opening was corrected
            (`spool_flow`). The opening then has that part of the noise, too, that the filter had
            removed.
    """
    parts = SENSOR_PARTS.copy()
    parts[0] *= 1.0 + spool_correction * (1.0 - SPOOL_KEPT) / SPOOL_KEPT
    errors = block.nuisances[:, SENSOR_PLACES] * parts
    own = (OWN_NOISE * LITRE_PER_MINUTE) ** 2
    return np.asarray(errors @ errors.T + own * np.eye(2))


def spool_flow(block: AccountBlock) -> Array:
    """Return what a block would miss if the spool were where its readings say: (2,), m^3/s.

    It is the missing flow of a valve whose opening is larger than estimated by the mean departure
    of the readings from the estimates, and 0 if the spool was not read. A lag of the readings or a
    null of the transducer departs too; both are among the nuisances.
    """
    departure = block.spool_departure
    if np.isnan(departure):
        return np.zeros(2)
    at = SENSOR_PLACES[0]
    return np.asarray(block.nuisances[:, at] * (departure / NUISANCES[at].sigma))


@lru_cache(maxsize=2)
def whitening(block: AccountBlock, model_error: float) -> Array:
    """Return the matrix that scales a block's expected noise to independent unit variances.

    A block with large `doubts` has more expected noise, so that it counts for less. The latest
    results are kept, as several tests take a block in turn; they must not be changed.

    Args:
        block: the account.
        model_error: factor on what is allowed for errors of the model.

    Returns:
        float64 (2, 2), s/m^3, to be multiplied from the left with missing flows and signatures.
    """
    model = np.full(2, model_error * MODEL_NOISE * LITRE_PER_MINUTE)
    model = np.hypot(model, model_error * block.doubts)
    return np.linalg.inv(np.linalg.cholesky(sensor_noise(block) + np.diag(model**2)))


def dead_zones(model_error: float) -> Array:
    """Return the flow in L/min that each fault must exceed to be claimed, float64 (5,).

    Args:
        model_error: factor on what is allowed for errors of the model.
    """
    return np.asarray(np.maximum(model_error, _LEAST_PART) * _DEAD_ZONE)
