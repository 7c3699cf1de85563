"""The ladder of actions, every cause that can lead to one, and the limits of channels.

The number of a cause is used on the board and in recordings, so that it must never be given to
another cause.
"""

from collections.abc import Iterable, Iterator
from enum import IntEnum
from math import isinf
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from faults import FOLLOWING_ERROR, LimitBand, TestLimit
from rig.io import ALWAYS, FAST_INPUTS, ChannelLimit, Response

NO_CHANNEL: Final = -1
"""Number in place of a channel's index in `FAST_INPUTS`, if a cause concerns no channel."""


ERROR_AT: Final = len(FAST_INPUTS)
"""Index, in place of one in `FAST_INPUTS`, of the following error, which no device measures."""

LIMITED: Final = (*FAST_INPUTS, FOLLOWING_ERROR)
"""Names of what may have a limit in the loop."""


class Action(IntEnum):
    """What the interlock does about a cause; of several actions the highest is taken."""

    NONE = 0
    INDICATE = 1
    """The cause is shown and recorded; the motion goes on."""
    HOLD = 2
    """The ram is held where it is, within its limits; the valve stays enabled."""
    RAMP_DOWN = 3
    """The motion is brought to rest along a ramp, then the valve is disabled."""
    TRIP = 4
    """The valve is nulled and disabled, bypasses shut, the pump unloaded; latched until reset."""


class Cause(IntEnum):
    """The causes for which a part of a session takes an action; `EXPLANATIONS` explains each."""

    NONE = 0
    LIMIT_LOW = 1
    LIMIT_HIGH = 2
    STALE_SAMPLE = 3
    SENSOR_NAN = 4
    SENSOR_RANGE = 5
    SENSOR_FROZEN = 6
    ENCODER_FROZEN = 7
    ENCODER_JUMP = 8
    ENCODER_FAULT = 9
    POSITION_AGAINST_FLOW = 10
    PRESSURE_ABOVE_SUPPLY = 11
    PRESSURES_CROSSED = 12
    SPOOL_NOT_FOLLOWING = 13
    DEVICE_STOPPED = 14
    DEVICE_DEAF = 15
    COMMAND_ECHO = 16
    FOREIGN_MASTER = 17
    ESTOP_OPEN = 20
    WATCHDOG_TRIPPED = 21
    VALVE_NOT_ENABLED = 22
    NOT_HOMED = 23
    HOMING_FORCE = 24
    HOMING_FAILED = 25
    OVERRUN = 30
    EXCHANGE_LOST = 31
    LOOP_LOST = 32
    FIELD_LOST = 33
    SUPERVISOR_LOST = 34
    RECORDER_LOST = 35
    DISK_FULL = 36
    CRASH = 37
    BYPASS_STUCK = 40
    BYPASS_LOST = 41
    DRIVE_FAULT = 42
    DRIVE_LOST = 43
    PUMP_FAULT = 44
    PUMP_LOST = 45
    METERS_LOST = 46
    BLOCKING_STUCK = 47
    NULL_NOT_CONFIRMED = 50
    BYPASS_NOT_SHUT = 51
    PUMP_NOT_UNLOADED = 52
    OPERATOR_STOP = 60
    FAULT_CONFIRMED = 70
    TEST_LIMIT = 71


class Explanation(NamedTuple):
    """A text for the operator that explains a cause; `{channel}` stands for the channel's name."""

    sentence: str
    """What is wrong, without a capital letter or a full stop."""
    remedy: str
    """What the operator is to do, written likewise."""


def channel_name(index: int) -> str:
    """Return the name of the channel with an index in `LIMITED`; empty for `NO_CHANNEL`."""
    return "" if index == NO_CHANNEL else LIMITED[index]


_E = Explanation


def _silent(part: str, key: str) -> Explanation:
    """Return the explanation of a part whose beat is older than the rig file's key allows."""
    return Explanation(
        f"{part} gives no sign of life",
        "read session.log in the run's folder, if it has one; if it names no error, other programs "
        f"kept the part waiting for longer than `{key}` of the rig file; then start again",
    )


