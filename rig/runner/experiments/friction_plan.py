"""Plans the motions of the friction experiment (thesis, section 3.1) within a rig's limits.

All lengths, speeds and times follow from the limits of the stroke and from the speed that the
model's valve gives the ram, so that the plan fits any rig.
"""

from math import pi
from typing import Final

import numpy as np

from control import Constant, Polyline, Quantity, Setpoint, Sine
from estimator.friction import Stroke
from faults import Campaign
from rig.configuration import Rig, valve_speed
from rig.plant import Model
from rig.runner.campaign import plain_test

from .parts import part_campaign, stroke_of

PLACES: Final = 10
"""Number of positions along the stroke at which break-aways are measured (section 3.1)."""
SPEEDS: Final = (0.03, 0.06, 0.1, 0.16, 0.24, 0.3, 0.37, 0.45, 0.54, 0.65)
"""Constant speeds, as shares of the ram's speed with the valve fully open. Below 0.25 a ram with
the thesis's friction sticks and slips; its friction at such speeds is measured as it slows down."""
CREEP_SPEED: Final = 8.4e-4
"""Speed that the ramp's greatest command would give an unloaded ram, m/s. The oil that flows in
during half a ramp is 5 mm of stroke: 2 mm compress the oil against stiction, the rest moves the
ram."""
RAMP_S: Final = 24.0
"""Duration of a ramp of the command up, down, and back to null, s."""
LOOP_SPEED: Final = 0.014
"""Speed that the greatest command of a ramp in closed loop would give an unloaded ram, m/s. On the
rig of table 2.1 that command is 0.2 V, or 5.6 um of spool. The loop keeps the ram from moving
far."""
LOOP_RAMP_S: Final = 80.0
"""Duration of a ramp of the setpoint up, down, and back, s."""

_SINE_S: Final = 60.0
_SINE_AMPLITUDE_M: Final = 0.2
_SINE_HZ: Final = 0.5
_SINE_SPEED: Final = 0.9
_NULL_S: Final = 8.0
_STROKE_S: Final = 3.0
_STROKE_M: Final = 0.5
_REST_S: Final = 1.0
_REPEATS: Final = 2
_SETTLE_S: Final = 3.0

_Motion = tuple[str, Setpoint, float, float]
"""A motion: its name, its setpoint, its duration in s, and where the ram settles before it, m."""

SLOWING_DOWN: Final = "slowing down"
NULL: Final = "valve null"


def sliding_campaign(
    rig: Rig, assumed: Model, *, speeds: tuple[float, ...] = SPEEDS, seed: int = 0
) -> Campaign:
    """Return the campaign of a hold, of slowing down from fast strokes, and of constant speeds.

    The hold shows the command at which the ram rests.

    Args:
        rig: the rig, within whose limits the motions stay.
        assumed: the model, from which the greatest speed of the ram follows.
        speeds: constant speeds, as shares of that greatest speed.
        seed: sets the noise of a simulated rig.
    """
    low, high = stroke_of(rig)
    fastest = valve_speed(assumed.parameters, rig.limits.command_V)
    amplitude = min(_SINE_AMPLITUDE_M, 0.5 * (high - low))
    middle = 0.5 * (low + high)
    frequency = min(_SINE_HZ, _SINE_SPEED * fastest / (2.0 * pi * amplitude))
    motions: list[_Motion] = [
        (NULL, Constant(middle), _NULL_S, middle),
        (SLOWING_DOWN, Sine(middle, amplitude, frequency), _SINE_S, middle),
    ]
    for share in speeds:
        motion, _ = strokes_at(share * fastest, low, high)
        name = f"constant {1e3 * share * fastest:.0f} mm per s"
        motions.append((name, motion, motion.times_s[-1], motion.values[0]))
    description = "Strokes of the friction curve (section 3.1)."
    return _campaign("sliding", description, rig, assumed, motions, seed)


def strokes_at(speed: float, low: float, high: float) -> tuple[Polyline, tuple[Stroke, ...]]:
    """Return a setpoint of strokes out and back at a constant speed, and the times of the strokes.

    The ram goes out and back twice about the middle, with a rest of 1 s before and after each
    stroke. A stroke is as long as the range, but at most 0.5 m and 3 s.

    Args:
        speed: constant speed of the strokes, m/s.
        low: lowest position, m.
        high: highest position, m.
    """
    length = min(_STROKE_M, high - low, speed * _STROKE_S)
    start = 0.5 * (low + high - length)
    times, values, strokes = [0.0], [start], []
    for index in range(2 * _REPEATS):
        begin = times[-1] + _REST_S
        end = begin + length / speed
        times += [begin, end]
        values += [values[-1], start if index % 2 else start + length]
        strokes.append(Stroke(begin, end))
    times.append(times[-1] + _REST_S)
    values.append(values[-1])
    return Polyline(tuple(times), tuple(values)), tuple(strokes)


def strokes_of(rig: Rig, assumed: Model, share: float) -> tuple[Stroke, ...]:
    """Return begin and end, s of the test, of the strokes in the test of one constant speed.

    Args:
        rig: the rig, within whose limits the strokes stay.
        assumed: the model, from which the greatest speed of the ram follows.
        share: the speed as a share of the greatest one, such as one of `SPEEDS`.
    """
    fastest = valve_speed(assumed.parameters, rig.limits.command_V)
    return strokes_at(share * fastest, *stroke_of(rig))[1]


