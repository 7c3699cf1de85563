"""The tracking law for motions that are given as samples, as studies draw them."""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from control import COMMAND_LIMIT, PLAIN, POSITION_GAIN, ControlSettings, Guide, Quantity, guide_of
from rig.plant import DATA_SHEET, NOMINAL
from rig.plant.integrator import TICK

Array = NDArray[np.float64]

TRACKING: Final = ControlSettings(feedforward="model", integral_time=1.0, cyclic=True)
"""The law that docs/tracking.md recommends where nothing was measured on the rig. Of drawn motions
only the samples are known, so that no frequency of theirs is corrected."""


@dataclass(frozen=True)
class _Sampled:
    """A setpoint of which only the samples are known, one a tick."""

    samples: Array
    quantity: Quantity = "position"

    def sample(self, time_s: NDArray[np.floating[Any]]) -> Array:
        """Return the setpoint in m at each time in s, that of the tick before."""
        return self.samples[np.round(time_s / TICK).astype(int)]

    def peak_rate(self, duration_s: float) -> float:
        """Return inf, as the samples may jump."""
        return np.inf


def tracking_guide(samples: Array, open_loop: bool = False) -> Guide:
    """Return the guide of the tracking law for samples of a setpoint.

    Gain and limit are the thesis's, and the law assumes the nominal model.

    Args:
        samples: (ticks,) the setpoint, m.
        open_loop: whether the samples are a command in V; then nothing is added to it.
    """
    if open_loop:
        return PLAIN
    return guide_of(
        _Sampled(samples), samples, TRACKING, NOMINAL, DATA_SHEET, POSITION_GAIN, COMMAND_LIMIT
    )
