"""Break-away force: how hard the oil pushes before a ram at rest takes off (section 3.1, step 1).

The valve's command rises and falls so slowly that the ram creeps rather than jumps. The greatest
force of the pressures, less the known spring, is what the seals held. Where bristles bend before
they slip they hold a little less than their stiction in any ramp of finite slope:
`presliding_creep` says how much.
"""

from dataclasses import dataclass
from math import sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import KARNOPP, TICK, Parameters
from rig.recording import Recording

from .samples import Spring, filled

Array = NDArray[np.float64]

WINDOW_TICKS: Final = 80
"""Short beside the ramp, long beside the noise: its mean is known to 3 N on the thesis's rig."""
CREEP_S: Final = 0.5
"""Stretch around the greatest force from which the encoder tells the speed."""
TAKEN_OFF_M: Final = 5e-4
"""Travel after which a ram slides: four times what bristles bend by (docs/model.md)."""
_SHARE: Final = 0.8
"""Factor on the formula's value: it came out as 0.77 to 0.83, computed without noise for three
drawn rigs with two ramps each (docs/friction.md)."""


@dataclass(frozen=True)
class BreakAway:
    """The greatest force in one direction at one place.

    Attributes:
        direction: 1 extending, -1 retracting.
        position: where, m.
        force: in N, positive when extending, spring taken off.
        standard_error: of the transducers' noise alone, N.
        velocity: at which the ram crept then, m/s, of the force's sign.
        travel: how far the ram went in this direction, m.
    """

    direction: int
    position: float
    force: float
    standard_error: float
    velocity: float
    travel: float

    @property
    def taken_off(self) -> bool:
        """Whether the ram slid, so that the force cannot have been greater."""
        return self.travel > TAKEN_OFF_M


def break_aways(recording: Recording, spring: Spring, piston_area: float) -> tuple[BreakAway, ...]:
    """Return the break-away retracting and extending in a recorded ramp up and down.

    Nothing where more than a tenth of the samples is missing, or the recording is no ramp's length.

    The time of the greatest force is looked for in every other sample, and the force there taken
    from those in between, both ways round: the greatest of noisy means would be too great.

    Args:
        recording: of a slow ramp of the command through the valve's null, both ways.
        spring: the known environment.
        piston_area: m^2.
    """
    channels = recording.channels
    position = filled(channels["position_m"])
    difference = filled(channels["pressure_1_Pa"] - channels["pressure_2_Pa"])
    if position is None or difference is None or position.size < 4 * WINDOW_TICKS:
        return ()
    force = piston_area * difference - spring.force(position)
    return tuple(_greatest(force, position, direction) for direction in (-1, 1))


def presliding_creep(parameters: Parameters, slope_V_per_s: float) -> float:  # noqa: N803
    """Return the speed in m/s at which the slip curve has the greatest force of a slow ramp.

    While the command falls to null, the creeping ram slows down by some a = dv/dt. Bristles follow
    the slip curve within g/s_0 of travel, the last of which the ram enters at v = sqrt(2 a g/s_0):
    friction stays what it was about there, and so a little below stiction.

    Args:
        parameters: of friction, valve and supply.
        slope_V_per_s: of the command.
    """
    par = parameters
    if par.friction_law == KARNOPP:
        return 0.0
    root = sqrt((par.supply_pressure - par.return_pressure) / par.density)
    flow = par.discharge_coefficient * par.area_gradient * par.valve_gain * root
    slowing = slope_V_per_s * flow / par.piston_area
    return _SHARE * sqrt(2.0 * slowing * max(par.stiction, 0.0) / par.bristle_stiffness)


def _greatest(force: Array, position: Array, direction: int) -> BreakAway:
    signed = direction * force
    half = WINDOW_TICKS // 2
    even, odd = _means(signed[0::2], half), _means(signed[1::2], half)
    count = min(even.size, odd.size)
    at_even, at_odd = int(np.argmax(even[:count])), int(np.argmax(odd[:count]))
    found = 0.5 * (odd[at_even] + even[at_odd])
    tick = at_even + at_odd + half
    noise = float(np.std(np.diff(force))) / sqrt(2.0)
    ticks = round(0.5 * CREEP_S / TICK)
    first, last = max(tick - ticks, 0), min(tick + ticks, force.size - 1)
    crept = float(position[last] - position[first]) / ((last - first) * TICK)
    # What the ram went in this direction: the greatest climb from any earlier position.
    way = direction * position
    travel = float(np.max(way - np.minimum.accumulate(way)))
    return BreakAway(
        direction,
        float(position[tick]),
        direction * float(found),
        noise / sqrt(WINDOW_TICKS),
        direction * max(direction * crept, 0.0),
        travel,
    )


def _means(values: Array, count: int) -> Array:
    """Return the means of `count` successive values, (n - count + 1,)."""
    total = np.cumsum(np.concatenate([[0.0], values]))
    return np.asarray((total[count:] - total[:-count]) / count)
