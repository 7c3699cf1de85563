"""What must hold of the rig while a campaign runs; else it is held, and goes on by itself."""

from dataclasses import dataclass
from enum import StrEnum
from math import inf


class WhenUnmet(StrEnum):
    """What becomes of a test that runs as its campaign is held."""

    FINISH = "finish"
    """It comes to its end first."""
    INTERRUPT = "interrupt"
    """It ends at once, with the ram held, and is run again."""


@dataclass(frozen=True)
class Condition:
    """Limits of a channel between which a campaign may run; SI units by the channel's name.

    Attributes:
        channel: a signal that the rig measures.
        low, high: it holds while beyond one of them.
        hysteresis: by how much the channel must be back within before the campaign goes on.
        for_s: how long it must have been beyond, or be back.
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
