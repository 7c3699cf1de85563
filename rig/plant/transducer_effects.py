"""What lies between the true state and the readings: lag, play and delay, then gain and bias.

Effects of the transducers with a memory of their own, which the plant's state leaves out. The
memory is one float64 array, made by `transducers` and moved along with the plant by `follow`;
`rig.plant.sensors` adds noise, range and resolution. The recorded truth stays that of the plant.
"""

from math import exp
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit

from .command_effects import LONGEST_DELAY_TICKS
from .compiled import inlined, inner
from .integrator import TICK
from .memory_laws import lagged, play
from .parameters import Parameters

Array = NDArray[np.float64]

_ENTRIES: Final = LONGEST_DELAY_TICKS + 2
"""Entries of the position's history: they are at least a tick apart, so that they reach back over
20 ms."""
_LAGGED, _LAST, _ENCODER, _TIME, _NEWEST = 0, 2, 4, 5, 6
_TIMES: Final = 7
_POSITIONS: Final = _TIMES + _ENTRIES
TRANSDUCERS_SIZE: Final = _POSITIONS + _ENTRIES
"""Numbers of the memory: both pressures behind their lag, both pressures when last seen (Pa), the
encoder's side of the play (m), time (s), and the history of that: newest entry, times, positions.
"""


class Means(NamedTuple):
    """What the transducers read of a state but for noise, range, resolution and memory, SI."""

    position: float
    pressure_1: float
    pressure_2: float
    spool: float
    supply_pressure: float


def transducers(parameters: Parameters, state: Array) -> Array:
    """Return the memory (`TRANSDUCERS_SIZE`,) of transducers of a rig long in `state` (9,).

    The encoder stands in the middle of its play.
    """
    seen = np.zeros(TRANSDUCERS_SIZE)
    seen[_LAGGED : _LAST + 2] = np.maximum([*state[2:4], *state[2:4]], 0.0)
    seen[_ENCODER] = state[4]
    seen[_TIMES:_POSITIONS] = -np.inf
    seen[_POSITIONS:] = state[4]
    return seen


@inner
def _follow_pressures(seen, state, lag, step):
    """Let both lags follow the pressures, taken to change evenly over a step of s."""
    kept = exp(-step / lag)
    for i in range(2):
        pressure = max(state[2 + i], 0.0)
        seen[_LAGGED + i] = lagged(seen[_LAGGED + i], seen[_LAST + i], pressure, lag / step, kept)
        seen[_LAST + i] = pressure


@inner
def _follow_position(seen, position, backlash, step):
    """Take the encoder along, and note where it is if the last note is a tick old."""
    seen[_ENCODER] = play(seen[_ENCODER], position, 0.5 * backlash)
    seen[_TIME] += step
    newest = int(seen[_NEWEST])
    if seen[_TIME] - seen[_TIMES + newest] > 0.999999 * TICK:
        newest = (newest + 1) % _ENTRIES
        seen[_NEWEST] = newest
        seen[_TIMES + newest] = seen[_TIME]
        seen[_POSITIONS + newest] = seen[_ENCODER]


@inner
def _delayed(seen, delay):
    """Return the position of a delay (s) ago, interpolated between the entries around it."""
    wanted = seen[_TIME] - delay
    later_time, later = seen[_TIME], seen[_ENCODER]
    entry = int(seen[_NEWEST])
    for _ in range(_ENTRIES):
        time, position = seen[_TIMES + entry], seen[_POSITIONS + entry]
        if time <= wanted:
            if np.isinf(time) or later_time <= time:
                return position
            return position + (later - position) * ((wanted - time) / (later_time - time))
        later_time, later = time, position
        entry = (entry - 1) % _ENTRIES
    return later


@njit(cache=True, error_model="numpy", forceinline=True)
def follow(seen, state, par, step=TICK):
    """Move the transducers' memory along with the plant, in place.

    Args:
        seen: float64 (`TRANSDUCERS_SIZE`,), made by `transducers`.
        state: float64 (9,), true state now, in the order of `PlantState`.
        par: `Parameters`.
        step: time since it last followed, s.
    """
    if par.pressure_lag != 0.0:
        _follow_pressures(seen, state, par.pressure_lag, step)
    if (par.position_backlash != 0.0) | (par.position_delay != 0.0):
        _follow_position(seen, state[4], par.position_backlash, step)


@inlined
def seen_position(seen, position, par):
    """Return the position in m that the encoder has to show of the ram's."""
    if par.position_delay != 0.0:
        return _delayed(seen, par.position_delay)
    if par.position_backlash != 0.0:
        return seen[_ENCODER]
    return position


@inlined
def seen_pressures(seen, p1, p2, par):
    """Return the pressures in Pa behind the lag of their transducers."""
    if par.pressure_lag != 0.0:
        return seen[_LAGGED], seen[_LAGGED + 1]
    return p1, p2


@inlined
def shown_pressure(pressure, gain, bias):
    """Return what a transducer makes of a pressure in Pa; it never sees below an empty chamber."""
    return gain * max(pressure, 0.0) + bias


@inlined
def reading_means(position, p1, p2, spool, supply, par):
    """Return `Means` of what the transducers see, SI: gain and bias of each reading.

    Of a rig whose readings lag or are late, give what is seen: `seen_position`, `seen_pressures`.
    """
    return Means(
        par.position_gain * position,
        shown_pressure(p1, par.pressure_1_gain, par.pressure_1_bias),
        shown_pressure(p2, par.pressure_2_gain, par.pressure_2_bias),
        spool,
        max(supply, 0.0),
    )
