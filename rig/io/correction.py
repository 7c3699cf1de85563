"""Corrects what transducers indicate, compiled, in the loop's own tick.

First each reading is corrected by the calibration of its transducer; then what is wired the wrong
way round is put right (`rig.io.wiring`).
"""

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.plant import inlined, inner

from .signals import FAST_INPUTS
from .transducer_calibration import TransducerCalibration, corrected
from .wiring import Wiring

_corrected = inlined(corrected)


class Corrections(NamedTuple):
    """The calibrations and the wiring of what the fast driver reads, as compiled code takes them.

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
    turned: NDArray[np.int64]
    """(m,): index in `FAST_INPUTS` of each channel whose sign is turned over."""
    swapped: NDArray[np.int64]
    """(k, 2): indices in `FAST_INPUTS` of channels that have changed places."""
    command_sign: NDArray[np.float64]
    """(1,): factor on the command as it leaves the loop: 1.0, or -1.0 for an inverted valve."""


def corrections_of(
    calibrations: Iterable[TransducerCalibration] = (), wiring: Wiring | None = None
) -> Corrections:
    """Return the corrections of the fast driver's channels; other channels are left out.

    Args:
        calibrations: the calibrations of the rig's transducers.
        wiring: how the rig is wired; as its register map says if None.
    """
    wiring = wiring or Wiring()
    turned = {
        "device_command_V": wiring.valve == "inverted",
        "position_m": wiring.encoder == "inverted",
        "spool_m": wiring.spool == "inverted",
    }
    lines = [("pressure_1_Pa", "pressure_2_Pa")] if wiring.pressures == "swapped" else []
    mine = [each for each in calibrations if each.channel in FAST_INPUTS]
    points = [point for each in mine for point in each.points]
    return Corrections(
        np.array([FAST_INPUTS.index(each.channel) for each in mine], np.int64),
        np.cumsum([0, *(len(each.points) for each in mine)], dtype=np.int64),
        np.array([point.indicated for point in points], np.float64),
        np.array([point.correction for point in points], np.float64),
        np.array([FAST_INPUTS.index(name) for name in turned if turned[name]], np.int64),
        np.array([list(map(FAST_INPUTS.index, both)) for both in lines], np.int64).reshape(-1, 2),
        np.array([-1.0 if wiring.valve == "inverted" else 1.0]),
    )


@inner
def correct(values, calibrated):
    """Replace what the transducers indicate by what calibrations and wiring make of it, in place.

    Args:
        values: float64, SI, in the order of `FAST_INPUTS`; its first nine, the readings, will do if
            no other channel is calibrated, and the valve is not inverted.
        calibrated: `Corrections`.
    """
    for i in range(calibrated.inputs.size):
        channel = calibrated.inputs[i]
        values[channel] = _corrected(
            values[channel], calibrated.first[i], calibrated.first[i + 1], calibrated.indicated,
            calibrated.corrections,
        )  # fmt: skip
    for i in range(calibrated.turned.size):
        values[calibrated.turned[i]] = -values[calibrated.turned[i]]
    for i in range(calibrated.swapped.shape[0]):
        one, other = calibrated.swapped[i, 0], calibrated.swapped[i, 1]
        values[one], values[other] = values[other], values[one]