EXPLANATIONS: Final = {
    Cause.NONE: _E("nothing is wrong", "none needed"),
    Cause.LIMIT_LOW: _E(
        "{channel} is below its limit",
        "find out why, or correct the limit in the rig or campaign file",
    ),
    Cause.LIMIT_HIGH: _E(
        "{channel} is above its limit",
        "find out why, or correct the limit in the rig or campaign file",
    ),
    Cause.STALE_SAMPLE: _E(
        "no fresh sample came within the stale limit",
        "check the I/O device and its network; raise stale_limit only if the motion allows it",
    ),
    Cause.SENSOR_NAN: _E("{channel} has no value", "check the transducer, its cable and supply"),
    Cause.SENSOR_RANGE: _E(
        "{channel} stands at the end of its transducer's range",
        "check the transducer, its cable and its range in the rig file",
    ),
    Cause.SENSOR_FROZEN: _E(
        "{channel} repeats the same value where noise must show",
        "restart the I/O device; check the transducer",
    ),
    Cause.ENCODER_FROZEN: _E(
        "the encoder stands still while the valve's flow moves the ram",
        "check the encoder, its coupling and cable, then home again",
    ),
    Cause.ENCODER_JUMP: _E(
        "the encoder jumped farther than the valve can move the ram",
        "check the encoder's cable and shield, then home again",
    ),
    Cause.ENCODER_FAULT: _E(
        "the device reports that the encoder lost counts",
        "check the encoder's cable and speed rating, then home again",
    ),
    Cause.POSITION_AGAINST_FLOW: _E(
        "the position does not move as the valve's flow moves the ram",
        "check the encoder's direction and scale, the valve's hoses and the pressure lines",
    ),
    Cause.PRESSURE_ABOVE_SUPPLY: _E(
        "{channel} stays above the supply pressure",
        "check the supply pressure, whether the pump unloads by itself, and the lines of the "
        "transducers",
    ),
    Cause.PRESSURES_CROSSED: _E(
        "the chamber pressures push against the motion that they make",
        "the pressure transducers, the hoses or the encoder are crossed: correct the wiring",
    ),
    Cause.SPOOL_NOT_FOLLOWING: _E(
        "the spool does not follow the command",
        "check the valve's plug and pilot supply; the spool may be stuck",
    ),
    Cause.DEVICE_STOPPED: _E(
        "the I/O device answers, but takes no new samples", "restart the I/O device"
    ),
    Cause.DEVICE_DEAF: _E(
        "the I/O device answers, but does not take what is written",
        "check that no other program holds the device; restart it",
    ),
    Cause.COMMAND_ECHO: _E(
        "the valve output is not at the command that was sent",
        "check the output's range and wiring; restart the I/O device",
    ),
    Cause.FOREIGN_MASTER: _E(
        "another master writes to the I/O device, or owns it",
        "end the other program that drives the I/O device",
    ),
    Cause.ESTOP_OPEN: _E(
        "the emergency stop is open", "make the rig safe, release the button, press reset"
    ),
    Cause.WATCHDOG_TRIPPED: _E(
        "the I/O device's watchdog tripped: it missed our exchanges",
        "see the stage timings for what stalled, then reset",
    ),
    Cause.VALVE_NOT_ENABLED: _E(
        "the valve is not enabled although it should be",
        "check the emergency stop chain and the enable relay, then reset",
    ),
    Cause.NOT_HOMED: _E(
        "the ram was driven harder than is allowed before homing", "home the rig first"
    ),
    Cause.HOMING_FORCE: _E(
        "the ram pushed harder than is allowed before homing",
        "look what blocks the ram; friction may have grown",
    ),
    Cause.HOMING_FAILED: _E(
        "the homing run found no repeatable stroke end",
        "read its reason; check encoder, supply pressure and valve null, then home again",
    ),
    Cause.OVERRUN: _E(
        "the loop missed more ticks than its overrun policy allows",
        "run rig doctor; close other programs or lower the rate",
    ),
    Cause.EXCHANGE_LOST: _E(
        "the connection to the I/O device is lost", "check its power, cable and address"
    ),
    Cause.LOOP_LOST: _silent("the loop process", "loop_silence"),
    Cause.FIELD_LOST: _silent("the field process", "field_silence"),
    Cause.SUPERVISOR_LOST: _silent("the supervisor", "supervisor_silence"),
    Cause.RECORDER_LOST: _silent("the recorder", "recorder_silence"),
    Cause.DISK_FULL: _E(
        "the recording cannot be written: the disk is full",
        "free space, or have it written to another disk",
    ),
    Cause.CRASH: _E("the software failed", "read the traceback in the run's folder; report it"),
    Cause.BYPASS_STUCK: _E(
        "a bypass valve did not reach its position in time",
        "check its air or power, and its position switches",
    ),
    Cause.BYPASS_LOST: _E(
        "the connection to the bypass valves is lost", "check their power, cable and address"
    ),
    Cause.DRIVE_FAULT: _E(
        "the valve drive reports a fault", "read its fault code (DS408), remove the cause, reset"
    ),
    Cause.DRIVE_LOST: _E(
        "the valve drive is silent on the CAN bus", "check its power, node number and bus"
    ),
    Cause.PUMP_FAULT: _E(
        "the pump unit reports a fault", "read its panel: oil level, temperature, filter"
    ),
    Cause.PUMP_LOST: _E(
        "the pump unit is silent on the CAN bus", "check its power, bus and DBC file"
    ),
    Cause.METERS_LOST: _E(
        "the flow meters are silent", "check their power, and that the serial port is theirs"
    ),
    Cause.BLOCKING_STUCK: _E(
        "a blocking valve did not reach its position in time, or left it",
        "check its air or power, and its switches; a chamber may be locked with its pressure: "
        "relieve it by hand before anybody opens a line",
    ),
    Cause.NULL_NOT_CONFIRMED: _E(
        "the device did not confirm that the valve is at null and disabled",
        "press the emergency stop; do not approach the ram",
    ),
    Cause.BYPASS_NOT_SHUT: _E(
        "the bypass valves did not confirm that they are shut", "shut their hand valves"
    ),
    Cause.PUMP_NOT_UNLOADED: _E(
        "the pump unit did not confirm that it is unloaded", "switch the pump off by hand"
    ),
    Cause.OPERATOR_STOP: _E("the operator stopped the run", "start again when ready"),
    Cause.FAULT_CONFIRMED: _E(
        "the detector confirmed a fault, and the test asks to trip on one",
        "read the verdict, find the fault and mend it; a campaign that injects faults has another "
        "on_fault",
    ),
    Cause.TEST_LIMIT: _E(
        "a slow channel or a figure is beyond a limit of the test",
        "find out why, or correct the limit in the campaign file",
    ),
}
"""The explanation of every cause, as the operator is shown it."""


