"""What the loop process is ordered to do, and what it answers.

Segments are numbered by the supervisor. An ordered segment begins when the board's word SWITCH
comes to its number; the one before goes on until then, so that exchanges never pause.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from control import COMMAND_LIMIT, POSITION_GAIN
from estimator.filters import FilterMemory
from rig.io import DriverSpec, LoopSettings
from rig.loop.interlocks import LimitTable, Tolerances
from rig.loop.reaction import Reaction
from rig.loop.realtime import Grant
from rig.plant import Parameters

from .layout import Drive

Array = NDArray[np.float64]


def _no_setpoint() -> Array:
    return np.empty(0)


@dataclass(frozen=True)
class Segment:
    """One segment; the answer is its number, once the loop is ready to switch to it.

    Attributes:
        number: greater than those before.
        drive: what is done with the valve.
        memory: the filter's, before its first sample.
        assumed: the parameters the filter assumes.
        setpoint: (ticks,) m, or V in open loop; the segment holds the ram after its end.
        open_loop: whether the setpoint is the valve command.
        gain: of the position loop, V/m.
        limit: greatest command of either sign, V.
        on_fault: what is done about a confirmed fault.
        offset_m: added to the encoder's position.
        homed: whether the position is known with that offset; None leaves it as it is.
        valve_enable: whether the valve's relay may close.
        reset_lamp: whether the operator is asked for the reset button.
        rearm: whether a watchdog that tripped is acknowledged; once in each segment.
        reset: forget an earlier trip; the supervisor clears its own words first.
    """

    number: int
    drive: Drive
    memory: FilterMemory
    assumed: Parameters
    setpoint: Array = field(default_factory=_no_setpoint)
    open_loop: bool = False
    gain: float = POSITION_GAIN
    limit: float = COMMAND_LIMIT
    on_fault: Reaction = Reaction.IGNORE
    offset_m: float = 0.0
    homed: bool | None = None
    valve_enable: bool = False
    reset_lamp: bool = False
    rearm: bool = False
    reset: bool = False


@dataclass(frozen=True)
class Open:
    """Open the fast driver; the answer is `Opened`, or its `DriverError`.

    Attributes:
        driver: the fast driver.
        settings: of the loop.
        limits: of channels, with their actions.
        tolerances: of the plausibility checks.
        first: the segment to begin with; the loop is compiled for its filter before it starts.
    """

    driver: DriverSpec
    settings: LoopSettings
    limits: LimitTable
    tolerances: Tolerances
    first: Segment


@dataclass(frozen=True)
class Opened:
    """The device is set up, and the loop runs in the first segment.

    Attributes:
        grants: what the kernel gave the loop.
        rate_hz: exchanges in a second.
    """

    grants: tuple[Grant, ...]
    rate_hz: float


@dataclass(frozen=True)
class Close:
    """Leave the device safe and end; the answer is `Closed`."""


@dataclass(frozen=True)
class Closed:
    """How the loop ended.

    Attributes:
        failure: why the safe state was not confirmed; empty if it was.
    """

    failure: str = ""
