"""What lies between the loop's command and the plant: delay, play of the valve, ripple of the pump.

Effects with a memory of their own, which the plant's state leaves out: a command that acts late, by
fractions of a tick too (`command_delay`), a spool that follows through play (`valve_hysteresis`),
and a supply that ripples with time (`supply_ripple`). The memory is one float64 array, made by
`command_path` and moved by `drive`; the simulated loop, `simulate` and fits call `drive` once a
tick. The emulated rig, whose commands come at any time, keeps the delay itself and calls
`drive_undelayed`. Where none of these effects acts, a tick is `rig.plant.integrator.advance`, to
the last bit.
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
"""Numbers of a command path: time (s), the spool's reference behind the play (m), which command of
the history is the newest, and the commands of the last 20 ms and of now (V)."""

_PIECES: Final = 4
"""Parts of the longest step in which a rippling supply is followed; 8 of a tick."""
_SUPPLY_PRESSURE: Final = Parameters._fields.index("supply_pressure")


def command_path(
    parameters: Parameters, *, spool: float = 0.0, command: float = 0.0, time_s: float = 0.0
) -> Array:
    """Return the memory (`PATH_SIZE`,) of a path whose command has long been the same.

    Args:
        parameters: of the rig.
        spool: where the spool is, m; its reference rests there, as near as the play allows.
        command: that acts, V.
        time_s: of the first tick, to which the ripple's phase is counted from 0.
    """
    path = np.full(PATH_SIZE, float(command))
    path[_TIME], path[_NEWEST] = time_s, 0.0
    half, asked = parameters.valve_hysteresis, parameters.valve_gain * command
    path[_REFERENCE] = play.py_func(spool, asked, half)
    return path


def start_clock(path: Array, time_s: float) -> None:
    """Let the next tick of a path be at `time_s`, from which the ripple's phase is counted."""
    path[_TIME] = time_s


def hold_reference(path: Array, spool: float) -> None:
    """Put the spool's reference behind the play to where the spool is held, m."""
    path[_REFERENCE] = spool


@inlined
def command_through_play(path, command, par):
    """Return the command in V of the spool's reference, which a command takes along in its play."""
    if par.valve_hysteresis == 0.0:
        return command
    path[_REFERENCE] = play(path[_REFERENCE], par.valve_gain * command, par.valve_hysteresis)
    return path[_REFERENCE] / par.valve_gain


@inner
def delayed_command(path, command, delay):
    """Take a command (V); return those that act before and after a moment (s) of this tick."""
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
    """Return the pump's pressure in Pa that lets the supply at the valve follow its ripple.

    The line, a lag, turns a pressure held over a step of s into an exponential that meets the sine
    p_s0 + A sin(2 pi f t + phi) at both ends of the step.
    """
    rate = 2.0 * pi * par.supply_ripple_frequency
    kept = exp(-step / par.line_time_constant)
    before = sin(rate * time + par.supply_ripple_phase)
    after = sin(rate * (time + step) + par.supply_ripple_phase)
    held = (after - kept * before) / (1.0 - kept)
    return par.supply_pressure + par.supply_ripple * held


@inner
def _drive_for(state, path, command, par, fault, duration, substeps):
    """Advance plant and path over a time in s in which a command (V) acts."""
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
        # Replaced always: two kinds of parameters would be two arrays to choose from.
        acting = with_field(par, _SUPPLY_PRESSURE, supply)
        advance(state, driven, acting, fault, span, steps)


@inner
def _drive_delayed(state, path, command, par, fault, substeps):
    """Advance plant and path by a tick in which the command before may act at first."""
    before, following, late = delayed_command(path, command, par.command_delay)
    if late > 0.0:
        _drive_for(state, path, before, par, fault, late, substeps)
    _drive_for(state, path, following, par, fault, TICK - late, substeps)


@inlined
def drive_undelayed(state, path, command, par, fault, duration, substeps):
    """Advance plant and path in place over a time in s in which a command acts; see `drive`."""
    if (par.valve_hysteresis != 0.0) | (par.supply_ripple != 0.0):
        _drive_for(state, path, command, par, fault, duration, substeps)
    else:
        # int() hides a caller's literal from the compiler, which would compile `advance` once more
        # for it than for the number of `_drive_for`.
        advance(state, command, par, fault, duration, int(substeps))


@inlined
def drive(state, path, command, par, fault, substeps):
    """Advance plant and command path in place by one tick: the transition that fits share too.

    Args:
        state: float64 (9,), in the order of `PlantState`.
        path: float64 (`PATH_SIZE`,), made by `command_path`.
        command: given by the loop for this tick, V.
        par: `Parameters`.
        fault: 8 fault coefficients in the order of `FaultInput` (SI).
        substeps: longest integration steps in a tick.
    """
    if par.command_delay != 0.0:
        _drive_delayed(state, path, command, par, fault, substeps)
    else:
        drive_undelayed(state, path, command, par, fault, TICK, substeps)
