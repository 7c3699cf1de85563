"""The sequence of a leak test: regulate both pressures, lock, soak; three times, in half a minute.

One chamber's valve is shut and the other's open, and the servovalve regulates the pressure of the
open one. The ram stands between a locked and a regulated chamber: it can move no further than the
oil of the locked chamber gives way, a few millimetres at most.
"""

from collections.abc import Callable
from typing import Final

import numpy as np

from estimator.leak_test import (
    SOAK_S,
    BlockingLeak,
    Soak,
    fit_leaks,
    foreseen_limits,
    levels_of,
    port_pressures,
)
from rig.configuration import Rig
from rig.loop import TripError
from rig.plant import Parameters, Reading, chamber_volumes, valve_conductance
from rig.supervisor import MOST_COMMAND_V
from rig.surviving import failure

from .lockable import Lockable
from .results import LeakTest, ends_of

BANDWIDTH: Final = 10.0
"""Bandwidth in rad/s of the pressure control: a pressure is reached in half a second, and twenty
samples of 5 ms pass in a time constant, so that the delay of a sample does no harm."""
SOAK_COMMAND: Final = 0.3
"""Command in V during a soak: it connects one port of the servovalve to the supply and the other
to the return, beyond any shift of its null, so that the pressures behind the blocking valves are
known."""
REGULATE_S: Final = 0.5
"""Time in s for which a pressure is regulated: five time constants of the control."""
SETTLE_S: Final = 1.0
"""Time in s from the last valve's arrival to the first sample of a soak: pressures have settled."""
ROUNDS: Final = 2
"""How often both chambers are regulated in turn, as each moves the ram a little for the other."""
MOST_ROUNDS: Final = 4
"""The same, while a pressure is further from its target than `NEAR`, as on a busy computer."""
NEAR: Final = 1.5e6
"""Distance in Pa from its target at which a pressure is near enough. The control without integral
part leaves up to 0.8 MPa; twice that is no longer what it can be blamed for."""


class StoppedError(RuntimeError):
    """The test was stopped before its end; the rig is in its safe state."""


def run_leak_test(
    rig: Rig,
    assumed: Parameters,
    lockable: Lockable,
    on_soak: Callable[[int, Soak], None] = lambda number, soak: None,
    is_stopped: Callable[[], str] = lambda: "",
) -> LeakTest:
    """Run the test and return what came of it; the rig is released in any case.

    Args:
        rig: the rig, which has blocking valves.
        assumed: parameters of the assumed model.
        lockable: moves the rig.
        on_soak: is called with number, from 1, and samples of each soak after it.
        is_stopped: returns who asks to stop the test; empty if nobody does.

    Raises:
        LeakTestError: a chamber did not keep its pressure, so that the test tells nothing.
        StoppedError: the test was stopped.
        TripError: the rig tripped; or it could not be released after any other error, which the
            message tells first.
    """
    valves = rig.blocking_valves
    if valves is None:
        raise ValueError(f"{rig.name} has no blocking valves")
    levels = levels_of(assumed)
    test = _Sequence(lockable, assumed, valves.travel_s, is_stopped)
    soaks = []
    try:
        for number, targets in enumerate(levels.soaks):
            soaks.append(test.soak(number, targets))
            on_soak(number + 1, soaks[-1])
    except Exception as error:
        _release_after(error, lockable)
        raise
    except BaseException:
        lockable.release()
        raise
    lockable.release()
    blocking = BlockingLeak(valves.leak, valves.leak_pressure)
    rate_hz = (soaks[0].time_s.size - 1) / float(np.ptp(soaks[0].time_s))
    position = float(soaks[0].position.mean())
    foreseen = foreseen_limits(levels, assumed, rig.sensors, blocking, position, rate_hz)
    found = fit_leaks(soaks, levels, assumed, rig.sensors, blocking)
    ends = tuple(ends_of(soak) for soak in soaks)
    return LeakTest(
        rig.name, found, foreseen, ends, lockable.time_s, valves.leak, valves.leak_pressure
    )


