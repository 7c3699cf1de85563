"""The proportional position loop of the rig (section 5.2), as compiled scalar code."""

from math import isnan
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit

Array = NDArray[np.float64]

POSITION_GAIN: Final = 50.0
"""V/m, "unity feedback of the actuator displacement and a DC gain of 50" (section 5.2)."""

COMMAND_LIMIT: Final = 10.0
"""V, reached in section 7.1.2; 10 V open the spool by 0.28 mm (table 2.1 as corrected)."""

_RAMP_PART: Final = 0.75
"""Part of the settling time in which the ram moves to its start; the rest lets it come to rest."""


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


def raised_cosine(start: float, end: float, ticks: int) -> Array:
    """Return setpoints (ticks,) from start to end along a raised cosine, with a rest at the end."""
    ramp = max(int(_RAMP_PART * ticks), 1)
    progress = np.minimum(np.arange(ticks) / ramp, 1.0)
    return start + (end - start) * (0.5 - 0.5 * np.cos(np.pi * progress))
