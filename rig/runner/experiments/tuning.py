"""Tunes the position loop of a rig: slow strokes with small tones upon them, a model, gains.

The ram strokes slowly over most of its range, in closed loop and within the rig's limits, with
tones upon the stroke that are too small to reverse it, so that it slides all the time. The linear
model of each stretch gives the margins; from them the gains follow. Then the ram is held, to see
that it does not hunt, and makes small steps and a sine under the present and under the proposed
control, side by side.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import floor, inf, pi
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from control import (
    Constant,
    ControlSettings,
    LoopModel,
    Margins,
    Multisine,
    Polyline,
    Quantity,
    Setpoint,
    Sine,
    Steps,
    margins,
    velocity_gain,
)
from faults import Campaign, CampaignTest
from rig.configuration import Rig, plain
from rig.plant import TICK, Model
from rig.recording import Recording
from rig.runner.campaign import Pace, StopFlag, plain_test
from rig.runner.outcomes import Observer, jsonable, step_answers

from .loop_fit import fitted_loop
from .parts import connected_parts, part_campaign, stroke_of
from .tuning_proposal import as_fast_as_the_strokes, calmer, fast_motion, proposal

Array = NDArray[np.float64]

SCHEMA: Final = "rig-tuning"
"""Value of the key `schema`, by which `tuning.json` is recognized."""
PLACES: Final = 3
"""Number of stretches along the stroke, each of which is fitted by itself, both ways."""
FREQUENCIES: Final = (1.0, 2.0, 3.0, 5.0, 8.0, 13.0)
"""Tones in Hz: whole numbers, so that a stretch of whole seconds holds whole periods; from about
the crossover of the thesis's loop (0.6 Hz) to where the encoder still counts the ram's motion."""
_TONE_V: Final = 0.25
"""Greatest sum of the tones in the command, V. By 0.07 m/(s V) it moves a ram at a third of
`_SPEED`, so that the stroke never reverses."""
_SPEED: Final = 0.05
"""Speed of the strokes, m/s: slow enough for several seconds in a stretch, and beyond the Stribeck
velocity of 0.04 m/s (table 2.1), where friction hardly depends on the speed."""
_REST_S: Final = 2.0
_SETTLE_S: Final = 3.0
_STROKE: Final = "strokes with tones"
_HOLD: Final = "hold"
_SINE: Final = "sine"

HUNTING_M: Final = 1e-4
"""Range in m of a held ram's position above which it hunts, beside a count of the encoder."""
_HOLD_S: Final = 20.0
_HELD_FROM_S: Final = 10.0
_MOST_HOLDS: Final = 4
"""Number of holds that are tried, under calmer and calmer control."""


@dataclass(frozen=True)
class StrokeWithTones:
    """A setpoint of slow strokes with small tones upon them.

    Attributes:
        stroke: the strokes, m.
        tones: what is added to them, m.
        quantity: a position.
    """

    stroke: Polyline
    tones: Multisine
    quantity: Quantity = "position"

    def sample(self, time_s: NDArray[np.floating[Any]]) -> Array:
        """Return the setpoint in m at each time in s, float64 in the shape of `time_s`."""
        return self.stroke.sample(time_s) + self.tones.sample(time_s)

    def peak_rate(self, duration_s: float) -> float:
        """Return an upper bound of the rate in m/s."""
        return self.stroke.peak_rate(duration_s) + self.tones.peak_rate(duration_s)


@dataclass(frozen=True)
class Response:
    """Error of the same motion under two controls.

    Attributes:
        name: name of the motion.
        time_s: (n,), s.
        setpoint: (n,), m.
        before: position under the present control, (n,), m.
        after: the same under the proposed one.
    """

    name: str
    time_s: Array
    setpoint: Array
    before: Array
    after: Array

    def rms(self) -> tuple[float, float]:
        """Return the rms error before and after, m."""
        before, after = (
            float(np.sqrt(np.nanmean((self.setpoint - each) ** 2)))
            for each in (self.before, self.after)
        )
        return before, after

    def steps(self) -> tuple[tuple[float, float], tuple[float, float]] | None:
        """Return the worst overshoot and settling time before, and after; None without steps.

        An overshoot is a part of its step. A step is settled, s, when the ram stays within 5 % of
        it; infinite if it did not before the next step.
        """
        found = []
        for each in (self.before, self.after):
            steps = step_answers(
                {"setpoint_m": self.setpoint, "position_m": each, "time_s": self.time_s}
            )
            if not steps:
                return None
            found.append((max(over for over, _ in steps), max(late_s for _, late_s in steps)))
        return found[0], found[1]