def places_of(rig: Rig, null_V: float, count: int = PLACES) -> tuple[float, ...]:  # noqa: N803
    """Return the positions at which break-aways are measured, m, evenly spaced along the stroke.

    A position loop without an integral part rests beside its setpoint, by null command over gain;
    both setpoint and ram stay within the rig's limits.

    Args:
        rig: the rig.
        null_V: command at which the ram rests, V.
        count: number of positions.
    """
    low, high = stroke_of(rig)
    off = null_V / rig.gain_V_per_m
    ends = low + max(-off, 0.0), high - max(off, 0.0)
    return tuple(float(place) for place in np.linspace(*ends, count))


def break_away_campaign(
    rig: Rig,
    assumed: Model,
    null_V: float,  # noqa: N803
    places: tuple[float, ...],
    *,
    seed: int = 0,
) -> Campaign:
    """Return the campaign of slow ramps of the command about the null command.

    Each position has one test with one ramp: up, down below the null command, and back.

    Args:
        rig: the rig.
        assumed: the model, from which the speed of the ram for a command follows.
        null_V: command at which the ram rests, V.
        places: positions at which the ramps begin, m.
        seed: sets the noise of a simulated rig.
    """
    off = null_V / rig.gain_V_per_m
    top = CREEP_SPEED / valve_speed(assumed.parameters, 1.0)
    ramp = _up_and_down(null_V, top, RAMP_S, "command")
    motions: list[_Motion] = [
        (f"break-away at {1e3 * place:.0f} mm", ramp, RAMP_S, place + off) for place in places
    ]
    description = "Break-away force along the stroke (section 3.1)."
    return _campaign("break_away", description, rig, assumed, motions, seed)


def closed_loop_campaign(
    rig: Rig,
    assumed: Model,
    null_V: float,  # noqa: N803
    places: tuple[float, ...],
    *,
    seed: int = 0,
) -> Campaign:
    """Return the campaign of ramps of the setpoint with the loop closed, one for each position.

    It is run at the positions where ramps of the command did not move the ram. A position too near
    a limit is moved inwards, and positions that coincide then are run once. While the ram sticks,
    the loop turns the slow ramp of the setpoint into a slow ramp of the command, which passes even
    an overlap or underlap of the spool. After the break-away the ram follows the setpoint.

    Args:
        rig: the rig.
        assumed: the model, from which the speed of the ram for a command follows.
        null_V: command at which the ram rests, V.
        places: positions at which the ram rests before a ramp, m.
        seed: sets the noise of a simulated rig.
    """
    low, high = stroke_of(rig)
    reach = _loop_reach(rig, assumed)
    off = null_V / rig.gain_V_per_m
    # Setpoint and ram both stay within the limits, in both directions.
    first, last = low + reach + max(-off, 0.0), high - reach - max(off, 0.0)
    kept = sorted({min(max(place, first), last) for place in places})
    motions: list[_Motion] = [
        (
            f"break-away at {1e3 * place:.0f} mm in closed loop",
            _up_and_down(place + off, reach, LOOP_RAMP_S, "position"),
            LOOP_RAMP_S,
            place + off,
        )
        for place in kept
    ]
    description = "Break-away where ramps of the command did not move the ram."
    return _campaign("break_away_closed_loop", description, rig, assumed, motions, seed)


def ramp_slope(rig: Rig, assumed: Model, *, closed_loop: bool = False) -> float:
    """Return the absolute slope of the command in a ramp while the ram is at rest, V/s.

    With `closed_loop` the ramp is one of the setpoint, which the loop's gain turns into a command.
    """
    if closed_loop:
        return 4.0 * _loop_reach(rig, assumed) * rig.gain_V_per_m / LOOP_RAMP_S
    return 4.0 * CREEP_SPEED / valve_speed(assumed.parameters, 1.0) / RAMP_S


def _loop_reach(rig: Rig, assumed: Model) -> float:
    """Return how far a ramp of the setpoint goes each way, m.

    That is at most a twelfth of the range in which an experiment may move the ram.
    """
    low, high = stroke_of(rig)
    reach = LOOP_SPEED / valve_speed(assumed.parameters, 1.0) / rig.gain_V_per_m
    return min(reach, (high - low) / 12.0)


def _up_and_down(middle: float, reach: float, period_s: float, quantity: Quantity) -> Polyline:
    corners = tuple(share * period_s for share in (0.0, 0.25, 0.75, 1.0))
    return Polyline(corners, (middle, middle + reach, middle - reach, middle), quantity)


def _campaign(
    name: str, description: str, rig: Rig, assumed: Model, motions: list[_Motion], seed: int
) -> Campaign:
    # Each test gets noise that differs from that of the others.
    seeds = np.random.SeedSequence([seed, len(name)]).generate_state(len(motions))
    tests = [
        plain_test(*motion, _SETTLE_S, int(drawn))
        for motion, drawn in zip(motions, seeds, strict=True)
    ]
    return part_campaign(f"friction_{name}", description, rig, assumed, tests)
