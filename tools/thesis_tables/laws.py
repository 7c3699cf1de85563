"""The leakage laws read backwards (eqs. 5.3 to 5.7): from flow and pressure drop to coefficient.

All values are SI, as in `faults.leakage`, whose laws these are the inverses of.
"""

from typing import Any

import numpy as np

from faults.leakage import Value
from rig.plant.dynamics import signed_roots


def square_root_coefficient(flow: Value, pressure_drop: Value) -> Value:
    """Return q / (sgn(dp) sqrt|dp|) in m^3/(s Pa^0.5) (eqs. 5.4, 5.6 and 5.7, in SI).

    The flow q is in m^3/s, the drop dp in Pa. The result is NaN where the drop is zero. For a flow
    meter without a sign, such as the rig's internal one, give the magnitude of the drop.
    """
    return _ratio(flow, signed_roots(pressure_drop))


def linear_coefficient(flow: Value, pressure_drop: Value) -> Value:
    """Return q / dp in m^3/(s Pa) (eq. 5.3, in SI), q in m^3/s, dp in Pa; NaN where dp is 0."""
    return _ratio(flow, pressure_drop)


def _ratio(flow: Any, drive: Any) -> Any:
    return flow / np.where(drive == 0.0, np.nan, drive)[()]