@dataclass(frozen=True)
class Tuning:
    """The results of a tuning experiment.

    Attributes:
        rig: name of the rig.
        models: the linear model of each stretch.
        present, proposed: control settings, with their gains.
        margins_before, margins_after: margins of each stretch's model under them.
        responses: the same motions under both.
        remarks: what a reader should know, a sentence each.
        recordings: paths of the recordings, relative to the experiment's folder.
        hunts: whether a held ram swings under the proposed control.
        swing_m: range of the held ram's position under the proposed control, m; infinite if no
            reading of it was recorded.
        swing_limit_m: the range from which on it is said to hunt, m.
    """

    rig: str
    models: tuple[LoopModel, ...]
    present: ControlSettings
    proposed: ControlSettings
    margins_before: tuple[Margins, ...]
    margins_after: tuple[Margins, ...]
    responses: tuple[Response, ...]
    remarks: tuple[str, ...]
    recordings: tuple[str, ...]
    hunts: bool = False
    swing_m: float = 0.0
    swing_limit_m: float = HUNTING_M

    @property
    def safe(self) -> bool:
        """Whether the proposed control keeps its margins everywhere, and a held ram rests."""
        return all(each.kept for each in self.margins_after) and not self.hunts


def exciting_campaign(rig: Rig, assumed: Model, seed: int = 0) -> Campaign:
    """Return the campaign of the strokes with tones, and of a sine under the present control."""
    setpoint = _exciting(rig, assumed, seed)
    duration_s = setpoint.stroke.times_s[-1]
    test = plain_test(_STROKE, setpoint, duration_s, setpoint.stroke.values[0], _SETTLE_S, seed)
    if rig.control.gain is not None:
        test = replace(test, control=ControlSettings(gain=rig.control.gain))
    motion, sine_s = response_motions(rig, assumed)[_SINE]
    start = float(motion.sample(np.zeros(1))[0])
    sine = plain_test(f"{_SINE} before", motion, sine_s, start, _SETTLE_S, seed)
    tests = [test, replace(sine, control=rig.control)]
    return part_campaign("tones", "Slow strokes with small tones, a sine.", rig, assumed, tests)


def _exciting(rig: Rig, assumed: Model, seed: int) -> StrokeWithTones:
    """Return the strokes, one out and one back, and tones whose part of the command is small."""
    gain = rig.control.gain or rig.gain_V_per_m
    amplitude = _TONE_V / gain
    low, high = stroke_of(rig)
    low, high = low + amplitude, high - amplitude
    slow = min(_SPEED, 0.2 * velocity_gain(assumed.parameters) * rig.limits.command_V)
    times = np.cumsum([0.0, _REST_S, (high - low) / slow, _REST_S, (high - low) / slow, _REST_S])
    stroke = Polyline(tuple(times), (low, low, high, high, low, low))
    return StrokeWithTones(stroke, Multisine(0.0, amplitude, FREQUENCIES, seed))


def stretches_of(setpoint: StrokeWithTones) -> list[tuple[slice, bool]]:
    """Return the ticks of each stretch that is fitted, and whether the ram extends in it.

    A stretch has whole seconds; the first of each stroke, in which the loop settles, is left out.
    """
    found = []
    times = setpoint.stroke.times_s
    for begin, end, extending in ((times[1], times[2], True), (times[3], times[4], False)):
        seconds = max(floor((end - begin - 1.0) / PLACES), 1)
        for place in range(PLACES):
            first = round((begin + 1.0 + place * seconds) / TICK)
            found.append((slice(first, first + round(seconds / TICK)), extending))
    return found


