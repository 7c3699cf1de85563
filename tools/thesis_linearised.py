"""Prediction and Jacobian of the thesis filters as arrays, to compare with textbook algebra."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.filters.covariance import COLUMNS
from estimator.filters.thesis import seven, six
from estimator.filters.thesis_model import linearised_6, linearised_7
from rig.jit import njit
from rig.plant import Parameters

Array = NDArray[np.float64]

ENTRIES: Final = {
    size: tuple((i, j) for i, columns in enumerate(rows) for j in columns)
    for size, rows in COLUMNS.items()
}
"""Row and column of every Jacobian entry that is neither zero nor one, by the number of states."""

_ENTRIES_6, _ENTRIES_7 = ENTRIES[6], ENTRIES[7]


@njit(cache=True, error_model="numpy")
def thesis6_predict(x: Array, u: float, parameters: Parameters) -> Array:
    """Return the predicted state (6,) one tick after x under the command u in V (eq. 2.15)."""
    return np.array(linearised_6(six(x), u, parameters)[0])


@njit(cache=True, error_model="numpy")
def thesis7_predict(x: Array, u: float, parameters: Parameters) -> Array:
    """Return the predicted state (7,) one tick after x under command u in V (eqs. 6.13 to 6.19)."""
    return np.array(linearised_7(seven(x), u, parameters)[0])


@njit(cache=True, error_model="numpy")
def thesis6_jacobian(x: Array, parameters: Parameters) -> Array:
    """Return the Jacobian A (6, 6) at x, made of the same entries as the step's (eq. 4.19)."""
    entries = linearised_6(six(x), 0.0, parameters)[1]
    A = np.eye(6)
    for index in range(len(entries)):
        A[_ENTRIES_6[index]] = entries[index]
    return A


@njit(cache=True, error_model="numpy")
def thesis7_jacobian(x: Array, parameters: Parameters) -> Array:
    """Return the Jacobian A (7, 7) at x, made of the same entries as the step's (eq. 6.20)."""
    entries = linearised_7(seven(x), 0.0, parameters)[1]
    A = np.eye(7)
    for index in range(len(entries)):
        A[_ENTRIES_7[index]] = entries[index]
    return A