def explain(cause: Cause, channel: str = "") -> Explanation:
    """Return sentence and remedy that explain a cause to the operator.

    `channel` is the name that stands for the channel in the sentence; "a channel" if it is empty.
    """
    sentence, remedy = EXPLANATIONS[cause]
    return Explanation(sentence.format(channel=channel or "a channel"), remedy)


class LimitTable(NamedTuple):
    """Limits as arrays (n,) for compiled code, in the order in which they were given.

    Several limits of one channel, which differ in range or time, make its ladder.
    """

    channel: NDArray[np.int64]
    """Index in `LIMITED`."""
    low: NDArray[np.float64]
    """Least value allowed, SI; -inf for no limit."""
    high: NDArray[np.float64]
    """Greatest value allowed, SI; inf for no limit."""
    hysteresis: NDArray[np.float64]
    """How far back within the range the value must come for the action to end, SI."""
    action: NDArray[np.int64]
    """`Action` that is taken outside the limit."""
    ticks: NDArray[np.int64]
    """Number of ticks in a row outside the limit at which the action is taken, at least 1."""
    begin: NDArray[np.int64]
    """Index in the segment's setpoints from which the limit holds."""
    end: NDArray[np.int64]
    """Index in the segment's setpoints before which it ends to hold."""


_ALWAYS: Final = np.iinfo(np.int64)


def limit_table(limits: Iterable[ChannelLimit], period_s: float) -> LimitTable:
    """Return limits as a table for a loop whose period is `period_s`.

    Raises:
        ValueError: a limit's channel is unknown, or its low end is not below its high one.
    """
    rows = tuple(limits)
    for row in rows:
        if row.channel not in LIMITED:
            raise ValueError(f"limit of {row.channel!r}: no such channel; name one of LIMITED")
        if not row.low < row.high:
            raise ValueError(f"limit of {row.channel}: low {row.low:g} is not below {row.high:g}")
    ticks = [1 + round(row.for_s / period_s) for row in rows]
    return LimitTable(
        np.array([LIMITED.index(row.channel) for row in rows], np.int64),
        np.array([row.low for row in rows], np.float64),
        np.array([row.high for row in rows], np.float64),
        np.array([row.hysteresis for row in rows], np.float64),
        np.array([Action[row.action.upper()] for row in rows], np.int64),
        np.array(ticks, np.int64),
        np.array([_place(row.from_s, period_s) for row in rows], np.int64),
        np.array([_place(row.until_s, period_s) for row in rows], np.int64),
    )


def _place(time_s: float, period_s: float) -> int:
    """Return the index of the setpoint at a time in s; the least or greatest one if infinite."""
    if isinf(time_s):
        return int(_ALWAYS.max if time_s > 0.0 else _ALWAYS.min)
    return round(time_s / period_s)


def rungs_of(limits: Iterable[TestLimit]) -> tuple[ChannelLimit, ...]:
    """Return the limits of a test that the loop judges, as the rungs of a rig's ladder.

    These are the limits of channels that the loop samples, and of the following error: the inner
    band of each is indicated, and the outer one acted on. The runner judges the others.
    """
    return tuple(rung for rung, _, _ in rungs_with_bands(limits))


def rungs_with_bands(
    limits: Iterable[TestLimit],
) -> Iterator[tuple[ChannelLimit, TestLimit, LimitBand]]:
    """Yield the rungs of `rungs_of` in their order, each with the limit and band that it judges.

    A band that holds in several stretches of the test has a rung for each of them.
    """
    for limit in limits:
        if limit.watched not in LIMITED:
            continue
        for band in limit.bands:
            response: Response = "indicate" if band.action == "warn" else band.action
            for from_s, until_s in limit.windows_s or (ALWAYS,):
                rung = ChannelLimit(
                    limit.watched, band.low, band.high, response, limit.for_s, limit.hysteresis,
                    from_s, until_s,
                )  # fmt: skip
                yield rung, limit, band
