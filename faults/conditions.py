"""Conditions of a campaign; while one is not met, the campaign is held, and then it goes on."""

from dataclasses import dataclass
from enum import StrEnum
from math import inf


class WhenUnmet(StrEnum):
    """What happens to the running test when its campaign is held."""

    FINISH = "finish"
    """The test is run to its end before the campaign is held."""
    INTERRUPT = "interrupt"
    """The test is ended at once, with the ram held in place, and is run again later."""


@dataclass(frozen=True)
class Condition:
    """Limits of a channel within which a campaign may run; in the unit of the channel's name.

    Attributes:
        channel: name of a signal that the rig measures.
        low, high: limits; the campaign is held while the channel is below `low` or above `high`.
            An infinite limit is never passed.
        hysteresis: distance inside the limits that the channel must reach for the campaign to go
            on.
        for_s: time in s for which the channel must be beyond its limits before the campaign is
            held, and back within them before it goes on.
        action: what happens to the running test.
        give_up_s: time in s after which a held campaign is stopped.
    """

    channel: str
    low: float = -inf
    high: float = inf
    hysteresis: float = 0.0
    for_s: float = 1.0
    action: WhenUnmet = WhenUnmet.FINISH
    give_up_s: float = 3600.0
