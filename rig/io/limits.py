"""A limit of a channel as configured: between which values, how long beyond them, and what then."""

from dataclasses import dataclass
from math import inf
from typing import Literal

Response = Literal["indicate", "hold", "ramp_down", "trip"]
"""What a channel beyond its limit calls for, mildest first: inform the operator, hold the position,
bring the motion to rest, or leave at once for the safe state (`rig.loop.interlocks.ladder` carries
it out)."""


@dataclass(frozen=True)
class ChannelLimit:
    """One rung of the action ladder of a channel.

    A value at the limit is within it. NaN is no value and exceeds nothing: that values are fresh
    and plausible is watched elsewhere.

    Attributes:
        channel: name in FAST_INPUTS of `rig.io.signals`: limits act in the loop.
        low: least value allowed, SI.
        high: greatest value allowed, SI.
        action: what to do beyond them.
        for_s: time in s that the value must stay beyond before anything is done; 0: one sample.
        hysteresis: how far back within it must be for the action to end, SI.
    """

    channel: str
    low: float = -inf
    high: float = inf
    action: Response = "trip"
    for_s: float = 0.0
    hysteresis: float = 0.0
