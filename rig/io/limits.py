"""A limit of a channel as it is configured: a range of values, and what happens beyond it."""

from dataclasses import dataclass
from math import inf
from typing import Final, Literal

Response = Literal["indicate", "hold", "ramp_down", "trip"]
"""What is done when a channel is beyond its limit, mildest first: inform the operator, hold the
position, bring the motion to rest, or go to the safe state at once (`Action` in
`rig.loop.interlocks.ladder`)."""


ALWAYS: Final = (-inf, inf)
"""The stretch of a limit that holds everywhere, s."""


@dataclass(frozen=True)
class ChannelLimit:
    """One rung of a channel's ladder: a range of values, and the action that is taken beyond it.

    A value equal to a limit is within the range. NaN is never beyond it, because other checks watch
    whether values are fresh and plausible.

    Attributes:
        channel: name of the channel, one of FAST_INPUTS in `rig.io.signals`, since limits act in
            the loop.
        low: least value allowed, SI.
        high: greatest value allowed, SI.
        action: what is done when the value is beyond the range.
        for_s: time in s that the value must stay beyond the range before the action is taken; with
            0 one sample is enough.
        hysteresis: how far back within the range the value must come for the action to end, SI.
        from_s, until_s: where in the segment's motion it holds, s; everywhere unless given.
    """

    channel: str
    low: float = -inf
    high: float = inf
    action: Response = "trip"
    for_s: float = 0.0
    hysteresis: float = 0.0
    from_s: float = -inf
    until_s: float = inf
