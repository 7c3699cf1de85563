"""Motions of the rig that show effects: within the stroke, in closed loop, as campaigns hold them.

All are position setpoints, so that no effect, however large, lets the ram drift to an end. They are
drawn from one library: for the programme that identifies a rig, and for the experiment that
distinguishes two effects (`estimator.gap.verdict.experiments`).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from control import POSITION_GAIN, Multisine, Pseudorandom, Setpoint
from estimator.gap import Array, Motion
from rig.plant import TICK

MARGIN_M: Final = 0.02
"""How far motions stay from the limits of the stroke: the ram overshoots by less."""
EXPERIMENT_S: Final = 20.0
_GREATEST_V: Final = 9.0
"""Greatest command that a step may ask of the valve by the loop's gain: beyond the valve's range
no effects can be distinguished."""
_ROUNDED: Final = 4
"""Decimals of lengths in m: a campaign file holds what is run."""


@dataclass(frozen=True)
class Room:
    """Where the ram may go, and what holds it there.

    Attributes:
        low: m.
        high: m.
        gain: of the proportional position loop, V/m.
    """

    low: float
    high: float
    gain: float = POSITION_GAIN

    @property
    def middle(self) -> float:
        """The place from which there is most room, m."""
        return round(0.5 * (self.low + self.high), _ROUNDED)

    def part(self, share: float) -> float:
        """Return a share of the room, m."""
        return round(share * (self.high - self.low), _ROUNDED)


@dataclass(frozen=True)
class Stroke:
    """A named motion of the ram.

    Attributes:
        name: of it.
        about: what it does, in words.
        setpoint: in m.
        duration_s: of it.
    """

    name: str
    about: str
    setpoint: Multisine | Pseudorandom
    duration_s: float


def strokes(room: Room, seed: int = 0, duration_s: float = EXPERIMENT_S) -> dict[str, Stroke]:
    """Return the library of motions by name; another seed gives others of the same kind."""
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
    """Return the library as an experiment may use it; the chambers begin at `pressure` Pa."""
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
    """Return a setpoint at every tick, float64 (n,)."""
    return np.asarray(setpoint.sample(np.arange(round(duration_s / TICK)) * TICK))


def campaign_of(stroke: Stroke) -> dict[str, Any]:
    """Return the campaign file of one motion as nested mappings, without rig and model."""
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
    """Return the keys of a setpoint in a campaign file."""
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
