"""The interface of all setpoints, and the checks that they share."""

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


def unit_of(quantity: Quantity) -> str:
    """Return the unit of a quantity's values: "m" for a position, "V" for a command."""
    return "m" if quantity == "position" else "V"


def checks_of(setpoint: Setpoint) -> Checks:
    """Return new checks of a setpoint, with a problem noted if its quantity is not known.

    Known are "position" and "command". `finish` of the checks raises `SetpointError`.
    """
    checks = Checks(type(setpoint).__name__, SetpointError)
    checks.require(
        setpoint.quantity in ("position", "command"),
        "quantity",
        repr(setpoint.quantity),
        "is neither position nor command",
        'give "position" (metres, closed loop) or "command" (volts, open loop)',
    )
    return checks


def require_finite(checks: Checks, unit: str, **values: float) -> None:
    """Note a problem with each named value that is infinite or NaN; `unit` is for the message."""
    for name, value in values.items():
        checks.require(
            isfinite(value), name, value, "is not a finite number", f"give a number in {unit}"
        )


def require_seed(checks: Checks, seed: int) -> None:
    """Note a problem if the seed is negative."""
    checks.require(seed >= 0, "seed", seed, "is below 0", "give a whole number from 0")
