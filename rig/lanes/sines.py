"""Sine and cosine of lanes, which this module also registers with the compiler.

They are series, accurate to 1e-9, as the C library takes only one number at a time. `math.sin` and
`math.cos` of lanes are the same series.
"""

import math
from math import floor

from rig.jit import njit

from .choosing import INLINED, select
from .kinds import lanes, overload


@njit(cache=True, error_model="numpy", forceinline=True)
def sine_and_cosine(turns):
    """Return sine and cosine, accurate to 1e-9, of an angle of 0 to 1 turns."""
    quarter = floor(4.0 * turns + 0.5)
    r = (turns - 0.25 * quarter) * (2.0 * math.pi)
    q = r * r
    sine = r * (1 - q * (1 / 6 - q * (1 / 120 - q * (1 / 5040 - q * (1 / 362880)))))
    cosine = 1 - q * (1 / 2 - q * (1 / 24 - q * (1 / 720 - q * (1 / 40320 - q * (1 / 3628800)))))
    odd = (quarter == 1.0) | (quarter == 3.0)
    sine, cosine = select(odd, cosine, sine), select(odd, sine, cosine)
    return (
        select((quarter == 2.0) | (quarter == 3.0), -sine, sine),
        select((quarter == 1.0) | (quarter == 2.0), -cosine, cosine),
    )


@njit(cache=True, error_model="numpy", forceinline=True)
def _part_of_turn(angle):
    """Return the part of a turn, 0 to 1, by which angles in rad exceed whole turns."""
    turns = angle * (0.5 / math.pi)
    return turns - floor(turns)


@overload(math.sin, jit_options=INLINED)
def _sine(angle):
    if angle != lanes:
        return None
    return lambda angle: sine_and_cosine(_part_of_turn(angle))[0]


@overload(math.cos, jit_options=INLINED)
def _cosine(angle):
    if angle != lanes:
        return None
    return lambda angle: sine_and_cosine(_part_of_turn(angle))[1]
