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
from rig.plant import LITRE_PER_MINUTE, inner

_NULL_BIAS: Final = nuisance_index("spool_null_bias")
_PLACES: Final = np.array(SENSOR_PLACES)
_PARTS: Final = np.array(SENSOR_PARTS)
_OWN: Final = (OWN_NOISE * LITRE_PER_MINUTE) ** 2
_MODEL: Final = MODEL_NOISE * LITRE_PER_MINUTE


@inner
def _noise_factor(nuisances, doubts, model_error):
    """Return the elements (1, 1), (2, 1), (2, 2) of the Cholesky factor of the expected noise."""
    first = crossed = second = 0.0
    for i in range(_PLACES.size):
        one = nuisances[0, _PLACES[i]] * _PARTS[i]
        two = nuisances[1, _PLACES[i]] * _PARTS[i]
        first += one * one
        crossed += one * two
        second += two * two
    model_1 = hypot(model_error * _MODEL, model_error * doubts[0])
    model_2 = hypot(model_error * _MODEL, model_error * doubts[1])
    root_1 = sqrt(first + (_OWN + model_1 * model_1))
    crossed /= root_1
    return root_1, crossed, sqrt(second + (_OWN + model_2 * model_2) - crossed * crossed)


@njit(cache=True, error_model="numpy", nogil=True)
def drift_row(missing, nuisances, faults, doubts, moved, per_second, model_error):
    """Return a block's row of the test for a drift of the encoder, in units of its expected noise.

    Args:
        missing: as for `whitened`.
        nuisances: as for `whitened`.
        faults: as for `whitened`.
        doubts: as for `whitened`.
        moved: what a drift of 1 m/s that began at time 0 takes out of both chambers, m^3/s, (2,).
        per_second: what it takes for each second by which it began later, m^3/s^2, (2,).
        model_error: factor on what is allowed for errors of the model.

    Returns:
        The missing flow, the nuisances, the faults, the null, the drift, the null that may shift
        and `per_second`, (2, 1 + n + 5 + 4).
    """
    root_1, crossed, root_2 = _noise_factor(nuisances, doubts, model_error)
    count = faults.shape[1]
    last = 1 + NUISANCE_COUNT + count
    row = np.empty((2, last + 4))
    for c in range(2):
        row[c, 0] = missing[c]
        for a in range(NUISANCE_COUNT):
            row[c, 1 + a] = nuisances[c, a]
        for i in range(count):
            row[c, 1 + NUISANCE_COUNT + i] = faults[c, i]
        row[c, last] = nuisances[c, _NULL_BIAS]
        row[c, last + 1] = moved[c]
        row[c, last + 2] = model_error * nuisances[c, _NULL_BIAS]
        row[c, last + 3] = per_second[c]
    for k in range(last + 4):
        row[0, k] /= root_1
        row[1, k] = (row[1, k] - crossed * row[0, k]) / root_2
    return row


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
    root_1, crossed, root_2 = _noise_factor(nuisances, doubts, model_error)
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
