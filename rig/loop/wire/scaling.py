"""Brings what a device returned to the scale of the rig: true values, and a position that is known.

The device returns what its transducers indicate, with the signs and places of how they are wired,
and a position counted from where its encoder was switched on. Everything behind this, from the
interlock to the recording, has the scale of the rig.
"""

from typing import Final

from rig.io import FAST_INPUTS, correct
from rig.plant import inner

_POSITION: Final = FAST_INPUTS.index("position_m")


@inner
def bring_to_scale(inputs, offset, corrections):
    """Correct inputs in place by calibrations and wiring, and add an offset to the position.

    Args:
        inputs: (len(FAST_INPUTS),): inputs as the driver decoded them, SI.
        offset: offset of the encoder, m.
        corrections: `rig.io.Corrections`.
    """
    correct(inputs, corrections)
    inputs[_POSITION] += offset
