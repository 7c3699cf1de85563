"""Setpoints of straight lines that repeat themselves: triangle and trapezoid."""

from dataclasses import dataclass
from math import inf, pi

import numpy as np

from .protocol import TICK_S, Quantity, Samples, SetpointChecks, Times, Wave


@dataclass(frozen=True)
class Triangle(Wave):
    """A triangle wave around a mean, in metres or volts, which has a constant speed.

    It has the phase of a sine: at the time 0 with phase 0 it passes the mean upwards, it reaches
    mean + amplitude after a quarter of a period and mean - amplitude after three quarters.

    Raises:
        SetpointError: the frequency is not between 0 and 500 Hz (both excluded), a value is not
            finite, or the quantity is not known.
    """

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        return self.mean + self.amplitude * _triangle(time_s, self.frequency_hz, self.phase_rad)

    def peak_rate(self, duration_s: float) -> float:
        """Return 4 frequency |amplitude| in m/s or V/s, whatever the duration."""
        return 4.0 * self.frequency_hz * abs(self.amplitude)


@dataclass(frozen=True)
class Trapezoid:
    """A triangle wave that rests at both ends for `hold_s` each, in metres or volts.

    Its period and its phase are those of the triangle (at the time 0 with phase 0 it passes the
    mean upwards); in what the rests leave of the period it moves twice by 2 |amplitude|.

    Raises:
        SetpointError: the frequency is not between 0 and 500 Hz (both excluded), the two rests
            leave less than a tick for each motion, a value is not finite, or the quantity is not
            known.
    """

    mean: float
    amplitude: float
    frequency_hz: float
    hold_s: float
    phase_rad: float = 0.0
    quantity: Quantity = "position"

    def __post_init__(self) -> None:
        with SetpointChecks(self) as checks:
            checks.wave(self.mean, self.amplitude, self.frequency_hz, self.phase_rad)
            checks.require(
                0.0 <= self.hold_s < inf, "hold_s", "is below 0 s or not finite", "give seconds"
            )
            checks.finish()
            half = 0.5 * self.period_s
            limit = f"leaves no time to move in half a period of {half:g} s"
            checks.require(
                self.ramp_s >= TICK_S, "hold_s", limit, "rest for less", f"{self.hold_s:g} s"
            )

    @property
    def period_s(self) -> float:
        """Return the time in s after which the setpoint repeats itself."""
        return 1.0 / self.frequency_hz

    @property
    def ramp_s(self) -> float:
        """Return the time in s of one motion from end to end."""
        return 0.5 * self.period_s - self.hold_s

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        steepness = 0.5 * self.period_s / self.ramp_s
        wave = steepness * _triangle(time_s, self.frequency_hz, self.phase_rad)
        return self.mean + self.amplitude * np.clip(wave, -1.0, 1.0)

    def peak_rate(self, duration_s: float) -> float:
        """Return 2 |amplitude| over the time of one motion, m/s or V/s, whatever the duration."""
        return 2.0 * abs(self.amplitude) / self.ramp_s


def _triangle(time_s: Times, frequency_hz: float, phase_rad: float) -> Samples:
    """Return the triangle wave of amplitude 1 at each time in s, in the shape of `time_s`."""
    turns = frequency_hz * np.asarray(time_s, dtype=np.float64) + phase_rad / (2.0 * pi) + 0.25
    return 1.0 - 4.0 * np.abs(turns - np.floor(turns) - 0.5)
