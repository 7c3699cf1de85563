"""The control law of a running test is changed here without a bump in the command, compiled.

At the tick of a change the old law and the new one are both asked for their command. An offset
makes up for the difference, so that the command goes on from where it was, and fades with `FADE_S`.
What the old law has learnt is kept where it means the same under the new one.
"""

from math import inf, sqrt
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit
from rig.plant import inlined, inner

from .tracking import ControlLaw, ControlMemory, Guide, control_memory, tracking_command

Array = NDArray[np.float64]

FADE_S: Final = 0.5
"""Time constant in s with which the offset of a change fades. It is nearly twice the time constant
of the thesis's loop (1 / 3.5 rad/s), so that the ram follows the fading; and an offset of 10 V, the
limit, fades at first by 20 V/s, which is as fast as a sine of 150 mm at 0.5 Hz moves the command of
that loop (7 V at 3.1 rad/s)."""
_GONE_V: Final = 1e-6
"""Offset in V below which it is 0: far below the step of a converter of 16 bits over 20 V, 0.3 mV.
From then on the command is that of the new law, bit for bit."""
_HALVINGS: Final = 60
"""Steps of halving by which a command is solved for; an interval of 10 V is then below rounding."""


class Steered(NamedTuple):
    """What a control law needs, besides the measured position, to give the command of one tick."""

    gain: float
    """Gain of the position loop, V/m."""
    law: ControlLaw
    """The law's numbers."""
    ahead: float
    """Feedforward of the tick, V."""
    tones: Array
    """(n, TONE_NUMBERS), the setpoint's frequencies that are corrected."""


class Moment(NamedTuple):
    """The tick of a change."""

    setpoint: float
    """Position that is asked for, m."""
    position: float
    """Measured position, m."""
    time_s: float
    """Time of the tick in its motion, s."""
    limit: float
    """Greatest command of either sign, V."""
    period: float
    """Period of the loop, s."""


class ChangeMemory(NamedTuple):
    """What is remembered of the changes of a motion's control law."""

    state: Array
    """(2,): 1 if a change is to be taken over at the next tick, else 0; offset in V that is left of
    the changes so far."""
    scratch: ControlMemory
    """Copy of the control memory, on which a law is tried."""


def change_memory() -> ChangeMemory:
    """Return the memory of a motion whose control law has not been changed."""
    return ChangeMemory(np.zeros(2), control_memory())


def changeable(guide: Guide) -> Guide:
    """Return a guide whose law takes an offset; its commands are the same, bit for bit.

    The proportional law takes none, so it becomes a tracking law that adds nothing to it.
    """
    if not guide.law.proportional:
        return guide
    return guide._replace(law=guide.law._replace(proportional=False))


@njit(cache=True, error_model="numpy", nogil=True)
def forget_changes(change):
    """Make the memory ready for a motion that begins: no change is to come, and no offset left."""
    change.state[0] = 0.0
    change.state[1] = 0.0


@inlined
def is_changing(change):
    """Return whether `offset_of_change` has something to do at this tick."""
    return change.state[0] != 0.0 or change.state[1] != 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def offset_of_change(moment, before, after, memory, change):
    """Return the offset in V that is added to the feedforward at this tick, and let it fade.

    At the tick of a change the offset is set so that the new law's command equals that of the old
    law. If both are beyond the same limit they are equal without it. What was learnt goes on:

    - the integral part is kept within the new law's limit, less what the null was changed by, as
      its integral has learnt what that null was off; a law without integral has none, and the
      offset takes it up;
    - the corrections of frequencies that are corrected under both laws are kept within the new
      limit.

    Args:
        moment: `Moment`, the tick.
        before: `Steered`, the law before the last change.
        after: `Steered`, the present law, which must not be `proportional`.
        memory: `ControlMemory`; updated at the tick of a change only.
        change: `ChangeMemory`; updated.
    """
    state = change.state
    if state[0] != 0.0:
        state[0] = 0.0
        state[1] = _taken_over(moment, before, after, memory, change.scratch, state[1])
    offset = state[1]
    left = offset * max(1.0 - moment.period / FADE_S, 0.0)
    state[1] = left if abs(left) >= _GONE_V else 0.0
    return offset


@inner
def _taken_over(moment, before, after, memory, scratch, offset):
    """Hand what was learnt to the new law; return the offset by which its command is the old one.

    `offset` is what is left of the changes before, V.
    """
    _copy(memory, scratch)
    command = _command(moment, before, offset, moment.limit, scratch)
    _copy(memory, scratch)
    _hand_over(before, after, scratch, memory)
    _copy(memory, scratch)
    if _command(moment, after, 0.0, moment.limit, scratch) == command:
        return 0.0
    _copy(memory, scratch)
    free = _command(moment, after, 0.0, inf, scratch)
    law = after.law
    return _unbent(command - law.null_V, law) - _unbent(free - law.null_V, law)


@inlined
def _command(moment, steered, offset, limit, memory):
    """Return the command in V of a law at a moment, within +-`limit`; the memory is updated.

    What the integral part makes of this tick is in the command of the next one only, so that any
    expected position will do.
    """
    return tracking_command(
        moment.setpoint, moment.position, steered.ahead + offset, moment.setpoint, moment.time_s,
        steered.gain, limit, moment.period, steered.law, steered.tones, memory,
    )  # fmt: skip


@inlined
def _copy(source, target):
    for i in range(source.kept.size):
        target.kept[i] = source.kept[i]
    for i in range(source.learnt.shape[0]):
        target.learnt[i, 0] = source.learnt[i, 0]
        target.learnt[i, 1] = source.learnt[i, 1]


@inlined
def _hand_over(before, after, learnt, memory):
    """Fill the memory with what of the old law's memory `learnt` holds under the new law."""
    old, new = before.law, after.law
    integral = learnt.kept[0]
    if new.integral_rate == 0.0:
        integral = 0.0
    elif old.integral_rate != 0.0:
        integral -= new.null_V - old.null_V
    memory.kept[0] = min(max(integral, -new.integral_limit_V), new.integral_limit_V)
    for i in range(memory.learnt.shape[0]):
        memory.learnt[i, 0] = 0.0
        memory.learnt[i, 1] = 0.0
    for i in range(after.tones.shape[0]):
        for k in range(before.tones.shape[0]):
            if before.tones[k, 0] == after.tones[i, 0]:
                c, s = learnt.learnt[k, 0], learnt.learnt[k, 1]
                size = sqrt(c * c + s * s)
                most = after.tones[i, 3]
                shrunk = most / size if size > most else 1.0
                memory.learnt[i, 0] = shrunk * c
                memory.learnt[i, 1] = shrunk * s


@inlined
def _unbent(bent, law):
    """Return w of w + deadband w / sqrt(w^2 + width^2) = `bent`, all in V, by halving.

    The left side grows with w and is nowhere smaller than w in magnitude, so that w lies between 0
    and `bent`.
    """
    if law.deadband_V == 0.0:
        return bent
    low, high = 0.0, abs(bent)
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        value = middle + law.deadband_V * middle / sqrt(middle * middle + law.width_V * law.width_V)
        if value < abs(bent):
            low = middle
        else:
            high = middle
    return high if bent >= 0.0 else -high
