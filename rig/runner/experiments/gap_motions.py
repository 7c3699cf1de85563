"""Defines a library of motions of the ram that make effects visible in recordings.

All are position setpoints within the stroke, in closed loop, so that no effect, however large, lets
the ram drift to an end. The programme that identifies a rig uses the library, and so does the
experiment that distinguishes two effects (`estimator.gap.verdict.experiments`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from control import POSITION_GAIN, Multisine, Pseudorandom, Setpoint
from estimator.gap import Array, Motion
from rig.plant import TICK

MARGIN_M: Final = 0.02
"""Distance of the motions from the limits of the stroke, m; the ram overshoots by less."""
EXPERIMENT_S: Final = 20.0
"""Duration of a motion, s."""
_GREATEST_V: Final = 9.0
"""Greatest command that a step may cause by the loop's gain, V; effects cannot be distinguished
while the command is limited to the valve's range."""
_ROUNDED: Final = 4
"""Decimals of lengths in m, so that a campaign file can hold exactly what is run."""


@dataclass(frozen=True)
class Room:
    """The range of positions in which the ram may move, and the gain of its position loop.

    Attributes:
        low: lowest position, m.
        high: highest position, m.
        gain: gain of the proportional position loop, V/m.
    """

    low: float
    high: float
    gain: float = POSITION_GAIN

    @property
    def middle(self) -> float:
        """The position in the middle of the range, m, rounded to 0.1 mm."""
        return round(0.5 * (self.low + self.high), _ROUNDED)

    def part(self, share: float) -> float:
        """Return the length of a share, from 0 to 1, of the range, m, rounded to 0.1 mm."""
        return round(share * (self.high - self.low), _ROUNDED)


@dataclass(frozen=True)
class Stroke:
    """A named motion of the ram.

    Attributes:
        name: name of the motion in the library.
        about: description of the motion in words.
        setpoint: setpoint of the position, m.
        duration_s: duration, s.
    """

    name: str
    about: str
    setpoint: Multisine | Pseudorandom
    duration_s: float


def strokes(room: Room, seed: int = 0, duration_s: float = EXPERIMENT_S) -> dict[str, Stroke]:
    """Return the library of motions, by their names.

    Args:
        room: the range in which the ram may move, with the gain by which steps are limited.
        seed: sets the phases or the random steps of the motions.
        duration_s: duration of each motion, s.
    """
    middle, stroke = room.middle, room.part(1.0)
    step = min(0.16 * stroke, 0.5 * _GREATEST_V / room.gain)
    near = room.part(0.1)

    def waves(mean: float, amplitude: float, *frequencies: float) -> Multisine:
        return Multisine(round(mean, _ROUNDED), round(amplitude, _ROUNDED), frequencies, seed)

    def steps(reach: float, shortest_s: float, longest_s: float) -> Pseudorandom:
        low, high = round(middle - reach, _ROUNDED), round(middle + reach, _ROUNDED)
        return Pseudorandom(low, high, shortest_s, longest_s, seed)

    found = (
        ("wide strokes", "fast strokes over most of the stroke",
         waves(middle, 0.36 * stroke, 0.11, 0.29, 0.53)),
        ("slow reversals", "slow strokes that reverse often, the ram sticking in between",
         waves(middle, 0.1 * stroke, 0.041, 0.093, 0.17)),
        ("creeping", "strokes of a few mm about null, slow",
         waves(middle, 0.006 * stroke, 0.11, 0.27)),
        ("small fast strokes", "strokes of a few mm at up to 10 Hz",
         waves(middle, 0.018 * stroke, 1.9, 4.3, 9.7)),
        ("small steps", "steps of a few cm after short times",
         steps(0.4 * step, 0.15, 0.7)),
        ("large steps", "steps that open the valve nearly full",
         steps(step, 0.6, 1.6)),
        ("near the retracted end", "quick strokes where chamber 1 is small",
         waves(room.low + near, 0.9 * near, 0.23, 0.71, 1.7)),
        ("near the extended end", "quick strokes where chamber 2 is small",
         waves(room.high - near, 0.9 * near, 0.23, 0.71, 1.7)),
    )  # fmt: skip
    return {name: Stroke(name, about, setpoint, duration_s) for name, about, setpoint in found}


def motions(room: Room, pressure: float, duration_s: float = EXPERIMENT_S) -> tuple[Motion, ...]:
    """Return the library of motions in the form that the search for an experiment takes.

    Args:
        room: the range in which the ram may move.
        pressure: pressure of both chambers at the start, Pa.
        duration_s: duration of each motion, s.
    """
    return tuple(_motion(stroke, pressure) for stroke in strokes(room, 1, duration_s).values())


def _motion(stroke: Stroke, pressure: float) -> Motion:
    setpoint = sampled(stroke.setpoint, stroke.duration_s)
    count = len(setpoint)
    pressures, spool = np.full(count, pressure), np.zeros(count)
    return Motion(
        stroke.name,
        stroke.about,
        np.zeros((count, 1)),
        np.column_stack([setpoint, pressures, pressures, spool]),
        campaign_of(stroke),
    )


def sampled(setpoint: Setpoint, duration_s: float) -> Array:
    """Return the values of a setpoint at every tick for a duration in s, float64 (n,)."""
    return np.asarray(setpoint.sample(np.arange(round(duration_s / TICK)) * TICK))


def campaign_of(stroke: Stroke) -> dict[str, Any]:
    """Return the content of a campaign file with one motion, without the keys of rig and model."""
    test = {
        "name": stroke.name,
        "duration": f"{stroke.duration_s:g} s",
        "setpoint": dict(_keys(stroke.setpoint)),
    }
    return {
        "name": f"gap {stroke.name}".replace(" ", "_"),
        "description": f"Experiment of rig gap: {stroke.about}.",
        "tests": [test],
    }


def _keys(setpoint: Multisine | Pseudorandom) -> Mapping[str, Any]:
    """Return a setpoint as the mapping that a campaign file has for it."""
    if isinstance(setpoint, Multisine):
        return {
            "type": "multisine",
            "mean": f"{setpoint.mean:g} m",
            "amplitude": f"{setpoint.amplitude:g} m",
            "frequencies": [f"{frequency:g} Hz" for frequency in setpoint.frequencies_hz],
            "seed": setpoint.seed,
        }
    return {
        "type": "pseudorandom",
        "lower": f"{setpoint.lower:g} m",
        "upper": f"{setpoint.upper:g} m",
        "hold": [f"{setpoint.hold_min_s:g} s", f"{setpoint.hold_max_s:g} s"],
        "seed": setpoint.seed,
    }
