"""What every setpoint offers, and the checks that setpoints share."""

from math import isfinite
from typing import Any, Final, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from ..request import Checks, RequestError

Quantity = Literal["position", "command"]
Times = NDArray[np.floating[Any]]
Samples = NDArray[np.float64]

TICK_S: Final = 1e-3
"""Period of the loop, the shortest time a setpoint can be held (section 5: 1000 Hz)."""


class SetpointError(RequestError):
    """A setpoint that cannot be generated."""


class Setpoint(Protocol):
    """A signal in metres (quantity "position") or volts (quantity "command") over time."""

    @property
    def quantity(self) -> Quantity:
        """Say whether the signal is a position in metres or a valve command in volts."""

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in metres or volts at each time, float64 in the shape of `time_s`."""

    def peak_rate(self, duration_s: float) -> float:
        """Return a bound on |d setpoint / dt| in m/s or V/s over [0, duration_s].

        It is inf where the setpoint jumps.
        """


def unit_of(quantity: Quantity) -> str:
    """Return the unit of a quantity's values."""
    return "m" if quantity == "position" else "V"


def checks_of(setpoint: Setpoint) -> Checks:
    """Return the checks of a setpoint, begun with that of its quantity."""
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
    """Note a problem with each value that is infinite or NaN."""
    for name, value in values.items():
        checks.require(
            isfinite(value), name, value, "is not a finite number", f"give a number in {unit}"
        )


def require_seed(checks: Checks, seed: int) -> None:
    """Note a problem with a seed no random generator takes."""
    checks.require(seed >= 0, "seed", seed, "is below 0", "give a whole number from 0")
