"""The proportional position loop of the rig (section 5.2), as compiled scalar code."""

from math import isnan
from typing import Final

from numba import njit

POSITION_GAIN: Final = 50.0
"""V/m, "unity feedback of the actuator displacement and a DC gain of 50" (section 5.2)."""

COMMAND_LIMIT: Final = 10.0
"""V, reached in section 7.1.2; 10 V open the spool by 0.28 mm (table 2.1 as corrected)."""


@njit(cache=True, error_model="numpy")
def proportional_command(setpoint: float, position: float, gain: float, limit: float) -> float:
    """Return the valve command in V: gain (setpoint - position), within +-limit.

    Setpoint and position in m, gain in V/m, limit in V. Without a position or a setpoint (NaN) the
    command is 0 V, the valve's null: a ram whose position is unknown is not driven.
    """
    command = gain * (setpoint - position)
    if isnan(command):
        return 0.0
    return min(max(command, -limit), limit)
