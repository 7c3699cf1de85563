"""The scaling of a block to independent noise of unit variance, as `noise.whitening` has it."""

from math import hypot, sqrt
from typing import Final

import numpy as np

from estimator.accounts import (
    MODEL_NOISE,
    NUISANCE_COUNT,
    OWN_NOISE,
    SENSOR_PARTS,
    SENSOR_PLACES,
    nuisance_index,
)
from rig.jit import njit
from rig.plant import LITRE_PER_MINUTE

_NULL_BIAS: Final = nuisance_index("spool_null_bias")
_PLACES: Final = np.array(SENSOR_PLACES)
_PARTS: Final = np.array(SENSOR_PARTS)
_OWN: Final = (OWN_NOISE * LITRE_PER_MINUTE) ** 2
_MODEL: Final = MODEL_NOISE * LITRE_PER_MINUTE


@njit(cache=True, error_model="numpy", nogil=True)
def whitened(missing, nuisances, faults, doubts, model_error):
    """Return a block's missing flow, nuisances and faults in units of its expected noise.

    Args:
        missing: missing flow of both chambers, m^3/s, (2,).
        nuisances: missing flow by each nuisance, m^3/s, (2, n).
        faults: missing flow per unit coefficient of each fault, (2, 5).
        doubts: flow that nuisances may add beyond their linear terms, m^3/s, (2,).
        model_error: factor on what is allowed for errors of the model.

    Returns:
        The missing flow (2,), the nuisances (2, n), and the faults with a shift of the spool's null
        (2, 6).
    """
    covariance = np.zeros((2, 2))
    for i in range(_PLACES.size):
        one = nuisances[0, _PLACES[i]] * _PARTS[i]
        two = nuisances[1, _PLACES[i]] * _PARTS[i]
        covariance[0, 0] += one * one
        covariance[0, 1] += one * two
        covariance[1, 1] += two * two
    for c in range(2):
        model = hypot(model_error * _MODEL, model_error * doubts[c])
        covariance[c, c] += _OWN + model * model
    root_1 = sqrt(covariance[0, 0])
    crossed = covariance[0, 1] / root_1
    root_2 = sqrt(covariance[1, 1] - crossed * crossed)
    count = faults.shape[1]
    white, scaled = np.empty(2), np.empty((2, NUISANCE_COUNT))
    shapes = np.empty((2, count + 1))
    white[0] = missing[0] / root_1
    white[1] = (missing[1] - crossed * white[0]) / root_2
    for a in range(NUISANCE_COUNT):
        scaled[0, a] = nuisances[0, a] / root_1
        scaled[1, a] = (nuisances[1, a] - crossed * scaled[0, a]) / root_2
    for i in range(count):
        shapes[0, i] = faults[0, i] / root_1
        shapes[1, i] = (faults[1, i] - crossed * shapes[0, i]) / root_2
    for c in range(2):
        shapes[c, count] = model_error * scaled[c, _NULL_BIAS]
    return white, scaled, shapes
