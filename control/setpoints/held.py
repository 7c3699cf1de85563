"""Setpoints that hold levels for some time: constant, steps and pseudorandom levels."""

from dataclasses import dataclass
from math import inf
from typing import Final

import numpy as np

from ..request import Checks
from .protocol import TICK_S, Quantity, Samples, SetpointChecks, Times

# Times of ticks are multiples of 1 ms only up to rounding. Without this tolerance a step at 0.6 s
# could come a tick late.
ROUNDING_S: Final = 1e-9


@dataclass(frozen=True)
class Constant:
    """A constant setpoint, r(t) = value, in metres or volts.

    Raises:
        SetpointError: the value is not finite, or the quantity is not known.
    """

    value: float
    quantity: Quantity = "position"

    def __post_init__(self) -> None:
        with SetpointChecks(self) as checks:
            checks.finite(checks.unit, value=self.value)

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        return np.full(np.shape(time_s), self.value, dtype=np.float64)

    def peak_rate(self, duration_s: float) -> float:
        """Return 0: the setpoint does not move."""
        return 0.0


@dataclass(frozen=True)
class Steps:
    """Levels (metres or volts) that are held for `hold_s` seconds each; the last one stays.

    Raises:
        SetpointError: there is no level, one is not finite, `hold_s` is below 1 ms or infinite, or
            the quantity is not known.
    """

    levels: tuple[float, ...]
    hold_s: float
    quantity: Quantity = "position"

    def __post_init__(self) -> None:
        object.__setattr__(self, "levels", tuple(float(level) for level in self.levels))
        with SetpointChecks(self) as checks:
            checks.require(len(self.levels) > 0, "levels", "is empty", "give at least one level")
            for index, level in enumerate(self.levels):
                checks.finite(checks.unit, **{f"levels[{index}]": level})
            _require_hold(checks, "hold_s", self.hold_s)

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        time = np.asarray(time_s, dtype=np.float64)
        index = np.floor((time + ROUNDING_S) / self.hold_s)
        last = len(self.levels) - 1
        return np.asarray(self.levels)[np.clip(index, 0, last).astype(np.intp)]

    def peak_rate(self, duration_s: float) -> float:
        """Return inf if the setpoint jumps within the duration, else 0."""
        steps = np.flatnonzero(np.diff(self.levels)) + 1
        jumps = steps.size > 0 and steps[0] * self.hold_s <= duration_s + ROUNDING_S
        return inf if jumps else 0.0


@dataclass(frozen=True)
class Pseudorandom:
    """Random levels that are held for random times (sections 5.2.2, 7.1.2 and 7.2.2).

    Levels are uniform in [lower, upper) (metres or volts), and times in [hold_min_s, hold_max_s).
    For given bounds the sequence depends on the seed alone, and a longer run begins like a shorter
    one.

    Raises:
        SetpointError: a level is not finite, a time is below 1 ms or not finite, an upper bound is
            below its lower bound, the seed is negative, or the quantity is not known.
    """

    lower: float
    upper: float
    hold_min_s: float
    hold_max_s: float
    seed: int
    quantity: Quantity = "position"

    def __post_init__(self) -> None:
        with SetpointChecks(self) as checks:
            checks.finite(checks.unit, lower=self.lower, upper=self.upper)
            is_below = self.upper < self.lower
            limit = f"is below lower ({self.lower})"
            checks.require(not is_below, "upper", limit, "swap lower and upper")
            _require_hold(checks, "hold_min_s", self.hold_min_s)
            _require_hold(checks, "hold_max_s", self.hold_max_s)
            limit = f"is below hold_min_s ({self.hold_min_s})"
            is_below = self.hold_max_s < self.hold_min_s
            checks.require(not is_below, "hold_max_s", limit, "swap hold_min_s and hold_max_s")
            checks.seed(self.seed)

    def sequence(self, until_s: float) -> tuple[Samples, Samples]:
        """Return (ends, levels), both (n,), for the time from 0 to `until_s` (s) at least.

        Level i (m or V) is held until ends[i] (s), the first one from 0 s on. The last end is after
        `until_s`.
        """
        count = 2 + int(max(until_s, 0.0) / self.hold_min_s)
        # Level and hold are drawn in pairs, so the sequence does not depend on how many are drawn.
        draws = np.random.Generator(np.random.PCG64(self.seed)).random((count, 2))
        levels = _between(self.lower, self.upper, draws[:, 0])
        ends = np.cumsum(_between(self.hold_min_s, self.hold_max_s, draws[:, 1]))
        return ends, levels

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        time = np.asarray(time_s, dtype=np.float64) + ROUNDING_S
        ends, levels = self.sequence(float(np.max(time, initial=0.0)))
        return levels[np.searchsorted(ends, time, side="right")]

    def peak_rate(self, duration_s: float) -> float:
        """Return inf if the setpoint jumps within the duration, else 0."""
        ends, _ = self.sequence(duration_s)
        return inf if ends[0] <= duration_s + ROUNDING_S and self.upper > self.lower else 0.0


def _between(lower: float, upper: float, fraction: Samples) -> Samples:
    # Rounding may carry the last bit past the bound.
    return np.clip(lower + (upper - lower) * fraction, lower, upper)


def _require_hold(checks: Checks, name: str, hold_s: float) -> None:
    limit = f"is below one tick of {TICK_S} s or not finite"
    remedy = "give the time to hold a level in seconds"
    checks.require(TICK_S <= hold_s < inf, name, limit, remedy, hold_s)
