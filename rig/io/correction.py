"""Corrects what transducers indicate by their calibrations, compiled, in the loop's own tick."""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.plant import inlined, inner

from .signals import FAST_INPUTS
from .transducer_calibration import TransducerCalibration, corrected

_corrected = inlined(corrected)


class Corrections(NamedTuple):
    """The calibrations of the transducers that the fast driver reads, as compiled code takes them.

    The points of all calibrations stand one after the other.
    """

    inputs: NDArray[np.int64]
    """(n,): index in `FAST_INPUTS` of the channel of each calibration."""
    first: NDArray[np.int64]
    """(n + 1,): index of the first point of each calibration, and the number of all points."""
    indicated: NDArray[np.float64]
    """(points,): what the transducer indicated, SI."""
    corrections: NDArray[np.float64]
    """(points,): what must be added to that, SI."""


def corrections_of(calibrations: Iterable[TransducerCalibration] = ()) -> Corrections:
    """Return the corrections of the fast driver's channels; other channels are left out."""
    mine = [each for each in calibrations if each.channel in FAST_INPUTS]
    points = [point for each in mine for point in each.points]
    return Corrections(
        np.array([FAST_INPUTS.index(each.channel) for each in mine], np.int64),
        np.cumsum([0, *(len(each.points) for each in mine)], dtype=np.int64),
        np.array([point.indicated for point in points], np.float64),
        np.array([point.correction for point in points], np.float64),
    )


@inner
def correct(values, calibrated):
    """Replace what the transducers indicate by what their calibrations make of it, in place.

    Args:
        values: float64, SI, in the order of `FAST_INPUTS`; its first nine, the readings, will do if
            no other channel is calibrated.
        calibrated: `Corrections`.
    """
    for i in range(calibrated.inputs.size):
        channel = calibrated.inputs[i]
        values[channel] = _corrected(
            values[channel], calibrated.first[i], calibrated.first[i + 1], calibrated.indicated,
            calibrated.corrections,
        )  # fmt: skip