def response_motions(rig: Rig, assumed: Model) -> dict[str, tuple[Setpoint, float]]:
    """Return the motions that are compared, with their durations in s, by their names."""
    low, high = stroke_of(rig)
    middle = 0.5 * (low + high)
    step = min(0.02, 0.1 * (high - low))
    amplitude = min(0.15, 0.4 * (high - low))
    fastest = velocity_gain(assumed.parameters) * rig.limits.command_V
    frequency = min(0.5, 0.6 * fastest / (2.0 * pi * amplitude))
    return {
        "steps": (Steps((middle, middle + step, middle - step, middle), 2.0), 8.0),
        _SINE: (Sine(middle, amplitude, round(frequency, 3)), 16.0),
    }


def response_campaign(
    rig: Rig, assumed: Model, proposed: ControlSettings, seed: int = 0
) -> Campaign:
    """Return the campaign of small steps under both controls, and a sine under the proposed one.

    The sine under the present control belongs to `exciting_campaign`.
    """
    tests: list[CampaignTest] = []
    for name, (setpoint, duration_s) in response_motions(rig, assumed).items():
        start = float(setpoint.sample(np.zeros(1))[0])
        test = plain_test(name, setpoint, duration_s, start, _SETTLE_S, seed)
        if name != _SINE:
            tests.append(replace(test, name=f"{name} before", control=rig.control))
        tests.append(replace(test, name=f"{name} after", control=proposed))
    return part_campaign("response", "The present and the proposed control.", rig, assumed, tests)


def run_tuning(
    rig: Rig,
    assumed: Model,
    directory: Path,
    *,
    pace: Pace | None = None,
    observer: Observer | None = None,
    stop: StopFlag | None = None,
    seed: int = 0,
) -> Tuning:
    """Run the tuning experiment on a rig and return its results.

    Args:
        rig: a simulated rig, or one on hardware.
        assumed: the assumed model.
        directory: an existing folder; each part of the experiment gets a folder in it.
        pace: "real" to run at the wall clock, "fast" to run as fast as possible; the pace of the
            rig's file if not given.
        observer: its methods are called as the experiment goes on.
        stop: once a stop is requested on it, the experiment ends after the present batch.
        seed: sets the tones' phases and the noise of a simulated rig.

    Raises:
        ExperimentStoppedError: the rig tripped in a test, the experiment was stopped, or a test
            crashed.
        DirectoryError: a folder of the experiment cannot be used.
        DriverError: a device of the rig is missing, or is not the configured one.
        TripError: the rig tripped before or between the tests.
        OSError: the results cannot be written.
    """
    exciting = exciting_campaign(rig, assumed, seed)
    # On hardware a command follows from the sample before it (docs/decisions/0007).
    delay_s = TICK if rig.backend == "hardware" else 0.0
    swing_limit = HUNTING_M + rig.sensors.position_resolution
    with connected_parts(exciting, rig, directory, pace, observer, stop) as parts:
        setpoint = _exciting(rig, assumed, seed)
        compared = parts.run(exciting)
        models = fitted_models(compared[_STROKE], setpoint)
        fast = fast_motion(compared[f"{_SINE} before"])
        proposed, remarks = proposal(models, fast, rig, assumed.parameters, delay_s)
        models = as_fast_as_the_strokes(models)
        for attempt in range(1, _MOST_HOLDS + 1):
            held = parts.run(hold_campaign(rig, assumed, proposed, attempt, seed))
            swing = _swing(held[_HOLD])
            if swing <= swing_limit:
                break
            remarks = (*remarks, _hunting(swing, proposed, attempt))
            if attempt < _MOST_HOLDS:
                proposed = calmer(proposed)
        compared |= parts.run(response_campaign(rig, assumed, proposed, seed))
    gain = rig.control.gain or rig.gain_V_per_m
    names = response_motions(rig, assumed)
    return Tuning(
        rig=rig.name,
        models=models,
        present=replace(rig.control, gain=gain),
        proposed=proposed,
        margins_before=tuple(
            margins(each, rig.control, gain, assumed.parameters, delay_s) for each in models
        ),
        margins_after=tuple(
            margins(each, proposed, proposed.gain or gain, assumed.parameters, delay_s)
            for each in models
        ),
        responses=tuple(
            _response(name, compared[f"{name} before"], compared[f"{name} after"]) for name in names
        ),
        remarks=remarks,
        recordings=tuple(parts.recordings),
        hunts=swing > swing_limit,
        swing_m=swing,
        swing_limit_m=swing_limit,
    )


