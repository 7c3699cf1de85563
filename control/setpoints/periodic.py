"""Setpoints made of sines: sine, chirp and multisine."""

from dataclasses import dataclass
from functools import cached_property
from math import cos, gcd, inf, pi
from typing import Final

import numpy as np
from numpy.typing import NDArray

from ..request import Checks
from .protocol import Quantity, Samples, SetpointChecks, Times, Wave

# A multisine repeats within 1000 s if its frequencies are multiples of this.
_FREQUENCY_GRID_HZ: Final = 1e-3

# Grid points per period of the fastest sine, with which `_supremum` is at most 0.5 % too high.
_POINTS_PER_PERIOD: Final = 32


@dataclass(frozen=True)
class Sine(Wave):
    """A sine, r(t) = mean + amplitude sin(2 pi frequency_hz t + phase_rad), in metres or volts.

    The thesis's 3 sin(pi t + 0.1) V (section 5.1) is `Sine(0.0, 3.0, 0.5, 0.1, "command")`.

    Raises:
        SetpointError: the frequency is not between 0 and 500 Hz (both excluded), a value is not
            finite, or the quantity is not known.
    """

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        time = np.asarray(time_s, dtype=np.float64)
        phase = 2.0 * pi * self.frequency_hz * time + self.phase_rad
        return self.mean + self.amplitude * np.sin(phase)

    def peak_rate(self, duration_s: float) -> float:
        """Return 2 pi frequency |amplitude| in m/s or V/s, whatever the duration."""
        return 2.0 * pi * self.frequency_hz * abs(self.amplitude)


@dataclass(frozen=True)
class Chirp:
    """A sine whose frequency changes linearly with time, in metres or volts.

    r(t) = mean + amplitude sin(phase(t)), phase(t) = 2 pi (start_hz t + sweep_hz_per_s t^2 / 2)
    + phase_rad, so the frequency at t is start_hz + sweep_hz_per_s t. The thesis's
    3 sin(pi (1 + t/4) t) V (section 3.2) is `Chirp(0.0, 3.0, 0.5, 0.25, 0.0, "command")`.

    Raises:
        SetpointError: `start_hz` is negative, a value is not finite, or the quantity is not known.
    """

    mean: float
    amplitude: float
    start_hz: float
    sweep_hz_per_s: float
    phase_rad: float = 0.0
    quantity: Quantity = "position"

    def __post_init__(self) -> None:
        with SetpointChecks(self) as checks:
            checks.finite(checks.unit, mean=self.mean, amplitude=self.amplitude)
            checks.finite("Hz/s", sweep_hz_per_s=self.sweep_hz_per_s)
            checks.finite("rad", phase_rad=self.phase_rad)
            remedy = "give the frequency at the start in Hz"
            is_possible = 0.0 <= self.start_hz < inf
            checks.require(is_possible, "start_hz", "is below 0 or not finite", remedy)

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        time = np.asarray(time_s, dtype=np.float64)
        turns = self.start_hz * time + 0.5 * self.sweep_hz_per_s * time**2
        return self.mean + self.amplitude * np.sin(2.0 * pi * turns + self.phase_rad)

    def peak_rate(self, duration_s: float) -> float:
        """Return 2 pi |amplitude| times the highest |frequency| of the duration, in m/s or V/s."""
        last_hz = self.start_hz + self.sweep_hz_per_s * duration_s
        return 2.0 * pi * abs(self.amplitude) * max(self.start_hz, abs(last_hz))


