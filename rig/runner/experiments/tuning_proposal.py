"""From what a tuning experiment measured to the control settings that it proposes."""

from collections.abc import Sequence
from dataclasses import replace
from math import floor, log10, pi
from typing import Final

import numpy as np

from control import ControlSettings, LoopModel, margins, velocity_gain
from rig.configuration import Rig
from rig.plant import TICK, Parameters
from rig.recording import Recording

GAIN_MARGIN_DB: Final = 12.0
PHASE_MARGIN: Final = pi / 3.0
"""Margins of a proposed gain: twice those that a loop must keep, as oil and friction change."""
MOST_STEP_UP: Final = 2.0
"""Greatest factor by which one tuning raises the gain: the next one measures again."""
_INTEGRAL_TIMES: Final = 4.0
"""Integral time in units of the reciprocal crossover: the integral lags the loop by 14 degrees."""
_TRUSTED: Final = 0.1
"""Part by which the measured speed for a volt may differ from the model's for the model's
feedforward to be proposed; beyond it the measured gain takes its place."""
_PASSED: Final = 0.8
"""Part of the tones' speed, by the stroke's speed for a volt, that must have passed for the valve
to count as free of play. Healthy rigs have 0.95 to 1.05, the misfit of the tones."""
_LEAST_V: Final = 0.01
"""Null and deadband below this are left out, V: a thousandth of the range of a valve."""
_LEAST_BAND_V: Final = 0.15
"""Deadband below this is left out, V. It is the difference of two numbers of 0.8 V, one of which is
known to 5 % (misfit of the tones), so that three times its error is 0.12 V."""
_FAST: Final = 0.8
"""Part of a motion's greatest speed from which on it is fast."""


def fast_motion(recording: Recording) -> tuple[float, float]:
    """Return the speed of a fast motion, m/s, and the command by which it goes so fast, V.

    They are medians over the samples with more than `_FAST` of the greatest speed, half the
    difference of both ways, so that a null bias cancels. Speeds are mean ones over 20 ms.
    """
    position, command = (recording.channels[name] for name in ("position_m", "command_V"))
    apart = round(0.01 / TICK)
    velocity = (position[2 * apart :] - position[: -2 * apart]) / (2 * apart * TICK)
    sent = command[apart:-apart]
    known = np.isfinite(velocity + sent)
    velocity, sent = velocity[known], sent[known]
    found = []
    for way in (1.0, -1.0):
        fast = way * velocity > _FAST * (way * velocity).max()
        found.append((float(np.median(velocity[fast])), float(np.median(sent[fast]))))
    (out_v, out_u), (back_v, back_u) = found
    return 0.5 * (out_v - back_v), 0.5 * (out_u - back_u)


def proposal(
    models: Sequence[LoopModel],
    fast: tuple[float, float],
    rig: Rig,
    assumed: Parameters,
    delay_s: float,
) -> tuple[ControlSettings, tuple[str, ...]]:
    """Return the proposed control settings, and remarks on them.

    The gain is the largest that keeps `GAIN_MARGIN_DB` and `PHASE_MARGIN` at every place, integral
    included, but at most `MOST_STEP_UP` times the present one. Null is the mean of the commands
    out and back; what is left of half their difference, after the tones' own gain has explained the
    speed, is the deadband.

    Args:
        models: of all stretches.
        fast: speed of a fast motion in m/s and its command in V, as `fast_motion` returns.
        rig: the rig, with its present control.
        assumed: the assumed parameters.
        delay_s: time from a sample to the command that follows from it, s.
    """
    present = rig.control.gain or rig.gain_V_per_m
    remarks = []
    null = null_of(models)
    passed = [each.speed_per_volt * (each.mean_V - null) / each.speed for each in models]
    swallowed = float(np.median(passed))
    models = as_fast_as_the_strokes(models)
    most = MOST_STEP_UP
    if swallowed < _PASSED:
        most = 1.0
        remarks.append(
            f"of the tones only {100.0 * swallowed:.0f} % passed, as with play in the valve; "
            "speeds are those of the strokes, and the gain is not raised"
        )
    pairs = _pairs(models)
    half = [0.5 * (a.mean_V - b.mean_V) for a, b in pairs]
    needed = [0.5 * (a.speed / a.speed_per_volt - b.speed / b.speed_per_volt) for a, b in pairs]
    deadband = float(np.median(np.subtract(half, needed)))
    band = _rounded(deadband) if deadband >= _LEAST_BAND_V else 0.0
    load = (assumed.coulomb + assumed.viscous * fast[0]) / assumed.piston_area
    believed = velocity_gain(assumed, load)
    measured = fast[0] / max(fast[1] - band, _LEAST_BAND_V)
    trusted = abs(measured / believed - 1.0) <= _TRUSTED
    if not trusted:
        remarks.append(
            f"at speed the ram moves by {1e3 * measured:.3g} mm/s for a volt, the model by "
            f"{1e3 * believed:.3g}; the feedforward is proposed as measured, and a model that fits "
            "would know load and friction too"
        )
    spread = max(abs(0.5 * (a.mean_V + b.mean_V) - null) for a, b in pairs)
    if spread > 0.1:
        remarks.append(
            f"null differs by {1e3 * spread:.0f} mV along the stroke, as with a load that grows; "
            "the integral makes up for it"
        )
    settings = ControlSettings(
        feedforward="model" if trusted else "none",
        feedforward_gain=None if trusted else _rounded(1.0 / measured),
        null=_rounded(null) if abs(null) >= _LEAST_V else 0.0,
        deadband=band,
        integral_time=1.0,
        cyclic=True,
    )
    settings = _with_gain(settings, models, present, most, assumed, delay_s)
    if settings.deadband and (settings.gain or 0.0) < present:
        settings = replace(settings, deadband=0.0)
        settings = _with_gain(settings, models, present, most, assumed, delay_s)
        remarks.append("a deadband is not bridged, as that would cost the loop its gain")
    if (settings.gain or 0.0) < 0.99 * present:
        remarks.append(f"the present gain of {present:g} V/m leaves less margin than is proposed")
    return settings, tuple(remarks)