def hold_campaign(
    rig: Rig, assumed: Model, proposed: ControlSettings, attempt: int, seed: int = 0
) -> Campaign:
    """Return the campaign of a hold at mid stroke under the proposed control.

    It is named by `attempt`, counted from 1, as each has a folder of its own.
    """
    low, high = stroke_of(rig)
    middle = 0.5 * (low + high)
    test = plain_test(_HOLD, Constant(middle), _HOLD_S, middle, _SETTLE_S, seed)
    name = f"hold-{attempt}"
    return part_campaign(
        name, "A hold, to see whether it hunts.", rig, assumed, [replace(test, control=proposed)]
    )


def _swing(recording: Recording) -> float:
    """Return the range of the position in a hold, m, without the time in which it settles.

    Ticks that were missed have no position. If none has one, the range is infinite.
    """
    late = recording.time_s - recording.time_s[0] >= _HELD_FROM_S
    found = recording.channels["position_m"][late]
    found = found[np.isfinite(found)]
    return float(np.ptp(found)) if found.size else inf


def _hunting(swing: float, tried: ControlSettings, attempt: int) -> str:
    what = "its half is tried" if attempt < _MOST_HOLDS else "no less is tried"
    law = f"{tried.gain:g} V/m"
    if tried.deadband:
        law, what = f"{law} and a deadband bridged", "it is tried without"
    return (
        f"with {law} a held ram swings by {1e3 * swing:.2g} mm, as with play in valve "
        f"or encoder; {what}"
    )


def fitted_models(recording: Recording, setpoint: StrokeWithTones) -> tuple[LoopModel, ...]:
    """Return the linear model of each stretch of a recording of the strokes with tones.

    Samples that are missing are interpolated.
    """
    channels = recording.channels
    ticks = np.arange(recording.time_s.size)
    columns = []
    for name in ("position_m", "command_V"):
        known = np.isfinite(channels[name])
        columns.append(np.interp(ticks, ticks[known], channels[name][known]))
    return tuple(
        fitted_loop(columns[0][part], columns[1][part], FREQUENCIES, extending)
        for part, extending in stretches_of(setpoint)
    )


def _response(name: str, before: Recording, after: Recording) -> Response:
    count = min(before.time_s.size, after.time_s.size)
    return Response(
        name=name,
        time_s=before.time_s[:count],
        setpoint=before.channels["setpoint_m"][:count],
        before=before.channels["position_m"][:count],
        after=after.channels["position_m"][:count],
    )


def tuning_figures(tuning: Tuning) -> dict[str, Any]:
    """Return the results as JSON-able values in SI; other programs rely on the keys."""

    def of(found: Sequence[Margins]) -> list[dict[str, float]]:
        return [
            {
                "gain_margin_dB": each.gain_dB,
                "phase_margin_deg": float(np.degrees(each.phase)),
                "crossover_Hz": each.crossover / (2.0 * pi),
            }
            for each in found
        ]

    content = {
        "schema": SCHEMA,
        "rig": tuning.rig,
        "safe": tuning.safe,
        "hunts": tuning.hunts,
        "hold_swing_m": tuning.swing_m,
        "models": [plain(each) for each in tuning.models],
        "present": plain(tuning.present),
        "proposed": plain(tuning.proposed),
        "margins_before": of(tuning.margins_before),
        "margins_after": of(tuning.margins_after),
        "rms_error_m": {
            each.name: dict(zip(("before", "after"), each.rms(), strict=True))
            for each in tuning.responses
        },
        "steps": {
            each.name: {
                when: dict(zip(("overshoot", "settling_s"), found, strict=True))
                for when, found in zip(("before", "after"), steps, strict=True)
            }
            for each in tuning.responses
            if (steps := each.steps())
        },
        "remarks": list(tuning.remarks),
        "recordings": list(tuning.recordings),
    }
    return dict(jsonable(content))
