"""Mean force of strokes at constant speed (section 3.1, step 2), and whether the ram slid steadily.

Where friction falls with velocity, a ram sticks and slips or oscillates too fast for the
transducers. The mean force is then not the friction at the mean velocity. `SteadySpeed.settled` is
false for such strokes.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from math import sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.plant import TICK, Parameters
from rig.recording import Recording

from .samples import BLOCK_TICKS, Spring, filled

Array = NDArray[np.float64]

_SETTLING: Final = 0.45
"""Part of a stroke at its beginning that is left out. The position loop settles in it; its lag has
a time constant of 0.3 s."""
_END_S: Final = 0.05
_LEAST_BLOCKS: Final = 12
_STEADY: Final = 1.5
"""Ratio of the scatter of 10 ms means of the force to that by the transducers' noise, from which
the force counts as oscillating. With 12 blocks noise exceeds it less than once in 100."""


class Stroke(NamedTuple):
    """A stretch of a recording in which the setpoint moves at constant speed.

    Its times are in s from the recording's first sample.
    """

    start_s: float
    end_s: float


@dataclass(frozen=True)
class SteadySpeed:
    """The mean force of one stroke at constant speed.

    Attributes:
        velocity: mean velocity, m/s, positive when extending.
        force: mean force against extension, spring and inertia taken off, N.
        standard_error: standard error of the force, by noise and remaining oscillations, N.
        settled: whether the ram slid steadily.
    """

    velocity: float
    force: float
    standard_error: float
    settled: bool


def steady_speeds(
    recording: Recording, strokes: Iterable[Stroke], spring: Spring, parameters: Parameters
) -> Iterator[SteadySpeed]:
    """Yield velocity and mean force of each stroke of a recording.

    Strokes that are too short, or of which more than a tenth of the samples is missing, are left
    out.

    Args:
        recording: recording of strokes at constant speed.
        strokes: times of the strokes, counted from the recording's first sample.
        spring: the known spring that the ram runs against.
        parameters: parameters of the rig, of which piston area and moving mass are used.
    """
    channels = recording.channels
    position = channels["position_m"]
    difference = channels["pressure_1_Pa"] - channels["pressure_2_Pa"]
    force = parameters.piston_area * difference - spring.force(position)
    time_s = recording.time_s - recording.time_s[0]
    for stroke in strokes:
        length_s = stroke.end_s - stroke.start_s
        begin = stroke.start_s + _SETTLING * length_s
        part = (time_s >= begin) & (time_s < stroke.end_s - _END_S)
        slid, where = filled(force[part]), filled(position[part])
        if slid is None or where is None or slid.size < _LEAST_BLOCKS * BLOCK_TICKS:
            continue
        yield _shown(slid, where, parameters.moving_mass)


def _shown(force: Array, position: Array, mass: float) -> SteadySpeed:
    blocks = force.size // BLOCK_TICKS
    count = blocks * BLOCK_TICKS
    elapsed = TICK * (np.arange(count) - 0.5 * (count - 1))
    curve = np.polynomial.polynomial.polyfit(elapsed, position[:count], 2)
    means = force[:count].reshape(blocks, BLOCK_TICKS).mean(axis=1)
    noise = float(np.std(np.diff(force))) / sqrt(2.0 * BLOCK_TICKS)
    line = np.polynomial.polynomial.polyfit(np.arange(blocks), means, 1)
    rest = means - np.polynomial.polynomial.polyval(np.arange(blocks), line)
    scatter = float(np.sqrt(rest @ rest / (blocks - 2)))
    return SteadySpeed(
        float(curve[1]),
        float(means.mean()) - mass * 2.0 * float(curve[2]),
        max(scatter, noise) / sqrt(blocks),
        scatter < _STEADY * noise,
    )