def _release_after(first: Exception, lockable: Lockable) -> None:
    """Release the rig after an error of its test.

    Raises:
        TripError: it could not be released; the message tells the error of the test first. Whoever
            handles that error alone would take the rig for safe.
    """
    try:
        lockable.release()
    except Exception as second:
        trip = (first.report, first.cause) if isinstance(first, TripError) else ()
        both = ExceptionGroup("a leak test, and the release after it", [first, second])
        text = f"{_text_of(first)}; then, as the rig was released: {_text_of(second)}"
        raise TripError(text, *trip) from both


def _text_of(error: Exception) -> str:
    """Return the text of an error of this program; of one of Python its type and place, too."""
    return failure(error) if type(error).__module__ == "builtins" else str(error)


class _Sequence:
    """Makes the soaks of one test, one after the other."""

    def __init__(
        self, rig: Lockable, par: Parameters, travel_s: float, is_stopped: Callable[[], str]
    ) -> None:
        self._rig = rig
        self._par = par
        self._travel_s = travel_s
        self._is_stopped = is_stopped
        self._before: Reading | None = None

    def soak(self, number: int, targets: tuple[float, float]) -> Soak:
        """Bring both chambers to pressures in Pa, lock them, and return the samples of a soak."""
        par, before = self._par, self._before or self._lock()
        for number_of_round in range(1, MOST_ROUNDS + 1):
            for chamber in (0, 1):
                # A valve opens only when the other one is shut, and while the pressure that it is
                # to have is regulated, so that the servovalve never moves the ram.
                self._rig.block(chamber == 1, chamber == 0)
                self._regulate(chamber, targets[chamber], REGULATE_S + self._travel_s)
                self._rig.block(True, True)
                last = self._regulate(chamber, targets[chamber], 1.5 * self._travel_s)
            reached = last.pressure_1 - targets[0], last.pressure_2 - targets[1]
            if number_of_round >= ROUNDS and max(map(abs, reached)) < NEAR:
                break
        command = SOAK_COMMAND if number == 0 else -SOAK_COMMAND
        locked_s = self._rig.time_s
        while self._rig.time_s < locked_s + SETTLE_S:
            self._exchange(command)
        rows = []
        begun_s = self._rig.time_s
        while self._rig.time_s < begun_s + SOAK_S:
            reading = self._exchange(command)
            rows.append(
                (self._rig.time_s, reading.pressure_1, reading.pressure_2, reading.position)
            )
        table = np.array(rows).T
        steps = targets[0] - before.pressure_1, targets[1] - before.pressure_2
        self._before = last._replace(
            pressure_1=float(table[1, -50:].mean()), pressure_2=float(table[2, -50:].mean())
        )
        ports = port_pressures(number, par.supply_pressure, par.return_pressure)
        time_s, pressure_1, pressure_2, position = table
        return Soak(time_s, pressure_1, pressure_2, position, *ports, steps, begun_s - locked_s)

    def _lock(self) -> Reading:
        """Shut both valves with the servovalve at null; return a sample from before."""
        before = self._exchange(0.0)
        self._rig.block(True, True)
        until_s = self._rig.time_s + 1.5 * self._travel_s
        while self._rig.time_s < until_s or not self._rig.arrived:
            self._exchange(0.0)
        return before

    def _regulate(self, chamber: int, target: float, duration_s: float) -> Reading:
        """Regulate the pressure of a chamber to a target in Pa; return the last sample.

        It is regulated for a duration in s, and then until the blocking valves have arrived.
        """
        par = self._par
        until_s = self._rig.time_s + duration_s
        command = 0.0
        while True:
            reading = self._exchange(command)
            if self._rig.time_s >= until_s and self._rig.arrived:
                return reading
            volume = chamber_volumes(reading.position, par)[chamber]
            flow = valve_conductance(par) * par.valve_gain * (0.5 * par.supply_pressure) ** 0.5
            gain = BANDWIDTH * volume / (par.bulk_modulus * flow)
            pressure = (reading.pressure_1, reading.pressure_2)[chamber]
            side = 1.0 if chamber == 0 else -1.0
            command = side * min(max(gain * (target - pressure), -MOST_COMMAND_V), MOST_COMMAND_V)

    def _exchange(self, command: float) -> Reading:
        who = self._is_stopped()
        if who:
            raise StoppedError(f"stopped by {who}")
        return self._rig.exchange(command)
