"""What remembers a quantity: a lag, a resonance and a play, of which a disturbance is a multiple.

All follow a quantity q(t), each in its own way. A lag with the time constant T follows it as
T y' = q - y, a resonance with the frequency f and the damping ratio d as
y'' = w^2 (q - y) - 2 d w y' with w = 2 pi f. A play of half the width h stays until q has come
further than h from it, and is then pulled along (the play operator, Krasnosel'skii and Pokrovskii
1989). A disturbance is a size times y - q, by how much the follower is behind; that of a resonance
also has a second size times y' / w. So a disturbance that enters an equation can stand for a filter
on a path (the command reaches the valve as y and not as q), for a mass on a spring (the spring's
force), for oil in a dead end (what flows into it), and for a contact that gives way like a spring
until it slides (its force). In a reading a play is a gauge or a linkage that sticks.

A follower is at rest at the first sample. From sample to sample it is advanced exactly for a
quantity that stays at the mean of its values before and after, which a command does and a state
nearly does. The disturbance of a sample is that of its middle, to second order.
"""

from math import cos, exp, isnan, pi, sin, sqrt
from typing import Final

import numpy as np
from numba import float64, int64, types, void
from numpy.typing import NDArray

from rig.jit import njit
from rig.plant import inlined

from .interface import Array

FOLLOWED: Final = 3
"""Number of values of a follower: y, y', and the rate of the quantity in the sample before."""
_LAG, _RESONANCE, _PLAY = range(3)
_KINDS: Final = {"lag": _LAG, "resonance": _RESONANCE, "play": _PLAY}
"""Numbers of the forms in compiled code."""


@inlined
def lag_behind(quantity, constant, period, follower):
    """Return y - q of a lag in the middle of a sample; 0 before its first sample.

    Args:
        quantity: the quantity at the beginning of the sample.
        constant: time constant, s.
        period: sampling period, s.
        follower: float64 (FOLLOWED,).
    """
    if isnan(follower[0]):
        return 0.0
    apart = follower[0] - quantity
    half = 0.5 * period / constant
    return apart * (1.0 - half + 0.5 * half * half) - 0.5 * period * follower[2]


@inlined
def resonance_behind(quantity, frequency, damping, period, follower):
    """Return y - q and y' / w of a resonance in the middle of a sample; 0 before its first sample.

    Args:
        quantity: the quantity at the beginning of the sample.
        frequency: Hz.
        damping: damping ratio.
        period: sampling period, s.
        follower: float64 (FOLLOWED,).
    """
    if isnan(follower[0]):
        return 0.0, 0.0
    w, half = 2.0 * pi * frequency, 0.5 * period
    apart, rate = follower[0] - quantity, follower[1]
    faster = -w * w * apart - 2.0 * damping * w * rate
    middle = apart + half * (rate - follower[2]) + 0.5 * half * half * faster
    return middle, (rate + half * faster) / w


@inlined
def play_behind(quantity, half, follower):
    """Return y - q of a play at the beginning of a sample; 0 before its first sample.

    Args:
        quantity: the quantity at the beginning of the sample.
        half: half the width of the play, in the quantity's unit.
        follower: float64 (FOLLOWED,).
    """
    if isnan(follower[0]):
        return 0.0
    return min(max(follower[0] - quantity, -half), half)


@inlined
def _begin(quantity, follower):
    """Let a follower be at rest, if this is its first sample."""
    if isnan(follower[0]):
        follower[0] = quantity
        follower[1] = 0.0


@njit(void(float64, float64, float64, float64, float64[::1]), cache=True, error_model="numpy")
def follow_lag(before, after, constant, period, follower):
    """Advance a lag in place by one sample.

    Args:
        before: the quantity at the beginning of the sample.
        after: the quantity at its end.
        constant: time constant, s.
        period: sampling period, s.
        follower: float64 (FOLLOWED,); NaN before the first sample.
    """
    _begin(before, follower)
    mean = 0.5 * (before + after)
    follower[0] = mean + (follower[0] - mean) * exp(-period / constant)
    follower[2] = (after - before) / period


@njit(
    void(float64, float64, float64, float64, float64, float64[::1]), cache=True, error_model="numpy"
)
def follow_resonance(before, after, frequency, damping, period, follower):
    """Advance a resonance in place by one sample.

    Args:
        before: the quantity at the beginning of the sample.
        after: the quantity at its end.
        frequency: Hz.
        damping: damping ratio, at least 0 and less than 1.
        period: sampling period, s.
        follower: float64 (FOLLOWED,); NaN before the first sample.
    """
    _begin(before, follower)
    mean = 0.5 * (before + after)
    w = 2.0 * pi * frequency
    damped = w * sqrt(1.0 - damping * damping)
    apart, rate = follower[0] - mean, follower[1]
    decay = exp(-damping * w * period)
    c, s = cos(damped * period), sin(damped * period) / damped
    follower[0] = mean + decay * (apart * c + (rate + damping * w * apart) * s)
    follower[1] = decay * (rate * c - (w * w * apart + damping * w * rate) * s)
    follower[2] = (after - before) / period


@njit(void(float64, float64, float64, float64[::1]), cache=True, error_model="numpy")
def follow_play(before, after, half, follower):
    """Advance a play in place by one sample.

    Args:
        before: the quantity at the beginning of the sample.
        after: the quantity at its end.
        half: half the width of the play, in the quantity's unit.
        follower: float64 (FOLLOWED,); NaN before the first sample.
    """
    _begin(before, follower)
    follower[0] = min(max(follower[0], after - half), after + half)


@njit(
    void(
        float64[::1], int64[::1], float64, float64, int64, types.boolean, float64,
        float64[:, ::1],
    ),
    cache=True, error_model="numpy",
)  # fmt: skip
def _follow(quantity, starts, at, by, kind, held, period, found):
    follower = np.full(FOLLOWED, np.nan)
    for t in range(quantity.size):
        if starts[t] == 1:
            follower[:] = np.nan
        x = quantity[t]
        last = t + 1 == quantity.size or starts[t + 1] == 1
        after = x if held or last else quantity[t + 1]
        if kind == _RESONANCE:
            found[t, 0], found[t, 1] = resonance_behind(x, at, by, period, follower)
            follow_resonance(x, after, at, by, period, follower)
        elif kind == _PLAY:
            found[t, 0] = play_behind(x, at, follower)
            follow_play(x, after, at, follower)
        else:
            found[t, 0] = lag_behind(x, at, period, follower)
            follow_lag(x, after, at, period, follower)


def memory_columns(
    form: str,
    at: tuple[float, ...],
    quantity: Array,
    starts: NDArray[np.int64],
    period: float,
    held: bool,
) -> Array:
    """Return the disturbance for each size of what remembers, with this size 1, (n, sizes).

    Args:
        form: "lag", "resonance" or "play".
        at: its time constant, s; its frequency, Hz, and damping ratio; or half its width.
        quantity: float64 (n,), what is followed, in stretches of samples.
        starts: int64 (n,), 1 where a stretch begins: the follower is at rest there.
        period: sampling period, s.
        held: whether the quantity stays as it is from sample to sample, as a command does.
    """
    kind = _KINDS[form]
    first, second = (*at, 0.0)[:2]
    found = np.empty((len(quantity), 2 if kind == _RESONANCE else 1))
    _follow(np.array(quantity, dtype=np.float64), starts, first, second, kind, held, period, found)
    return found