def _with_gain(
    settings: ControlSettings,
    models: Sequence[LoopModel],
    present: float,
    most: float,
    assumed: Parameters,
    delay_s: float,
) -> ControlSettings:
    """Return the settings with the largest gain that keeps the margins of a proposal everywhere.

    It is between a tenth and `most` times the present gain, the tenth if none keeps the margins;
    the integral time follows from it.
    """
    speed = float(np.median([each.speed_per_volt for each in models]))
    for gain in present * np.geomspace(most, 0.1, 60):
        settings = replace(
            settings,
            gain=_rounded(gain),
            integral_time=_rounded(max(_INTEGRAL_TIMES / (speed * gain), 0.1)),
        )
        found = [margins(each, settings, gain, assumed, delay_s) for each in models]
        if all(m.gain_dB >= GAIN_MARGIN_DB and m.phase >= PHASE_MARGIN for m in found):
            break
    return settings


def null_of(models: Sequence[LoopModel]) -> float:
    """Return the command at which the valve is closed, V: the mean of the commands out and back.

    The models are those of the stretches out, then of the same stretches back in reverse order.
    """
    return float(np.median([0.5 * (a.mean_V + b.mean_V) for a, b in _pairs(models)]))


def _pairs(models: Sequence[LoopModel]) -> list[tuple[LoopModel, LoopModel]]:
    """Return the models of each place, out and back."""
    out = [each for each in models if each.extending]
    back = [each for each in models if not each.extending][::-1]
    return list(zip(out, back, strict=True))


def as_fast_as_the_strokes(models: Sequence[LoopModel]) -> tuple[LoopModel, ...]:
    """Return the models with a speed for a volt that is at least that of the strokes themselves.

    Play in the valve swallows small tones; a deadband makes a stroke look slower than it is.
    """
    null, found = null_of(models), []
    for model in models:
        sent = model.mean_V - null
        stroke = model.speed / sent if model.speed * sent > 0.0 else 0.0
        found.append(replace(model, speed_per_volt=max(model.speed_per_volt, stroke)))
    return tuple(found)


def calmer(settings: ControlSettings) -> ControlSettings:
    """Return the settings without the deadband's compensation; without one, with half the gain.

    What looked like a deadband may have been play, which its compensation turns into a switch.
    """
    if settings.deadband:
        return replace(settings, deadband=0.0)
    time_s = 2.0 * (settings.integral_time or 1.0)
    gain = 0.5 * (settings.gain or 0.0)
    return replace(settings, gain=_rounded(gain), integral_time=_rounded(time_s))


def _rounded(value: float) -> float:
    """Return a value with two significant digits."""
    if value == 0.0:
        return 0.0
    return round(float(value), 1 - floor(log10(abs(value))))
