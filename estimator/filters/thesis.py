"""The two filters of the thesis, kept as references under their names: thesis-6 and thesis-7.

They are extended Kalman filters with forward Euler prediction at 1 kHz and the printed tuning. They
measure position, p1 and p2 (eq. 4.23; with seven states eq. 6.21 gets a further column of zeros).
Nothing is done against their divergence: forward Euler is unstable for the oil column
(docs/model.md), an estimate may leave the stroke, and the printed P0 (a spool known to 100 m) costs
more digits than a double has, so that variances may turn negative in the first steps. The outputs
show all this unchanged. The filters differ from the printed text in these points:

- They have the corrections to the equations that docs/model.md lists.
- `u` is the command held over the interval that ends with this sample.
- Square roots of pressure drops have a floor
  (`estimator.filters.thesis_model.PRESSURE_DROP_FLOOR`).
- As R is diagonal, the measurements correct one after the other, which equals eq. 4.18.
- P stays symmetric: its upper triangle is computed and copied to the lower one.

A step writes `out` (9,): 0 to 2 are the innovations z - H x(-), 3 to 5 the a posteriori residuals
z - H x(+) (eq. 4.24), and 6 to 8 the innovation variances, the diagonal of H P(-) H' + R; each in
the order position (m), p1, p2 (Pa). A measurement that is NaN is skipped; its three outputs are
NaN.
"""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.plant import Parameters, inlined

from .covariance import kalman_step
from .thesis_model import Vector, linearised_6, linearised_7

Array = NDArray[np.float64]

THESIS6_PROCESS_NOISE: Final = (1e-20, 1e4, 1e4, 1e-6, 1e-6, 1e-20)
"""Diagonal of Q (chapter 5), SI squared, states [x_sp, p1, p2, x_a, v, v_sp]."""

THESIS6_MEASUREMENT_NOISE: Final = (1e-4, 1e6, 1e6)
"""Diagonal of R (chapter 5): position in m^2, pressures in Pa^2, as printed."""

THESIS7_PROCESS_NOISE: Final = (1e-20, 1e4, 1e4, 1e-6, 1e-4, 1e-20, 1e2)
"""Diagonal of Q (section 7.2), SI squared, states [x_sp, p1, p2, x_a, v, v_sp, F_e]."""

THESIS7_MEASUREMENT_NOISE: Final = (1e-4, 1e5, 1e5)
"""Diagonal of R (section 7.2): position in m^2, pressures in Pa^2."""

INITIAL_STATE: Final = (0.0, 6.8e6, 6.8e6, 0.0, 0.0, 0.0, 0.0)
"""x0, SI (sections 4.5 and 7.2); the six-state filter takes the first six values."""

INITIAL_VARIANCE: Final = 1e4
"""Value of every diagonal element of P0 (section 4.5)."""


def initial_state(with_load: bool) -> tuple[Array, Array]:
    """Return x0 and P0 as printed: (6,) and (6, 6), or (7,) and (7, 7) if `with_load`."""
    x = np.array(INITIAL_STATE if with_load else INITIAL_STATE[:6])
    return x, INITIAL_VARIANCE * np.eye(x.size)


@inlined
def six(x: Array) -> Vector:
    """Return the six states of x (6,) as a tuple."""
    return x[0], x[1], x[2], x[3], x[4], x[5]


@inlined
def seven(x: Array) -> Vector:
    """Return the seven states of x (7,) as a tuple."""
    return x[0], x[1], x[2], x[3], x[4], x[5], x[6]


# Forced inline: passing the parameters one by one would add a quarter to the time of a step.
@njit(cache=True, error_model="numpy", forceinline=True)
def thesis6_step(
    x: Array,
    P: Array,
    u: float,
    z_position: float,
    z_p1: float,
    z_p2: float,
    parameters: Parameters,
    out: Array,
) -> None:
    """Advance the six-state filter by one sample (eqs. 2.15 to 2.17, 4.17 to 4.20).

    Args:
        x: (6,), a posteriori state, updated in place.
        P: (6, 6), covariance of the state, updated in place.
        u: command in V held since the last sample.
        z_position: measured position in m, or NaN.
        z_p1: measured pressure of chamber 1 in Pa, or NaN.
        z_p2: measured pressure of chamber 2 in Pa, or NaN.
        parameters: parameters of the rig that the filter assumes.
        out: (9,), overwritten: 0 to 2 the innovations, 3 to 5 the residuals after the correction, 6
            to 8 the innovation variances, each of position, p1, p2; NaN for a reading of NaN.
    """
    linearised = linearised_6(six(x), u, parameters)
    noise = THESIS6_PROCESS_NOISE, THESIS6_MEASUREMENT_NOISE
    kalman_step(linearised, x, P, noise, (z_position, z_p1, z_p2), out)


@njit(cache=True, error_model="numpy", forceinline=True)
def thesis7_step(
    x: Array,
    P: Array,
    u: float,
    z_position: float,
    z_p1: float,
    z_p2: float,
    parameters: Parameters,
    out: Array,
) -> None:
    """Advance the seven-state filter by one sample (eqs. 6.13 to 6.20, 4.17 and 4.18).

    The arguments are as in `thesis6_step`, with x (7,) and P (7, 7); the seventh state is the load
    F_e in N.
    """
    linearised = linearised_7(seven(x), u, parameters)
    noise = THESIS7_PROCESS_NOISE, THESIS7_MEASUREMENT_NOISE
    kalman_step(linearised, x, P, noise, (z_position, z_p1, z_p2), out)
