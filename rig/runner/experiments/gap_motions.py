"""Defines the library of motions of the ram that `rig gap` runs within a rig's limits.

All are position setpoints within the stroke, in closed loop, so that no effect, however large, lets
the ram drift to an end. The programme of `rig gap --live` uses the library, and so does the
experiment that distinguishes two effects (`estimator.gap.verdict.experiments`). The programme
excites all effects of the catalogue: fast strokes (flows, supply), steps (valve, delays), slow
reversals (friction), small fast strokes (valve, play).
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from control import POSITION_GAIN, Multisine, Pseudorandom, Setpoint
from estimator.gap import Array, Motion
from faults import Campaign
from rig.configuration import Rig
from rig.plant import TICK, Model
from rig.runner.campaign import plain_test

from .parts import part_campaign, stroke_of

_GREATEST_V: Final = 9.0
"""Greatest command that a step may cause by the loop's gain, V; effects cannot be distinguished
while the command is limited to the valve's range."""
_SETTLE_S: Final = 2.0
_ROUNDED: Final = 4
"""Decimals of lengths in m, so that a campaign file can hold exactly what is run."""


Motions = tuple[tuple[str, float], ...]
"""Motions of the library to be run, each by its name and its duration in s."""

FITTED: Final[Motions] = (
    ("wide strokes", 25.0),
    ("small steps", 15.0),
    ("slow reversals", 20.0),
    ("small fast strokes", 10.0),
)
"""The programme's motions to whose recordings the model is fitted."""
HELD: Final[Motions] = (("wide strokes", 10.0), ("small steps", 10.0))
"""Motions whose recordings are held out; they are run once, for all rounds."""
CHECK: Final[Motions] = (("wide strokes", 20.0), ("small steps", 10.0))
"""Motions on which a revised model is checked; each check runs them anew with other phases."""
EXPERIMENT_S: Final = 20.0
"""Duration of a motion that distinguishes effects, s."""


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
    """

    name: str
    about: str
    setpoint: Multisine | Pseudorandom


def strokes(room: Room, seed: int = 0) -> dict[str, Stroke]:
    """Return the library of motions, by their names.

    Args:
        room: the range in which the ram may move, with the gain by which steps are limited.
        seed: sets the phases or the random steps of the motions.
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
    return {name: Stroke(name, about, setpoint) for name, about, setpoint in found}


def room_of(rig: Rig) -> Room:
    """Return the range in which experiments may move a rig's ram, with the gain of its loop.

    The range is that of the rig's position limits, less a margin of 2 cm at each end.
    """
    return Room(*stroke_of(rig), rig.gain_V_per_m)


def motions_campaign(name: str, wanted: Motions, rig: Rig, assumed: Model, seed: int) -> Campaign:
    """Return a campaign with one test for each of some motions of the library.

    Args:
        name: name of the campaign, and of its folder.
        wanted: the motions, by their names and durations.
        rig: the rig, within whose limits the motions stay.
        assumed: the model that the filter assumes while the motions are recorded.
        seed: sets the motions' phases, and the noise of a simulated rig.
    """
    # Each test gets phases and noise that differ from those of the others.
    seeds = np.random.SeedSequence([seed, len(wanted)]).generate_state(len(wanted)) >> 1
    tests = []
    for (motion, duration_s), drawn in zip(wanted, map(int, seeds), strict=True):
        setpoint = strokes(room_of(rig), drawn)[motion].setpoint
        start = float(setpoint.sample(np.zeros(1))[0])
        tests.append(plain_test(motion, setpoint, duration_s, start, _SETTLE_S, drawn))
    return part_campaign(name, "Motions of rig gap --live.", rig, assumed, tests)


def motions(room: Room, pressure: float) -> tuple[Motion, ...]:
    """Return the library of motions, of 20 s each, as the search for an experiment takes them.

    Args:
        room: the range in which the ram may move.
        pressure: pressure of both chambers at the start, Pa.
    """
    none = np.zeros((round(EXPERIMENT_S / TICK), 1))
    pressures, spool = np.full((len(none), 2), pressure), none
    return tuple(
        Motion(
            stroke.name,
            stroke.about,
            none,
            np.column_stack([sampled(stroke.setpoint, EXPERIMENT_S), pressures, spool]),
            campaign_of(stroke),
        )
        for stroke in strokes(room, 1).values()
    )


def sampled(setpoint: Setpoint, duration_s: float) -> Array:
    """Return the values of a setpoint at every tick for a duration in s, float64 (n,)."""
    return np.asarray(setpoint.sample(np.arange(round(duration_s / TICK)) * TICK))


def campaign_of(stroke: Stroke) -> dict[str, Any]:
    """Return the content of a campaign file with one motion, without the keys of rig and model."""
    setpoint = stroke.setpoint
    keys: dict[str, Any]
    if isinstance(setpoint, Multisine):
        keys = {
            "type": "multisine",
            "mean": f"{setpoint.mean:g} m",
            "amplitude": f"{setpoint.amplitude:g} m",
            "frequencies": [f"{frequency:g} Hz" for frequency in setpoint.frequencies_hz],
        }
    else:
        keys = {
            "type": "pseudorandom",
            "lower": f"{setpoint.lower:g} m",
            "upper": f"{setpoint.upper:g} m",
            "hold": [f"{setpoint.hold_min_s:g} s", f"{setpoint.hold_max_s:g} s"],
        }
    test = {"name": stroke.name, "duration": f"{EXPERIMENT_S:g} s"}
    return {
        "name": f"gap {stroke.name}".replace(" ", "_"),
        "description": f"Experiment of rig gap: {stroke.about}.",
        "tests": [test | {"setpoint": keys | {"seed": setpoint.seed}}],
    }
