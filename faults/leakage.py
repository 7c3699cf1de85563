"""The leakage laws (eqs. 5.1 to 5.7): from coefficient and pressure drop to flow, and back.

All SI. The drop of an external leak is p_chamber - p_e, that of an internal one p_1 - p_2; flow is
positive down a positive drop, so one signed law serves both. The thesis's "m^3/s Pa" of the
square-root coefficients is m^3/(s Pa^0.5).
"""

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from rig.plant import LITRE_PER_MINUTE, signed_roots

Value = TypeVar("Value", float, NDArray[np.float64])
"""A number, or an array of any shape."""


def to_litres_per_minute(flow: Value) -> Value:
    """Return a flow in m^3/s as L/min."""
    return flow / LITRE_PER_MINUTE


def square_root_flow(coefficient: float, pressure_drop: Value) -> Value:
    """Return k sgn(dp) sqrt|dp| in m^3/s, k in m^3/(s Pa^0.5), dp in Pa (eq. 5.2, signed)."""
    return coefficient * signed_roots(pressure_drop)


def linear_flow(coefficient: float, pressure_drop: Value) -> Value:
    """Return k dp in m^3/s, k in m^3/(s Pa), dp in Pa (eq. 5.1)."""
    return coefficient * pressure_drop


def square_root_coefficient(flow: Value, pressure_drop: Value) -> Value:
    """Return q / (sgn(dp) sqrt|dp|) in m^3/(s Pa^0.5) (eqs. 5.4, 5.6 and 5.7, in SI).

    Flow in m^3/s, dp in Pa. The result is NaN where the drop is zero, as no flow there gives a
    coefficient. For a meter that reads no sign, as the rig's internal one, the drop is to be its
    magnitude.
    """
    return _ratio(flow, signed_roots(pressure_drop))


def linear_coefficient(flow: Value, pressure_drop: Value) -> Value:
    """Return q / dp in m^3/(s Pa) (eq. 5.3, in SI); flow in m^3/s, dp in Pa, NaN where dp is 0."""
    return _ratio(flow, pressure_drop)


def _ratio(flow: Any, drive: Any) -> Any:
    return flow / np.where(drive == 0.0, np.nan, drive)[()]
