"""What the sensors' noise and the model's errors make of an account: its noise, and a dead zone."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import LITRE_PER_MINUTE

from .flow import AccountBlock
from .nuisances import NUISANCES, nuisance_index

Array = NDArray[np.float64]

NOISE: Final = 0.01
"""Expected noise of one block's missing flow by errors of the model, L/min."""
SENSOR_ERRORS: Final = {
    "spool_null_bias": 2.9e-8,
    "pressure_1_bias": 1.4e3,
    "pressure_2_bias": 1.4e3,
}
"""What sensors' noise makes of the means over a block, one standard deviation, m and Pa: 1 um and
30 kPa a sample over 500 of them; the filter takes two fifths off the spool's (docs/detection.md).
They enter an account as the nuisances of that name do, both chambers at once."""
OWN_NOISE: Final = 0.0006
"""L/min, of each chamber beside that: what the ends of a block are not known by."""
DEAD_ZONE: Final = (0.01, 0.01, 0.015, 0.04, 0.04)
"""Flow in L/min that no fault is claimed for, by fault: what the model may still be wrong by after
the nuisances. 0.1 um of metering edge is 0.01 L/min; edges near null, where a ram that is held
works, look most like an internal leak; supply and return pressures wander by more than leaks."""
_DEAD_ZONE: Final = np.array(DEAD_ZONE)
_LEAST_PART: Final = np.array([0.0, 0.0, 0.0, 0.25, 0.25])
"""Part of each fault's dead zone that stays however exact a model is said to be: what supply and
return do is not linear in their tolerances, by which the accounts follow them."""
RELATIVE_DEAD_ZONE: Final = 0.05
"""Beside a fault, another one must exceed this part of its flow too, and a fault that is down to it
has gone: the leak law is not exact."""
MOST_MODEL_ERROR: Final = 10.0
"""Greatest factor on what is allowed for errors of the model."""
_SENSORS: Final = [nuisance_index(name) for name in SENSOR_ERRORS]
_IN_SIGMAS: Final = np.array(
    [
        error / NUISANCES[at].sigma
        for error, at in zip(SENSOR_ERRORS.values(), _SENSORS, strict=True)
    ]
)


def checked_model_error(model_error: float) -> float:
    """Return a factor on what is allowed for errors of the model.

    Raises:
        ValueError: it is not within 0 to `MOST_MODEL_ERROR`.
    """
    if not 0.0 <= model_error <= MOST_MODEL_ERROR:
        raise ValueError(
            f"model_error: {model_error} is outside 0 (the model is exact) to {MOST_MODEL_ERROR:g}"
        )
    return model_error


def sensor_noise(block: AccountBlock) -> Array:
    """Return the covariance (2, 2) of what sensors make of a block's missing flows, (m^3/s)^2."""
    errors = block.nuisances[:, _SENSORS] * _IN_SIGMAS
    own = (OWN_NOISE * LITRE_PER_MINUTE) ** 2
    return np.asarray(errors @ errors.T + own * np.eye(2))


def whitening(block: AccountBlock, model_error: float) -> Array:
    """Return what makes a block's expected noise white and 1, float64 (2, 2), s/m^3.

    Where nuisances may do more than their signatures say, the account counts for less.

    Args:
        block: the account.
        model_error: factor on what is allowed for errors of the model.
    """
    model = np.full(2, model_error * NOISE * LITRE_PER_MINUTE)
    model = np.hypot(model, model_error * block.doubts)
    return np.linalg.inv(np.linalg.cholesky(sensor_noise(block) + np.diag(model**2)))


def dead_zones(model_error: float) -> Array:
    """Return the flow in L/min that no fault is claimed for, by fault, float64 (5,).

    Args:
        model_error: factor on what is allowed for errors of the model.
    """
    return np.asarray(np.maximum(model_error, _LEAST_PART) * _DEAD_ZONE)
