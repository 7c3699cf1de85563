"""The interface of all setpoints, the checks that they share, and what waves have in common."""

from dataclasses import dataclass
from math import isfinite
from typing import Any, Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ..request import Checks, RequestError

Quantity = Literal["position", "command"]
Times = NDArray[np.floating[Any]]
Samples = NDArray[np.float64]

TICK_S: Final = 1e-3
"""Period of the loop in s, the shortest time for which a level can be held (section 5: 1000 Hz)."""


class SetpointError(RequestError):
    """The error of a setpoint whose parameters are not valid."""


class Setpoint(Protocol):
    """The interface of a setpoint: a signal over time, in metres or volts by its quantity."""

    @property
    def quantity(self) -> Quantity:
        """Return "position" for a position in metres, "command" for a valve command in volts."""

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""

    def peak_rate(self, duration_s: float) -> float:
        """Return an upper bound of |d setpoint / dt| in m/s or V/s over [0, duration_s].

        It is inf if the setpoint jumps within that time.
        """


def period_of(setpoint: Setpoint) -> float | None:
    """Return the time in s after which a setpoint repeats itself; None if it never does."""
    period_s: float | None = getattr(setpoint, "period_s", None)
    return period_s


class SetpointChecks(Checks):
    """A collection of problems of a setpoint's parameters; `finish` raises them as `SetpointError`.

    That the quantity is "position" or "command" is checked at the beginning. The attribute `unit`
    is the unit of the setpoint's values: "m" for a position, "V" for a command.
    """

    def __init__(self, setpoint: Setpoint) -> None:
        super().__init__(type(setpoint).__name__, SetpointError, setpoint)
        self.unit = "m" if setpoint.quantity == "position" else "V"
        is_known, shown = setpoint.quantity in ("position", "command"), repr(setpoint.quantity)
        remedy = 'give "position" (metres, closed loop) or "command" (volts, open loop)'
        self.require(is_known, "quantity", "is neither position nor command", remedy, shown)

    def finite(self, unit: str, **values: float) -> None:
        """Note a problem with each named value that is infinite or NaN; the message has `unit`."""
        for name, value in values.items():
            remedy = f"give a number in {unit}"
            self.require(isfinite(value), name, "is not a finite number", remedy, value)

    def frequency(self, name: str, frequency_hz: float) -> None:
        """Note a problem with a frequency that a loop at 1 kHz cannot carry."""
        nyquist_hz = 0.5 / TICK_S
        limit = f"is not between 0 and {nyquist_hz:g} Hz"
        remedy = "give a frequency in Hz that a 1 kHz loop can carry"
        self.require(0.0 < frequency_hz < nyquist_hz, name, limit, remedy, frequency_hz)

    def wave(self, mean: float, amplitude: float, frequency_hz: float, phase_rad: float) -> None:
        """Note the problems of a wave's mean, amplitude (m or V), frequency (Hz), phase (rad)."""
        self.finite(self.unit, mean=mean, amplitude=amplitude)
        self.finite("rad", phase_rad=phase_rad)
        self.frequency("frequency_hz", frequency_hz)

    def seed(self, seed: int) -> None:
        """Note a problem if the seed is negative."""
        self.require(seed >= 0, "seed", "is below 0", "give a whole number from 0", seed)


@dataclass(frozen=True)
class Wave:
    """What a wave around a mean is given by, in metres or volts; each form is a class of its own.

    Raises:
        SetpointError: the frequency is not between 0 and 500 Hz (both excluded), a value is not
            finite, or the quantity is not known.
    """

    mean: float
    amplitude: float
    frequency_hz: float
    phase_rad: float = 0.0
    quantity: Quantity = "position"

    def __post_init__(self) -> None:
        with SetpointChecks(self) as checks:
            checks.wave(self.mean, self.amplitude, self.frequency_hz, self.phase_rad)

    @property
    def period_s(self) -> float:
        """Return the time in s after which the setpoint repeats itself."""
        return 1.0 / self.frequency_hz

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        raise NotImplementedError

    def peak_rate(self, duration_s: float) -> float:
        """Return the greatest |rate| in m/s or V/s within 0 to `duration_s`."""
        raise NotImplementedError
