"""From a rig's control settings and a model to the numbers that the tracking law works with."""

from math import inf, pi
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.plant import TICK, Parameters, SensorParameters

from .expected import expected_position
from .loop_model import feedforward_command, frequencies_of, hold_band, loop_answer
from .setpoints import Setpoint
from .settings import ControlSettings
from .tracking import PLAIN, TONE_NUMBERS, ControlLaw, Guide

Array = NDArray[np.float64]

_LEARNING_PERIODS: Final = 2.0
"""Least time constant of a tone's correction, in periods of the tone: the error's amplitude is a
mean over a period, so that a faster correction would answer to the tone itself."""
_LEAST_ANSWER: Final = 0.3
"""Least part of a correction that reaches the ram for a frequency to be corrected. Above the loop's
crossover, 0.3 is at three times of it, a correction must be much larger than its error, and play
may turn its phase so far that it would grow up to its limit."""
_RESTING_TIMES: Final = 3.0
"""Integral times of rest after which the integral is held: what it would still do is 5 %."""
_CORRECTED_PART: Final = 0.25
"""Part of the greatest command that a tone's correction may ask for. A supply 30 % lower, or a leak
of some litres a minute, takes a fifth to a third of a rig's speed for a volt: a motion that
needs three quarters of the greatest command by the model then needs up to the whole of it."""
_LEAST_WIDTH_V: Final = 1e-3
"""Least width of the smooth part about null, V, where there is no deadband to compensate."""


def _tones(
    setpoint: Setpoint, settings: ControlSettings, par: Parameters, gain: float, limit: float
) -> Array:
    tones = []
    greatest = settings.cyclic_limit
    if greatest is None:
        greatest = _CORRECTED_PART * limit / gain
    for frequency in frequencies_of(setpoint) if settings.cyclic else ():
        answer = loop_answer(frequency, par, gain, settings)
        if abs(answer) < _LEAST_ANSWER:
            continue
        time_s = max(settings.cyclic_time, _LEARNING_PERIODS / frequency)
        # The step is twice the error's part at the frequency, over what the loop makes of it.
        factor = 2.0 * TICK / time_s / answer
        tones.append((2.0 * pi * frequency, factor.real, factor.imag, greatest))
    return np.array(tones, np.float64).reshape(-1, TONE_NUMBERS)


def law_of(
    settings: ControlSettings, par: Parameters, sensors: SensorParameters, gain: float
) -> ControlLaw:
    """Return the numbers of the tracking law.

    Args:
        settings: the control settings.
        par: the parameters of the model that the loop assumes, SI.
        sensors: data sheet of the transducers.
        gain: gain of the position loop, V/m.
    """
    band, width = settings.hold_band, settings.deadband_width
    return ControlLaw(
        proportional=False,
        null_V=float(settings.null),
        deadband_V=float(settings.deadband),
        width_V=float(max(settings.deadband if width is None else width, _LEAST_WIDTH_V)),
        integral_rate=gain / (settings.integral_time or inf),
        integral_limit_V=float(settings.integral_limit),
        hold_band_m=float(hold_band(par, sensors) if band is None else band),
        rest_s=_RESTING_TIMES * (settings.integral_time or 0.0),
    )


def guide_of(
    setpoint: Setpoint,
    samples: Array,
    settings: ControlSettings,
    par: Parameters,
    sensors: SensorParameters,
    gain: float,
    limit: float,
    compiled: bool = True,
) -> Guide:
    """Return the guide of a test: law, feedforward, tones and expected position.

    With settings that add nothing, or a setpoint that is the command itself, it is `PLAIN`.

    Args:
        setpoint: the test's setpoint.
        samples: (ticks,) the setpoint, m, one a tick.
        settings: the control settings.
        par: the parameters of the model that the loop assumes, with the test's spring, SI.
        sensors: data sheet of the transducers.
        gain: gain of the position loop, V/m.
        limit: greatest command of either sign, V.
        compiled: whether the expected position is computed by compiled code, as
            `control.expected.expected_position`.
    """
    if settings.is_proportional or setpoint.quantity != "position":
        return PLAIN
    return Guide(
        law_of(settings, par, sensors, gain),
        feedforward_command(samples, settings, par, limit),
        _tones(setpoint, settings, par, gain, limit),
        expected_position(samples, settings, par, gain, limit, compiled),
    )


class LoopBasis(NamedTuple):
    """What the tables of a motion are made from, beside its setpoint."""

    settings: ControlSettings
    """The control settings."""
    par: Parameters
    """The parameters of the model that the loop assumes, SI."""
    gain: float
    """Gain of the position loop, V/m."""
    limit: float
    """Greatest command of either sign, V."""


def moving_guide(law: ControlLaw, basis: LoopBasis | None, setpoint: Array) -> Guide:
    """Return the guide of a move to the start position of a test.

    The move has feedforward and expected position as the test has. Without them the ram would lag
    the move, the integral part would sum that up, and the ram would begin the test as far off as
    the integral then is. There are no tones.

    Args:
        law: that of the test.
        basis: what the move's tables are made from; without it the move has none.
        setpoint: (ticks,) of the move, m.
    """
    alone = PLAIN._replace(law=law)
    if law.proportional or basis is None:
        return alone
    settings, par, gain, limit = basis
    return alone._replace(
        feedforward=feedforward_command(setpoint, settings, par, limit),
        expected=expected_position(setpoint, settings, par, gain, limit),
    )
