"""Effects between the loop's command and the plant: delay, play of the valve, ripple of the pump.

These effects have a memory that is not part of the plant's state: a command that acts late, also by
fractions of a tick (`command_delay`), a spool that follows through play (`valve_hysteresis`), and a
supply pressure that ripples with time (`supply_ripple`). The memory, the command path, is one
float64 array that `command_path` makes and `drive` updates. The simulated loop, `simulate` and fits
call `drive` once a tick. The emulated rig, whose commands come at any time, handles the delay
itself and calls `drive_undelayed`. If none of these effects is switched on, a tick is exactly
`rig.plant.integrator.advance`, to the last bit.
"""

from math import ceil, exp, pi, sin
from typing import Final

import numpy as np
from numpy.typing import NDArray

from .compiled import inlined, inner, with_field
from .integrator import TICK, advance
from .memory_laws import NO_FRACTION, play, whole_ticks
from .parameters import Parameters

Array = NDArray[np.float64]

LONGEST_DELAY_TICKS: Final = 20
_HISTORY: Final = LONGEST_DELAY_TICKS + 1
_TIME, _REFERENCE, _NEWEST, _COMMANDS = range(4)
PATH_SIZE: Final = _COMMANDS + _HISTORY
"""Length of a command path. It holds the time (s), the spool's reference behind the play (m), the
index of the newest command in the history, and the history: the commands of the last 20 ms and the
present one (V)."""

_PIECES: Final = 4
"""Number of parts of the longest integration step in which a supply ripple is followed; with two
such steps a tick, 8 parts a tick."""
_SUPPLY_PRESSURE: Final = Parameters._fields.index("supply_pressure")


def command_path(
    parameters: Parameters, *, spool: float = 0.0, command: float = 0.0, time_s: float = 0.0
) -> Array:
    """Return the memory (`PATH_SIZE`,) of a command path whose command has long been constant.

    Args:
        parameters: parameters of the rig.
        spool: position of the spool, m; the reference starts there, as near as the play allows.
        command: the constant command, V.
        time_s: time of the first tick, s; the phase of a supply ripple counts from time 0.
    """
    path = np.full(PATH_SIZE, float(command))
    path[_TIME], path[_NEWEST] = time_s, 0.0
    half, asked = parameters.valve_hysteresis, parameters.valve_gain * command
    path[_REFERENCE] = play.py_func(spool, asked, half)
    return path


def start_clock(path: Array, time_s: float) -> None:
    """Set the time of a path's next tick to `time_s`, in place; the ripple depends on this time."""
    path[_TIME] = time_s


def hold_reference(path: Array, spool: float) -> None:
    """Set a path's reference behind the play, in place, to the position in m where a spool is held.

    When the spool is free again, it follows the command through the play from there.
    """
    path[_REFERENCE] = spool


@inlined
def command_through_play(path, command, par):
    """Return the command in V that acts on the spool after the valve's play; update the path.

    The spool's reference moves only when the command pushes it at an end of the play. Without play
    the result is the command itself.
    """
    if par.valve_hysteresis == 0.0:
        return command
    path[_REFERENCE] = play(path[_REFERENCE], par.valve_gain * command, par.valve_hysteresis)
    return path[_REFERENCE] / par.valve_gain


@inner
def delayed_command(path, command, delay):
    """Store a command in the path; return the delayed commands that act in this tick.

    Args:
        path: memory of the command path, updated.
        command: command given for this tick, V.
        delay: delay, s, up to `LONGEST_DELAY_TICKS` ticks.

    Returns:
        The command in V that acts at first, the command in V that acts after it, and the time in s
        from the start of the tick at which the second takes over; 0 if it acts from the start.
    """
    newest = (int(path[_NEWEST]) + 1) % _HISTORY
    path[_NEWEST] = newest
    path[_COMMANDS + newest] = command
    whole = int(whole_ticks(delay / TICK))
    late = delay - whole * TICK
    acting = path[_COMMANDS + (newest - whole) % _HISTORY]
    if late < NO_FRACTION * TICK:
        return acting, acting, 0.0
    return path[_COMMANDS + (newest - whole - 1) % _HISTORY], acting, late


@inner
def _rippled(time, step, par):
    """Return the pump pressure in Pa that, if constant over a step, makes the supply ripple.

    The supply line is a first-order lag. It turns the constant pump pressure into an exponential of
    the supply pressure, which equals p_s0 + A sin(2 pi f t + phi) at both ends of the step.

    Args:
        time: start of the step, s.
        step: length of the step, s.
        par: `Parameters`.
    """
    rate = 2.0 * pi * par.supply_ripple_frequency
    kept = exp(-step / par.line_time_constant)
    before = sin(rate * time + par.supply_ripple_phase)
    after = sin(rate * (time + step) + par.supply_ripple_phase)
    held = (after - kept * before) / (1.0 - kept)
    return par.supply_pressure + par.supply_ripple * held


@inner
def _drive_for(state, path, command, par, fault, duration, substeps):
    """Advance plant and path in place over `duration` (s), in which one command (V) acts.

    Play and ripple act, but not the delay.
    """
    driven = command_through_play(path, command, par)
    ripples = par.supply_ripple != 0.0
    supply, pieces, steps = par.supply_pressure, 1, substeps
    if ripples:
        pieces = max(ceil(_PIECES * substeps * duration / TICK - 1e-9), 1)
        steps = 1
    span = duration / pieces
    for _ in range(pieces):
        if ripples:
            supply = _rippled(path[_TIME], span, par)
            path[_TIME] += span
        # The field is always replaced: a choice between two versions would cost more.
        acting = with_field(par, _SUPPLY_PRESSURE, supply)
        advance(state, driven, acting, fault, span, steps)


@inner
def _drive_delayed(state, path, command, par, fault, substeps):
    """Advance plant and path in place by a tick in which an earlier command may act at first."""
    before, following, late = delayed_command(path, command, par.command_delay)
    if late > 0.0:
        _drive_for(state, path, before, par, fault, late, substeps)
    _drive_for(state, path, following, par, fault, TICK - late, substeps)


@inlined
def drive_undelayed(state, path, command, par, fault, duration, substeps):
    """Advance plant and path in place over `duration` (s), in which one command (V) acts.

    Play and ripple act, but not the delay. The other arguments are as in `drive`; without a ripple,
    `substeps` is the least number of integration steps over `duration`.
    """
    if (par.valve_hysteresis != 0.0) | (par.supply_ripple != 0.0):
        _drive_for(state, path, command, par, fault, duration, substeps)
    else:
        # int() hides a caller's literal from the compiler, which would compile `advance` once more
        # for it than for the number of `_drive_for`.
        advance(state, command, par, fault, duration, int(substeps))


@inlined
def drive(state, path, command, par, fault, substeps):
    """Advance plant and command path in place by one tick; loop, simulation and fits all use this.

    Args:
        state: float64 (9,), in the order of `PlantState`, updated.
        path: float64 (`PATH_SIZE`,), made by `command_path`, updated.
        command: command that the loop gives for this tick, V.
        par: `Parameters`.
        fault: 8 fault coefficients in the order of `FaultInput` (SI).
        substeps: least number of integration steps in a tick.
    """
    if par.command_delay != 0.0:
        _drive_delayed(state, path, command, par, fault, substeps)
    else:
        drive_undelayed(state, path, command, par, fault, TICK, substeps)
