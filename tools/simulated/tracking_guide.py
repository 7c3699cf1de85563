"""The tracking law for motions that are given as samples, as studies draw them."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from control import COMMAND_LIMIT, PLAIN, POSITION_GAIN, ControlSettings, Guide, guide_along
from rig.plant import DATA_SHEET, NOMINAL

Array = NDArray[np.float64]

TRACKING: Final = ControlSettings(feedforward="model", integral_time=1.0, cyclic=True)
"""The law that docs/tracking.md recommends where nothing was measured on the rig. Of drawn motions
only the samples are known, so that no frequency of theirs is corrected."""


def tracking_guide(samples: Array, open_loop: bool = False) -> Guide:
    """Return the guide of the tracking law for samples of a setpoint.

    Gain and limit are the thesis's, and the law assumes the nominal model.

    Args:
        samples: (ticks,) the setpoint, m.
        open_loop: whether the samples are a command in V; then nothing is added to it.
    """
    if open_loop:
        return PLAIN
    return guide_along(samples, (), TRACKING, NOMINAL, DATA_SHEET, POSITION_GAIN, COMMAND_LIMIT)
