"""The control laws of cases that run side by side, with the feedforward of their setpoints."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from control import (
    PLAIN,
    ControlSettings,
    Guide,
    corrected_of_multisine,
    corrected_of_sine,
    guide_along,
)
from rig.lanes import LANES
from rig.loop import LaneGuide, lane_guide
from rig.plant import Parameters, SensorParameters

from .motions import AMPLITUDE, FREQUENCY, SINE_ROWS, Motions

Array = NDArray[np.float64]


class MotionControl(NamedTuple):
    """How the position loop follows a motion of a sweep."""

    type: str
    """Type of the motion's setpoint."""
    settings: ControlSettings
    """What the loop adds to gain times error."""
    gain: float
    """Gain of the loop in V/m, where none is drawn for the case."""


def guide_of_cases(
    motions: Motions,
    controls: Sequence[MotionControl],
    assumed: Parameters,
    sensors: SensorParameters,
    limit: float,
    setpoints: Callable[[], Array],
) -> LaneGuide:
    """Return the control laws of cases in lanes, before their first tick.

    Cases in open loop have the proportional law, which is not asked.

    Args:
        motions: setpoints of the cases, one for each lane; sums of sines have their peaks already.
        controls: control of each motion of the sweep.
        assumed: the parameters of the model that the loop assumes, SI.
        sensors: data sheet of the transducers.
        limit: greatest command of either sign, V.
        setpoints: returns the setpoints of all ticks of the cases, m or V, (ticks, LANES); it is
            called only if some case has more than the proportional law.
    """
    kinds = [controls[kind] for kind in motions.kind.tolist()]
    drawn, usual = motions.gain, np.array([each.gain for each in kinds])
    gains = np.where(np.isnan(drawn), usual, drawn).tolist()
    tracks = [
        not control.settings.is_proportional and motions.open_loop[lane] == 0.0
        for lane, control in enumerate(kinds)
    ]
    setpoint = setpoints() if any(tracks) else np.empty((0, LANES))
    guides: list[Guide] = []
    for lane, control in enumerate(kinds):
        if not tracks[lane]:
            guides.append(PLAIN)
            continue
        samples = np.ascontiguousarray(setpoint[:, lane])
        frequencies = _corrected(control.type, motions.sines[:, lane])
        guides.append(
            guide_along(
                samples, frequencies, control.settings, assumed, sensors, gains[lane], limit
            )
        )
    return lane_guide(gains, guides)


def _corrected(kind: str, sines: Array) -> tuple[float, ...]:
    """Return the frequencies in Hz of a case's setpoint that are corrected.

    Args:
        kind: type of the motion.
        sines: rows of the case's sines as in `Motions`, (4 s,).
    """
    rows = sines.reshape(-1, SINE_ROWS)
    found = rows[rows[:, AMPLITUDE] != 0.0, FREQUENCY].tolist()
    if kind == "sine" and found:
        return corrected_of_sine(found[0])
    return corrected_of_multisine(found) if kind == "multisine" else ()
