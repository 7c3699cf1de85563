"""Break-away force: the force of the oil with which a ram at rest takes off (section 3.1, step 1).

The valve's command rises and falls so slowly that the ram creeps rather than jumps. The greatest
force of the pressures, less that of the known spring, is the break-away force of the seals.
Bristles bend before they slip, and in a ramp of finite slope they hold a little less than their
stiction; `presliding_creep` gives the speed from which this difference follows.
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
"""Samples over which the force is averaged. This is short against the ramp and long against the
noise: the mean is known to 3 N on the thesis's rig."""
CREEP_S: Final = 0.5
"""Seconds around the greatest force over which the speed is measured with the encoder."""
TAKEN_OFF_M: Final = 5e-4
"""Travel in m from which a ram counts as sliding: four times that of bending bristles
(docs/model.md)."""
_SHARE: Final = 0.8
"""Factor on the formula of `presliding_creep`. It was 0.77 to 0.83 in simulations without noise, of
three rigs drawn at random with two ramps each (docs/friction.md)."""


@dataclass(frozen=True)
class BreakAway:
    """The greatest force in one direction during one ramp.

    Attributes:
        direction: 1 extending, -1 retracting.
        position: position of the ram at the greatest force, m.
        force: greatest force less that of the spring, N, positive when extending.
        standard_error: standard error of the force by the transducers' noise alone, N.
        velocity: speed at which the ram crept at that time, m/s, with the sign of the direction; 0
            if it moved the other way.
        travel: greatest distance that the ram went in this direction, m.
    """

    direction: int
    position: float
    force: float
    standard_error: float
    velocity: float
    travel: float

    @property
    def taken_off(self) -> bool:
        """Return whether the ram slid, so that the break-away force was really reached."""
        return self.travel > TAKEN_OFF_M


def break_aways(recording: Recording, spring: Spring, piston_area: float) -> tuple[BreakAway, ...]:
    """Return the break-aways retracting and extending, in this order, of one recorded ramp.

    The greatest of noisy means would be too great. The time of the greatest force is therefore
    found from every other sample, the force at that time from the samples in between, and both the
    other way round as well.

    Args:
        recording: recording of a slow ramp of the command through the valve's null, both ways.
        spring: the known spring that the ram runs against.
        piston_area: m^2.

    Returns:
        The two break-aways; () if more than a tenth of the samples is missing or there are too few.
    """
    channels = recording.channels
    position = filled(channels["position_m"])
    difference = filled(channels["pressure_1_Pa"] - channels["pressure_2_Pa"])
    if position is None or difference is None or position.size < 4 * WINDOW_TICKS:
        return ()
    force = piston_area * difference - spring.force(position)
    return tuple(_greatest(force, position, direction) for direction in (-1, 1))


def presliding_creep(parameters: Parameters, slope_V_per_s: float) -> float:  # noqa: N803
    """Return the speed in m/s at which the slip curve gives the break-away force of a slow ramp.

    While the command falls to null, the creeping ram slows down at a rate a. Bristles need a travel
    of about g/s_0 to follow the slip curve. The ram enters the last such travel at
    v = sqrt(2 a g/s_0), and friction hardly changes from there on. The greatest force is therefore
    a little below stiction. With Karnopp friction the speed is 0.

    Args:
        parameters: parameters of friction, valve and supply.
        slope_V_per_s: slope of the command, V/s.
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
    # Travel of the ram in this direction: the greatest rise from any earlier position.
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
    """Return the running means over `count` successive values of (n,): (n - count + 1,)."""
    total = np.cumsum(np.concatenate([[0.0], values]))
    return np.asarray((total[count:] - total[:-count]) / count)
