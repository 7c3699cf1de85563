"""Mean force at constant speed (section 3.1, step 2), and whether the speed was one.

Where friction falls with velocity a ram sticks and slips, or trembles too fast to be seen; the mean
force then is no friction at the mean velocity. `settled` tells those strokes from the others.
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
"""Share of a stroke that is left to the position loop: its lag dies down with 0.3 s."""
_END_S: Final = 0.05
_LEAST_BLOCKS: Final = 12
_STEADY: Final = 1.5
"""Scatter of 10 ms means of the force beyond what the transducers' noise makes, from which it
oscillates; 12 blocks of noise exceed it less than once in 100."""


class Stroke(NamedTuple):
    """A stretch of a recording in which the setpoint moves at constant speed."""

    start_s: float
    end_s: float


@dataclass(frozen=True)
class SteadySpeed:
    """The mean force of one stroke.

    Attributes:
        velocity: mean, m/s, positive when extending.
        force: mean, N against extension, spring and inertia taken off.
        standard_error: of the transducers' noise and what is left of oscillations, N.
        settled: whether the ram slid steadily.
    """

    velocity: float
    force: float
    standard_error: float
    settled: bool


def steady_speeds(
    recording: Recording, strokes: Iterable[Stroke], spring: Spring, parameters: Parameters
) -> Iterator[SteadySpeed]:
    """Yield what each stroke of a recording shows; strokes that were hardly measured show nothing.

    Args:
        recording: of strokes at constant speed.
        strokes: where they are.
        spring: the known environment.
        parameters: piston area and moving mass.
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
