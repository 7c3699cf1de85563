"""The leakage laws (eqs. 5.1 and 5.2): from coefficient and pressure drop to flow.

All values are SI. The drop of an external leak is p_chamber - p_e, that of an internal one
p_1 - p_2. Flow is positive for a positive drop, so that one signed law serves both. The thesis
writes the unit of the square-root coefficients as "m^3/s Pa"; it means m^3/(s Pa^0.5).
"""

from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from rig.plant import LITRE_PER_MINUTE, signed_roots

from .verdict import Verdict

Value = TypeVar("Value", float, NDArray[np.float64])
"""A number, or an array of any shape."""


TYPICAL_PRESSURE: Final = 6.9e6
"""Pressure drop in Pa at which flows are stated: half the supply pressure of section 2.1.

The pressure in a chamber is usually near this value.
"""


def to_litres_per_minute(flow: Value) -> Value:
    """Return a flow in L/min, given in m^3/s."""
    return flow / LITRE_PER_MINUTE


def square_root_flow(coefficient: float, pressure_drop: Value) -> Value:
    """Return k sgn(dp) sqrt|dp| in m^3/s, k in m^3/(s Pa^0.5), dp in Pa (eq. 5.2, signed)."""
    return coefficient * signed_roots(pressure_drop)


def linear_flow(coefficient: float, pressure_drop: Value) -> Value:
    """Return k dp in m^3/s, k in m^3/(s Pa), dp in Pa (eq. 5.1)."""
    return coefficient * pressure_drop


def size_shown(kind: str, coefficient: float, *, linear: bool) -> str:
    """Return a fault's size as text.

    That of a leak is its flow in L/min at `TYPICAL_PRESSURE`, with a note if its law is linear;
    that of a return blockage is its coefficient.

    Args:
        kind: one of `faults.verdict.FAULT_KINDS`.
        coefficient: coefficient of the fault, SI.
        linear: whether a leak is proportional to the pressure drop.
    """
    if kind == Verdict.RETURN_BLOCKAGE:
        return f"{coefficient:.4g} Pa/(m^3/s)^2"
    law = linear_flow if linear else square_root_flow
    flow = float(to_litres_per_minute(law(coefficient, TYPICAL_PRESSURE)))
    law_shown = " (linear)" if linear else ""
    return f"{flow:.3g} L/min at {1e-6 * TYPICAL_PRESSURE:g} MPa{law_shown}"
