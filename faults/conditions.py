"""Conditions of a campaign: while one does not hold, the campaign is held, then it goes on."""

from dataclasses import dataclass
from enum import StrEnum
from math import inf


class WhenUnmet(StrEnum):
    """What becomes of a test that runs when its campaign is held."""

    FINISH = "finish"
    """The test comes to its end first."""
    INTERRUPT = "interrupt"
    """The test ends at once, with the ram held, and is run again."""


@dataclass(frozen=True)
class Condition:
    """Limits of a channel between which a campaign may run; SI units by the channel's name.

    Attributes:
        channel: a signal that the rig measures.
        low, high: the campaign is held while the channel is beyond one of them.
        hysteresis: by how much the channel must be back within before the campaign goes on.
        for_s: how long the channel must have been beyond its limits, or back within them.
        action: what becomes of a test that runs.
        give_up_s: how long the campaign may be held before it is stopped.
    """

    channel: str
    low: float = -inf
    high: float = inf
    hysteresis: float = 0.0
    for_s: float = 1.0
    action: WhenUnmet = WhenUnmet.FINISH
    give_up_s: float = 3600.0