@dataclass(frozen=True)
class Multisine:
    """A sum of sines of equal strength whose peak never exceeds |amplitude|, in metres or volts.

    r(t) = mean + a sum_i sin(2 pi frequencies_hz[i] t + phase_i), with a chosen so that
    |r(t) - mean| never exceeds |amplitude| and comes within 1 % of it. With a seed the phases are
    random; without one they are Schroeder's, which keep the peak low for the power. Frequencies
    must be multiples of 1 mHz, so that the signal repeats and its peak is known for certain.

    Raises:
        SetpointError: there is no frequency, one is not between 0 and 500 Hz (both excluded), not a
            multiple of 1 mHz or given twice, or another value is not valid.
    """

    mean: float
    amplitude: float
    frequencies_hz: tuple[float, ...]
    seed: int | None = None
    quantity: Quantity = "position"

    def __post_init__(self) -> None:
        object.__setattr__(self, "frequencies_hz", tuple(float(f) for f in self.frequencies_hz))
        with SetpointChecks(self) as checks:
            checks.finite(checks.unit, mean=self.mean, amplitude=self.amplitude)
            remedy = "give at least one frequency in Hz"
            checks.require(len(self.frequencies_hz) > 0, "frequencies_hz", "is empty", remedy)
            for index, frequency in enumerate(self.frequencies_hz):
                name = f"frequencies_hz[{index}]"
                checks.frequency(name, frequency)
                self._require_harmonic(checks, name, index)
            if self.seed is not None:
                checks.seed(self.seed)

    def _require_harmonic(self, checks: Checks, name: str, index: int) -> None:
        frequency = self.frequencies_hz[index]
        nearest = max(np.rint(frequency / _FREQUENCY_GRID_HZ), 1.0) * _FREQUENCY_GRID_HZ
        is_off = abs(frequency - nearest) > 1e-6 * _FREQUENCY_GRID_HZ
        remedy = f"give {nearest:.3f} Hz"
        checks.require(not is_off, name, "is not a multiple of 1 mHz", remedy, frequency)
        earlier = np.asarray(self.frequencies_hz[:index])
        is_there = bool(np.any(np.abs(earlier - frequency) < 0.5 * _FREQUENCY_GRID_HZ))
        checks.require(not is_there, name, "comes twice", "give each frequency once", frequency)

    @property
    def period_s(self) -> float:
        """Return the time in s after which the setpoint repeats itself."""
        return 1.0 / (_FREQUENCY_GRID_HZ * gcd(*self._harmonics.tolist()))

    @cached_property
    def _harmonics(self) -> NDArray[np.intp]:
        # Ascending, as Schroeder's phases presume.
        multiples = np.rint(np.asarray(self.frequencies_hz) / _FREQUENCY_GRID_HZ)
        return np.sort(multiples).astype(np.intp)

    @cached_property
    def _phases(self) -> Samples:
        count = len(self.frequencies_hz)
        if self.seed is None:
            return _schroeder_phases(count)
        return 2.0 * pi * np.random.Generator(np.random.PCG64(self.seed)).random(count)

    @cached_property
    def _component_amplitude(self) -> float:
        unit = np.ones(len(self.frequencies_hz))
        return self.amplitude / _supremum(self._harmonics, unit, self._phases)

    def sample(self, time_s: Times) -> Samples:
        """Return the setpoint in m or V at each time in s, float64 in the shape of `time_s`."""
        time = np.asarray(time_s, dtype=np.float64)
        total = np.zeros(time.shape)
        for harmonic, phase in zip(self._harmonics, self._phases, strict=True):
            total += np.sin(2.0 * pi * _FREQUENCY_GRID_HZ * harmonic * time + phase)
        return self.mean + self._component_amplitude * total

    def peak_rate(self, duration_s: float) -> float:
        """Return a bound on the |rate| at any time in m/s or V/s, whatever the duration.

        It is at most 1 % above the greatest |rate|.
        """
        rates = 2.0 * pi * _FREQUENCY_GRID_HZ * self._harmonics.astype(np.float64)
        # The derivative of a sine leads it by a quarter turn.
        peak = _supremum(self._harmonics, rates, self._phases + 0.5 * pi)
        return abs(self._component_amplitude) * peak


def _schroeder_phases(count: int) -> NDArray[np.float64]:
    """Return phases in rad (count,) for which a sum of equally strong sines has a low peak.

    The sines k = 1 to count ascend in frequency, and phase_k = -pi k (k - 1) / count (Schroeder
    1970, IEEE Trans. Inf. Theory 16, 85).
    """
    k = np.arange(1, count + 1, dtype=np.float64)
    return -pi * k * (k - 1.0) / count


def _supremum(
    harmonics: NDArray[np.intp], amplitudes: NDArray[np.float64], phases: NDArray[np.float64]
) -> float:
    """Return the greatest |sum_i a_i sin(h_i x + phase_i)| over all x, or up to 0.5 % more.

    The harmonics h_i (n,) are distinct positive integers; amplitudes a_i and phases (rad) are (n,).
    A trigonometric polynomial of degree N is at most 1 / cos(pi N / M) above its largest value on
    M > 2 N equidistant points of its period (Ehlich and Zeller 1964, Math. Z. 86, 41).
    """
    degrees = harmonics // gcd(*harmonics.tolist())
    points = _POINTS_PER_PERIOD * int(degrees.max())
    spectrum = np.zeros(points // 2 + 1, dtype=np.complex128)
    # A coefficient c at h gives 2 |c| cos(h x + arg c) / points; a sine lags a cosine by pi/2.
    spectrum[degrees] = 0.5 * points * amplitudes * np.exp(1j * (phases - 0.5 * pi))
    grid_peak = float(np.max(np.abs(np.fft.irfft(spectrum, points))))
    # One part in 10^9 covers the rounding of the transform.
    return grid_peak / cos(pi / _POINTS_PER_PERIOD) * (1.0 + 1e-9)
