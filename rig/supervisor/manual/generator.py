"""The function generator of manual mode, whose wave is changed while it runs, without a bump.

Phase is summed up tick by tick, so that a change of frequency never makes it jump. Amplitude, mean
and frequency go over along a raised cosine, whose slope is 0 at both ends.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import pi
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.configuration import show
from rig.plant import TICK

from .bounds import Bounds, ManualError

Array = NDArray[np.float64]

BLEND_S: Final = 1.0
"""Time in s in which amplitude, mean and frequency go over to other values."""
FREQUENCIES: Final = (0.01, 20.0)
"""Least and greatest frequency in Hz: a wave is seen as one, and has 50 setpoints in a period."""
SWEEP_S: Final = 10.0
"""Time in s in which a chirp goes from its lower to its upper frequency, unless told otherwise."""


class Shape(NamedTuple):
    """A wave of period 1 and amplitude 1, with the greatest values of its two derivatives."""

    wave: Callable[[Array], Array]
    slope: float
    curvature: float


def _with_ramps(ramp: float, corner: float) -> Shape:
    """Return a wave that goes up and down along ramps, and rests between them.

    Args:
        ramp: share of the period that a ramp takes, at most 0.5, with which there is no rest.
        corner: share of the period in which the speed of a ramp comes or goes, at constant
            acceleration; at most half of the ramp.
    """
    slope = 2.0 / (ramp - corner)

    def wave(phase: Array) -> Array:
        place = np.minimum(phase % 0.5, ramp)
        begin = 0.5 * slope / corner * np.minimum(place, corner) ** 2
        middle = slope * np.clip(place - corner, 0.0, ramp - 2.0 * corner)
        late = np.clip(place - (ramp - corner), 0.0, corner)
        end = slope * late - 0.5 * slope / corner * late**2
        risen = begin + middle + end - 1.0
        return np.where(phase % 1.0 < 0.5, risen, -risen)

    return Shape(wave, slope, slope / corner)


_SINE: Final = Shape(lambda phase: np.sin(2.0 * pi * phase), 2.0 * pi, (2.0 * pi) ** 2)

SHAPES: Final = {
    "sine": _SINE,
    "triangle": _with_ramps(0.5, 0.05),
    "trapezoid": _with_ramps(0.25, 0.05),
    "steps": _with_ramps(0.1, 0.05),
    "chirp": _SINE,
}
"""The waves by name. Corners are rounded, so that the acceleration is bounded; a step takes a tenth
of the period. A chirp is a sine whose frequency goes up and down."""


@dataclass(frozen=True)
class Wave:
    """What the generator is asked for.

    Attributes:
        shape: one of `SHAPES`.
        mean_m: position about which the ram moves.
        amplitude_m: half of the way from end to end, at least 0.
        frequency_hz: frequency; for a chirp the one with which it begins.
        to_hz: frequency to which a chirp goes and from which it comes back; else as `frequency_hz`.
        sweep_s: time in which a chirp goes from one frequency to the other.
    """

    shape: str
    mean_m: float
    amplitude_m: float
    frequency_hz: float
    to_hz: float
    sweep_s: float = SWEEP_S

    @property
    def at_rest(self) -> "Wave":
        """The same wave with amplitude 0."""
        return replace(self, amplitude_m=0.0)


def check_change(before: Wave, after: Wave, bounds: Bounds) -> float:
    """Check that a wave, and the change to it from another, stay within the bounds.

    At 101 moments of the change, the greatest speed and acceleration at the worst phase are summed
    up from what wave and change contribute.

    Returns:
        The greatest acceleration, m/s^2.

    Raises:
        ManualError: a position, speed, acceleration or frequency is not allowed.
    """
    low, high = FREQUENCIES
    for name in ("frequency_hz", "to_hz"):
        if not low <= getattr(after, name) <= high:
            raise ManualError(
                f"frequency: {getattr(after, name):g} Hz is not between {low:g} and {high:g} Hz; "
                "ask for one between them"
            )
    if not after.amplitude_m >= 0.0 or not 0.1 <= after.sweep_s <= 600.0:
        raise ManualError("amplitude must be 0 or more, and a sweep last 0.1 to 600 s")
    bounds.check_position(after.mean_m - after.amplitude_m, "mean less amplitude")
    bounds.check_position(after.mean_m + after.amplitude_m, "mean plus amplitude")
    share = 0.5 - 0.5 * np.cos(pi * np.linspace(0.0, 1.0, 101))
    first = 0.5 * pi / BLEND_S * np.sin(pi * np.linspace(0.0, 1.0, 101))
    second = 0.5 * (pi / BLEND_S) ** 2
    by = {name: getattr(after, name) - getattr(before, name) for name in ("amplitude_m", "mean_m")}
    fastest = [max(each.frequency_hz, each.to_hz) for each in (before, after)]
    amplitude = before.amplitude_m + by["amplitude_m"] * share
    frequency = fastest[0] + (fastest[1] - fastest[0]) * share
    sweep = abs(after.to_hz - after.frequency_hz) / after.sweep_s
    turning = abs(fastest[1] - fastest[0]) * first + sweep
    shape, changing = SHAPES[after.shape], abs(by["amplitude_m"]) + abs(by["mean_m"])
    speed = amplitude * frequency * shape.slope + changing * first
    acceleration = (
        amplitude * frequency**2 * shape.curvature
        + (2.0 * abs(by["amplitude_m"]) * first * frequency + amplitude * turning) * shape.slope
        + changing * second
    )
    for what, peak, most, unit in (
        ("speed", float(speed.max()), bounds.speed, "m/s"),
        ("acceleration", float(acceleration.max()), bounds.acceleration, "m/s^2"),
    ):
        if peak > most:
            raise ManualError(
                f"{what}: the wave and the change to it take up to {_shown(peak, unit)}, at most "
                f"{_shown(most, unit)} is allowed; lower amplitude or frequency, or go there by "
                "several changes"
            )
    return float(acceleration.max())


def _shown(value: float, unit: str) -> str:
    return show(value, unit) if unit == "m/s" else f"{value:.3g} {unit}"


class Generator:
    """A generator that begins with amplitude 0 at a mean where the ram rests.

    Args:
        wave: what is asked for.
        bounds: what its setpoints may do.

    Attributes:
        wave: the wave that it is, or goes over to.

    Raises:
        ManualError: the wave is not allowed.
    """

    def __init__(self, wave: Wave, bounds: Bounds) -> None:
        self._bounds = bounds
        self._before = wave.at_rest
        self.wave = wave
        self._next: Wave | None = None
        self._blended = 0
        self._phase = self._swept = 0.0
        self.acceleration = check_change(self._before, wave, bounds)

    @property
    def wanted(self) -> Wave:
        """The wave that was asked for last, which may have to wait for the end of a change."""
        return self._next or self.wave

    @property
    def at_rest(self) -> bool:
        """Whether the amplitude has gone to 0 and nothing else is asked for."""
        return not self.wave.amplitude_m and self._blended >= _BLEND and self._next is None

    def change(self, wave: Wave) -> None:
        """Go over to another wave of the same shape, after the present change if there is one.

        Raises:
            ManualError: the wave has another shape or is not allowed; the present one goes on.
        """
        if wave.shape != self.wave.shape:
            raise ManualError(
                f"shape: {self.wave.shape} cannot become {wave.shape} without a bump; stop first"
            )
        self.acceleration = max(self.acceleration, check_change(self.wave, wave, self._bounds))
        self._next = wave

    def sample(self, ticks: int) -> Array:
        """Return the next setpoints (ticks,), m, and go on to their end."""
        parts = []
        while ticks > 0:
            if self._blended >= _BLEND and self._next is not None:
                self._before, self.wave, self._next = self.wave, self._next, None
                self._blended = 0
            here = min(ticks, _BLEND - self._blended) if self._blended < _BLEND else ticks
            parts.append(self._part(here))
            self._blended = min(self._blended + here, _BLEND)
            ticks -= here
        return np.concatenate(parts) if parts else np.empty(0)

    def _part(self, ticks: int) -> Array:
        """Return setpoints of which none comes after the end of a change."""
        count = np.arange(1, ticks + 1)
        share = 0.5 - 0.5 * np.cos(pi * np.minimum((self._blended + count) / _BLEND, 1.0))

        def blended(name: str) -> Array:
            before, after = float(getattr(self._before, name)), float(getattr(self.wave, name))
            return before + (after - before) * share

        swept = self._swept + count * TICK / self.wave.sweep_s
        across = 1.0 - np.abs(swept % 2.0 - 1.0)
        frequency = blended("frequency_hz")
        frequency += (blended("to_hz") - frequency) * across
        phase = self._phase + np.cumsum(frequency * TICK)
        self._phase, self._swept = float(phase[-1] % 1.0), float(swept[-1] % 2.0)
        return blended("mean_m") + blended("amplitude_m") * SHAPES[self.wave.shape].wave(phase)


_BLEND: Final = round(BLEND_S / TICK)
