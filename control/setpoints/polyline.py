"""A setpoint of straight lines between given points, for experiments that plan their own motion."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from .protocol import Quantity, Samples, SetpointChecks, Times, greatest_slope


@dataclass(frozen=True)
class Polyline:
    """Straight lines from corner to corner, in metres or volts.

    Before the first corner the setpoint has the first value, after the last corner the last one.

    Attributes:
        times_s: times of the corners in s, increasing, at least two.
        values: setpoint at each corner.
        quantity: "position" (metres) or "command" (volts).

    Raises:
        SetpointError: there are fewer than two corners or unequally many values, a number is not
            finite, the times do not increase, or the quantity is neither of the two.
    """

    times_s: tuple[float, ...]
    values: tuple[float, ...]
    quantity: Quantity = "position"

    def __post_init__(self) -> None:
        object.__setattr__(self, "times_s", tuple(float(time) for time in self.times_s))
        object.__setattr__(self, "values", tuple(float(value) for value in self.values))
        checks = SetpointChecks(self)
        checks.require(
            len(self.times_s) == len(self.values) >= 2,
            "values",
            f"do not fit {len(self.times_s)} times, or are fewer than two",
            "give a value for each of at least two times",
            len(self.values),
        )
        increase = all(later > earlier for earlier, later in pairwise(self.times_s))
        remedy = "give the corners in the order of time"
        checks.require(increase, "times_s", "do not increase", remedy)
        for index, (time, value) in enumerate(zip(self.times_s, self.values, strict=False)):
            checks.finite("s", **{f"times_s[{index}]": time})
            checks.finite(checks.unit, **{f"values[{index}]": value})
        checks.finish()

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        return np.interp(np.asarray(time_s, dtype=np.float64), self.times_s, self.values)

    def peak_rate(self, duration_s: float) -> float:
        """Return the greatest |slope| of the lines in m/s or V/s within 0 to `duration_s`.

        A line counts if any part of it lies within. The result is 0 if none does.
        """
        return greatest_slope(np.asarray(self.times_s), np.asarray(self.values), duration_s)
