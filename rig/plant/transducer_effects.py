"""Effects between the true state and the readings: lag, play and delay, then gain and bias.

Lag, play and delay of the transducers have a memory that is not part of the plant's state. It is
one float64 array, `seen`, that `transducers` makes and `follow` updates along with the plant.
`rig.plant.sensors` adds noise, range and resolution. The recorded truth is the plant's state,
without these effects.
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
"""Number of entries of the position's history. Successive entries are at least a tick apart, so
that the history covers the last 20 ms."""
_LAGGED, _LAST, _ENCODER, _TIME, _NEWEST = 0, 2, 4, 5, 6
_TIMES: Final = 7
_POSITIONS: Final = _TIMES + _ENTRIES
TRANSDUCERS_SIZE: Final = _POSITIONS + _ENTRIES
"""Length of the memory. It holds both pressures after their lag, both true pressures at the last
update (Pa), the encoder's position after the play (m), the time (s), and the history of this
position: index of the newest entry, times, positions."""


class Means(NamedTuple):
    """Readings of the transducers without noise, range and resolution, SI."""

    position: float
    pressure_1: float
    pressure_2: float
    spool: float
    supply_pressure: float


def transducers(parameters: Parameters, state: Array) -> Array:
    """Return the transducers' memory (`TRANSDUCERS_SIZE`,) on a rig that has long been in `state`.

    The state is float64 (9,), in the order of `PlantState`. The encoder starts in the middle of its
    play, and the memory's time at 0 s.
    """
    seen = np.zeros(TRANSDUCERS_SIZE)
    seen[_LAGGED : _LAST + 2] = np.maximum([*state[2:4], *state[2:4]], 0.0)
    seen[_ENCODER] = state[4]
    seen[_TIMES:_POSITIONS] = -np.inf
    seen[_POSITIONS:] = state[4]
    return seen


@inner
def _follow_pressures(seen, state, lag, step):
    """Advance both pressures' lags in place over a step (s) in which pressures change linearly."""
    kept = exp(-step / lag)
    for i in range(2):
        pressure = max(state[2 + i], 0.0)
        seen[_LAGGED + i] = lagged(seen[_LAGGED + i], seen[_LAST + i], pressure, lag / step, kept)
        seen[_LAST + i] = pressure


@inner
def _follow_position(seen, position, backlash, step):
    """Advance the encoder's position, in place, over a step (s); add it to the history once a tick.

    `position` (m) is the ram's true one after the step, and `backlash` (m) the full play.
    """
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
    """Return the encoder's position in m as it was `delay` (s) ago, interpolated in the history."""
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
    """Update the transducers' memory, in place, to the plant's present state.

    Parts of the memory whose effect (lag; play or delay) is switched off are left as they are.

    Args:
        seen: float64 (`TRANSDUCERS_SIZE`,), made by `transducers`.
        state: float64 (9,), true state now, in the order of `PlantState`.
        par: `Parameters`.
        step: time since the last update, s, above 0.
    """
    if par.pressure_lag != 0.0:
        _follow_pressures(seen, state, par.pressure_lag, step)
    if (par.position_backlash != 0.0) | (par.position_delay != 0.0):
        _follow_position(seen, state[4], par.position_backlash, step)


@inlined
def seen_position(seen, position, par):
    """Return the position in m at the encoder, after play and delay; `position` is the true one.

    `seen` is the transducers' memory (`transducers`), which `follow` has brought up to now. Gain
    and resolution are not included. Without play and delay the result is `position`.
    """
    if par.position_delay != 0.0:
        return _delayed(seen, par.position_delay)
    if par.position_backlash != 0.0:
        return seen[_ENCODER]
    return position


@inlined
def seen_pressures(seen, p1, p2, par):
    """Return both pressures in Pa after the transducers' lag; p1 and p2 are the true pressures.

    `seen` is the transducers' memory, as in `seen_position`. Without lag the result is p1 and p2.
    """
    if par.pressure_lag != 0.0:
        return seen[_LAGGED], seen[_LAGGED + 1]
    return p1, p2


@inlined
def shown_pressure(pressure, gain, bias):
    """Return gain times pressure plus bias in Pa; a pressure below zero (a cavity) counts as 0."""
    return gain * max(pressure, 0.0) + bias


@inlined
def reading_means(position, p1, p2, spool, supply, par):
    """Return the readings with gain and bias (`Means`, SI), but without noise, range or resolution.

    With a lag, delay or play, give position and pressures from `seen_position` and
    `seen_pressures`, else the true ones.
    """
    return Means(
        par.position_gain * position,
        shown_pressure(p1, par.pressure_1_gain, par.pressure_1_bias),
        shown_pressure(p2, par.pressure_2_gain, par.pressure_2_bias),
        spool,
        max(supply, 0.0),
    )
