"""The rig's proportional position loop (section 5.2), compiled, and the move to a test's start."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.lanes import select

Array = NDArray[np.float64]

POSITION_GAIN: Final = 50.0
"""Gain in V/m: "unity feedback of the actuator displacement and a DC gain of 50" (section 5.2)."""

COMMAND_LIMIT: Final = 10.0
"""Greatest command in V, of either sign, as in section 7.1.2; 10 V open the spool by 0.28 mm
(table 2.1 as corrected)."""

_RAMP_PART: Final = 0.75
"""Part of the settling time in which the ram moves to its start; in the rest it comes to rest."""


@njit(cache=True, error_model="numpy")
def proportional_command(setpoint: float, position: float, gain: float, limit: float) -> float:
    """Return the valve command in V: gain times (setpoint - position), limited to +-limit.

    Setpoint and position are in m, the gain in V/m, the limit in V. If setpoint or position is NaN,
    the command is 0 V, the valve's null, as a ram of unknown position must not be driven.
    """
    command = gain * (setpoint - position)
    is_known = command == command  # a NaN is not equal to itself
    return select(is_known, min(max(command, -limit), limit), 0.0)


def raised_cosine(start: float, end: float, ticks: int) -> Array:
    """Return setpoints in m, one a tick (ticks,), that go from `start` to `end` (m) without jerks.

    They follow half a period of a cosine in the first three quarters of the ticks, beginning with
    `start` itself, and stay at `end` from then on.
    """
    ramp = max(int(_RAMP_PART * ticks), 1)
    return start + (end - start) * raised_cosine_share(np.arange(ticks) / ramp)


def raised_cosine_share(progress: Array) -> Array:
    """Return the part of a way that a raised cosine has gone, 0 to 1, in the shape of `progress`.

    `progress` is the part of its time that has passed; beyond 1 the way is at its end.
    """
    return 0.5 - 0.5 * np.cos(np.pi * np.minimum(progress, 1.0))
