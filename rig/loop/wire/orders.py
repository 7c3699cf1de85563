"""The orders to the loop process, and its answers.

The supervisor numbers the segments. An ordered segment begins when the board's word SWITCH becomes
its number. The segment before it goes on until then, so that exchanges never pause.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from control import COMMAND_LIMIT, PLAIN, POSITION_GAIN, ControlLaw, Guide, LoopBasis, changeable
from estimator.filters import FilterMemory
from rig.io import ChannelLimit, DriverSpec, LoopSettings, TransducerCalibration, Wiring
from rig.loop.interlocks import LimitTable, Tolerances
from rig.loop.reaction import Reaction
from rig.loop.realtime import Grant
from rig.plant import Parameters

from .layout import Course, Drive, Earlier

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Segment:
    """The order of one segment; the answer is its number, once the loop is ready to switch to it.

    Attributes:
        number: number of the segment, greater than those of all earlier ones.
        drive: what the loop does with the valve; only `Drive.TRACK` uses the setpoint.
        memory: the filter's memory, before its first sample.
        assumed: the parameters that the filter assumes.
        setpoint: (ticks,) m, or V in open loop; after its end the loop holds the ram.
        open_loop: whether the setpoint is the valve command.
        gain: gain of the position loop, V/m.
        limit: greatest command of either sign, V.
        guide: what the position loop adds to gain times error while it tracks a setpoint.
        on_fault: the reaction to a confirmed fault.
        offset_m: offset that is added to the encoder's position.
        homed: whether the position is known with that offset; None leaves this as it is.
        valve_enable: whether the valve's relay may close.
        reset_lamp: whether the operator is asked to press the reset button.
        rearm: whether a watchdog that tripped is acknowledged, once in the segment.
        reset: whether an earlier trip is cleared; the supervisor clears its own words before.
        limits: limits that hold in this segment only, beside those of the rig.
        basis: what the tables of the move to the start of a test are made from; None for a move
            without tables.
        locked: whether blocking valves may keep the servovalve's flow from the ram.
    """

    number: int
    drive: Drive
    memory: FilterMemory
    assumed: Parameters
    setpoint: Array = field(default_factory=lambda: np.empty(0))
    open_loop: bool = False
    gain: float = POSITION_GAIN
    limit: float = COMMAND_LIMIT
    guide: Guide = PLAIN
    on_fault: Reaction = Reaction.IGNORE
    offset_m: float = 0.0
    homed: bool | None = None
    valve_enable: bool = False
    reset_lamp: bool = False
    rearm: bool = False
    reset: bool = False
    limits: tuple[ChannelLimit, ...] = ()
    basis: LoopBasis | None = None
    locked: bool = False


@dataclass(frozen=True)
class ChangeControl:
    """The order of another control for a segment; the answer is its number, once it is prepared.

    The loop takes it between two ticks, as soon as the board's word CHANGE becomes its number, and
    says so by CHANGED and CHANGED_AT.

    Attributes:
        number: number of the change, greater than those of all earlier ones in the session.
        segment: number of the segment, which tracks positions.
        gain: gain of the position loop, V/m.
        guide: what the position loop adds to gain times error.
    """

    number: int
    segment: int
    gain: float
    guide: Guide


def course(segment: Segment) -> Course:
    """Return what of a segment the compiled loop needs, in the types for which it is compiled."""
    law, feedforward, tones, expected = _compilable(segment.guide)
    return Course(
        int(segment.number), np.ascontiguousarray(segment.setpoint, np.float64),
        int(segment.drive), bool(segment.open_loop), float(segment.gain), float(segment.limit),
        law, feedforward, expected, tones,
        int(segment.on_fault), float(segment.offset_m), float(segment.valve_enable),
        float(segment.reset_lamp), float(segment.rearm), 0, False,
    )  # fmt: skip


def prepared(change: ChangeControl) -> ChangeControl:
    """Return a change with a law that can go on from another, in the types of the compiled loop."""
    guide = _compilable(changeable(change.guide))
    return replace(change, gain=float(change.gain), guide=guide)


def changed_course(now: Course, change: ChangeControl) -> Course:
    """Return the course that goes on from `now` after a change that is `prepared`."""
    law, feedforward, tones, expected = change.guide
    return now._replace(
        gain=change.gain, law=law, feedforward=feedforward, expected=expected, tones=tones,
        goes_on=True,
    )  # fmt: skip


def control_in(course: Course) -> Earlier:
    """Return the control of a course, before it is changed."""
    guide = Guide(course.law, course.feedforward, course.tones, course.expected)
    return Earlier(course.gain, guide)


def _compilable(guide: Guide) -> Guide:
    law, *tables = guide
    feedforward, tones, expected = (np.ascontiguousarray(each, np.float64) for each in tables)
    return Guide(ControlLaw(bool(law[0]), *map(float, law[1:])), feedforward, tones, expected)


@dataclass(frozen=True)
class Open:
    """The order to open the fast driver; the answer is `Opened`, or the driver's `DriverError`.

    Attributes:
        driver: the fast driver.
        settings: settings of the loop.
        limits: limits of channels, with their actions.
        tolerances: tolerances of the plausibility checks.
        first: the first segment; the loop is compiled for its filter before it starts.
        calibrations: calibrations of the transducers, by which the inputs are corrected.
        wiring: how the rig is wired, which is undone in inputs and command.
    """

    driver: DriverSpec
    settings: LoopSettings
    limits: LimitTable
    tolerances: Tolerances
    first: Segment
    calibrations: tuple[TransducerCalibration, ...] = ()
    wiring: Wiring = field(default_factory=Wiring)


@dataclass(frozen=True)
class Opened:
    """The answer that the device is set up, and the loop runs in the first segment.

    Attributes:
        grants: what the loop asked of the kernel, with the answers.
        rate_hz: number of exchanges in a second.
    """

    grants: tuple[Grant, ...]
    rate_hz: float


@dataclass(frozen=True)
class Close:
    """The order to bring the device to its safe state and to end; the answer is `Closed`."""


@dataclass(frozen=True)
class Closed:
    """The answer of a loop that has ended.

    Attributes:
        failure: why the safe state was not confirmed; empty if it was.
    """

    failure: str = ""
