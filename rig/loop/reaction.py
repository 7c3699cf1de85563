"""The loop's reaction to a confirmed fault, compiled; it is the same on every backend.

The loop acts upon a decision only while it is fresh: if the detector is late or gone, the loop goes
back to the proportional command by itself. A hold or a trip, once begun, lasts to the test's end.
"""

from enum import IntEnum
from math import nan
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control import TOLERANT_STATE, tolerant_command
from rig.jit import njit
from rig.plant import inlined

from .decided import Decided

Array = NDArray[np.float64]

STALE_S: Final = 2.0
"""Age in s of a decision's newest sample beyond which the loop does not act upon it. A decision is
due every half second, so that the detector has missed three by then."""

ACTED: Final = ("fault_action", "compensation_V")
"""Columns of a row: the present `Reaction`, and what it adds to the proportional command."""


class Reaction(IntEnum):
    """The reactions to a confirmed fault; a test asks for one, and rows record the present one."""

    IGNORE = 0
    """The loop does nothing; the fault is only recorded."""
    TOLERATE = 1
    """The position loop compensates for leaks that are confirmed to be there now."""
    HOLD = 2
    """The ram is held where it is until the end of the test."""
    TRIP = 3
    """The rig trips, as for any other cause."""


_IGNORE, _TOLERATE, _HOLD, _ = (int(reaction) for reaction in Reaction)
_AT_S, _, _CONFIRMED, _PRESENT = (int(index) for index in Decided)
_PRESSURE_1: Final = 1
_PRESSURE_2: Final = 2
"""Indices of the two chamber pressures among the states of every filter."""


class ReactionMemory(NamedTuple):
    """The memory of the reaction from tick to tick; each test begins with `forget`."""

    acted: Array
    """(len(ACTED),): the columns `ACTED` of the present tick."""
    held_at: Array
    """(1,): position in m at which a simulated ram is held; NaN while it is not held."""
    tolerant: Array
    """(TOLERANT_STATE,): state of `control.tolerant.tolerant_command`."""


def reaction_memory() -> ReactionMemory:
    """Return the memory of a test that begins."""
    return ReactionMemory(np.zeros(len(ACTED)), np.full(1, nan), np.zeros(TOLERANT_STATE))


@njit(cache=True, error_model="numpy", nogil=True)
def forget(memory):
    """Reset the memory in place, for a test that begins."""
    memory.acted[:] = 0.0
    memory.held_at[:] = nan
    memory.tolerant[:] = 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def react(asked, decided, time_s, memory):
    """Return the `Reaction` at a tick, and store it in `memory.acted` with a compensation of 0 V.

    A hold or a trip that has begun goes on. Otherwise the reaction is the one that is asked for, if
    the decision is not older than `STALE_S` and confirms a fault; for TOLERATE it must confirm a
    leak that is there now. In all other cases the reaction is IGNORE.

    Args:
        asked: `Reaction` that the test asks for.
        decided: (len(DECIDED),) the newest decision, NaN before the first.
        time_s: time of the tick in the test, s.
        memory: `ReactionMemory`; updated.
    """
    action = int(memory.acted[0])
    if action < _HOLD:
        action = _IGNORE
        # Without a decision the time is NaN, so that this is False.
        fresh = time_s - decided[_AT_S] <= STALE_S
        if fresh and asked == _TOLERATE:
            if leaks_now(decided):
                action = _TOLERATE
        elif fresh and asked >= _HOLD and decided[_CONFIRMED] == 1.0:
            action = asked
    memory.acted[0] = action
    memory.acted[1] = 0.0
    return action


@inlined
def leaks_now(decided):
    """Return whether a decision confirms that a leak is there now."""
    return decided[_PRESENT] > 0.0 or decided[_PRESENT + 1] > 0.0 or decided[_PRESENT + 2] > 0.0


@njit(cache=True, error_model="numpy", nogil=True)
def tolerating(command, asked, decided, x, par, limit, period, memory):
    """Return the position loop's command in V, with a compensation for leaks that are there now.

    It must be called at every tick.

    Args:
        command: the proportional command, V; it is returned unchanged unless the test asks to
            tolerate leaks and one is, or has just been, confirmed.
        asked: `Reaction` that the test asks for.
        decided: (len(DECIDED),) the newest decision.
        x: the filter's state.
        par: the `Parameters` that the filter assumes.
        limit: greatest command of either sign, V.
        period: period of the loop, s.
        memory: `ReactionMemory` after `react` of this tick; updated, with the compensation in V in
            `acted`.
    """
    if asked != _TOLERATE:
        return command
    leaks = (0.0, 0.0, 0.0)
    if memory.acted[0] == _TOLERATE:
        leaks = (decided[_PRESENT], decided[_PRESENT + 1], decided[_PRESENT + 2])
    made_up = tolerant_command(
        command, leaks, x[_PRESSURE_1], x[_PRESSURE_2], par, limit, period, memory.tolerant
    )
    memory.acted[1] = made_up - command
    return made_up
