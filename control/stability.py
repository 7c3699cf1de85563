"""The margins of a position loop about a sliding ram, by a linear model of it.

While a ram slides one way, friction is a constant force, and the rig is linear about that motion:
an integrator of the valve's flow, with a lag, and above both the oil's resonance (Merritt 1967,
ch. 8). Nothing here is compiled.
"""

from dataclasses import dataclass
from math import inf, log10, pi, sqrt
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import TICK, Parameters

from .loop_model import valve_lag, velocity_gain
from .settings import ControlSettings

LEAST_GAIN_MARGIN_DB: Final = 6.0
LEAST_PHASE_MARGIN: Final = pi / 6.0
"""Margins that a loop must keep, 6 dB and 30 degrees, as usual for servo drives."""
_GRID: Final = 2.0 * pi * np.geomspace(0.02, 0.5 / TICK, 6000)
"""Angular frequencies of the margins, rad/s, up to half the loop's rate."""
_LEAST_DAMPING: Final = 0.05
"""Least damping of the oil's resonance that is assumed. Servo-actuators have 0.05 to 0.2, by the
valve's flow coefficients and seals (Merritt 1967, ch. 6); models have viscous friction only."""


@dataclass(frozen=True)
class LoopModel:
    """The linear model of a sliding ram at one place of the stroke, one way.

    Attributes:
        position: middle of the stretch, m.
        extending: whether the ram extended.
        speed_per_volt: gain of the integrator, m/(s V).
        lag_s: lag from the command to the ram's velocity, s.
        misfit: rms deviation of the measured response from the model, as a part of it.
        mean_V: mean command of the stretch, V.
        speed: mean speed of the stretch, m/s, negative as the ram retracts.
    """

    position: float
    extending: bool
    speed_per_volt: float
    lag_s: float
    misfit: float
    mean_V: float  # noqa: N815
    speed: float


@dataclass(frozen=True)
class Margins:
    """Stability margins of a loop, the least over all crossings.

    Attributes:
        gain_dB: factor in dB by which the gain may grow.
        phase: angle in rad by which the loop may lag more.
        crossover: angular frequency at which the loop's gain is 1, rad/s.
    """

    gain_dB: float  # noqa: N815
    phase: float
    crossover: float

    @property
    def kept(self) -> bool:
        """Whether both margins are at least those that a loop must keep."""
        return self.gain_dB >= LEAST_GAIN_MARGIN_DB and self.phase >= LEAST_PHASE_MARGIN


def margins(
    model: LoopModel, settings: ControlSettings, gain: float, assumed: Parameters, delay_s: float
) -> Margins:
    """Return the margins of the position loop about a sliding ram.

    The slope that the deadband's compensation has at null is part of the gain, and feedforward and
    corrections are outside the loop. The oil's resonance is that of the assumed model at the place.

    Args:
        model: the fitted model.
        settings: the control settings.
        gain: gain of the position loop, V/m.
        assumed: the assumed parameters.
        delay_s: time from a sample to the command that follows from it, s.
    """
    s = 1j * _GRID
    low = max(model.position - assumed.stroke_min, 0.0)
    high = max(assumed.stroke_max - model.position, 0.0)
    area = assumed.piston_area
    volumes = assumed.line_volume_1 + area * low, assumed.line_volume_2 + area * high
    stiffness = assumed.bulk_modulus * area**2 * sum(1.0 / volume for volume in volumes)
    natural = sqrt(stiffness / assumed.moving_mass)
    own = 0.5 * assumed.viscous / sqrt(stiffness * assumed.moving_mass)
    damping = max(own, _LEAST_DAMPING)
    resonance = 1.0 / (1.0 + 2.0 * damping * s / natural + (s / natural) ** 2)
    integral = 0.0 if settings.integral_time is None else 1.0 / (s * settings.integral_time)
    bent = 1.0
    if settings.deadband:
        bent += settings.deadband / (settings.deadband_width or settings.deadband)
    plant = model.speed_per_volt / s * np.exp(-s * (model.lag_s + delay_s)) * resonance
    return margins_of(plant * bent * gain * (1.0 + integral))


def margins_of(loop: NDArray[np.complex128]) -> Margins:
    """Return the margins of an open loop's response on the grid of frequencies.

    Args:
        loop: complex (n,), the response at each frequency of the grid.
    """
    size, phase = np.abs(loop), np.unwrap(np.angle(loop))
    phase -= 2.0 * pi * round((phase[0] + 0.5 * pi) / (2.0 * pi))
    # A phase of -180 degrees, and every further turn, is where the gain must be below 1.
    turns = np.floor((phase + pi) / (2.0 * pi))
    crossings = np.flatnonzero(np.diff(turns) != 0.0)
    gain_margin = min((-20.0 * log10(size[k : k + 2].max()) for k in crossings), default=inf)
    unity = np.flatnonzero((size[:-1] >= 1.0) != (size[1:] >= 1.0))
    phase_margin = min((float(pi + phase[k]) for k in unity), default=inf)
    crossover = float(_GRID[unity[0]]) if unity.size else 0.0
    return Margins(gain_margin, phase_margin, crossover)


def least_margins(
    settings: ControlSettings,
    gain: float,
    assumed: Parameters,
    delay_s: float,
    positions: tuple[float, ...],
) -> Margins:
    """Return the margins that the assumed model alone expects of a loop, the least of all places.

    The ram is taken to slide without load, where a volt moves it fastest, so that the loop's gain
    is at its greatest. No measurement enters: `rig tune` measures speed and lag on the rig.

    Args:
        settings: the control settings.
        gain: gain of the position loop, V/m.
        assumed: the assumed parameters.
        delay_s: time from a sample to the command that follows from it, s.
        positions: places of the stroke at which the loop is looked at, m; at least one.
    """
    speed, lag = velocity_gain(assumed), valve_lag(assumed)
    places = [LoopModel(at, True, speed, lag, 0.0, 0.0, 0.0) for at in positions]
    found = [margins(each, settings, gain, assumed, delay_s) for each in places]
    return Margins(
        min(each.gain_dB for each in found),
        min(each.phase for each in found),
        max(each.crossover for each in found),
    )
