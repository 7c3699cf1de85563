"""From small motions in open loop to the signs of valve, encoder, spool and pressure lines.

A pair of equal commands, one to either side of null, tells how encoder, load pressure and spool
answer to the valve, but not which of them is turned over: if valve and encoder both are, the
encoder still counts up on a positive command. A cylinder with two equal sides looks the same in a
mirror. What tells its sides apart is oil that leaves one chamber: with the bypass of chamber 1
open, the ram ends up further in than with that of chamber 2, whatever the valve does.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import isfinite
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from rig.io import Wiring
from rig.plant import TICK

Array = NDArray[np.float64]

LEAST_SPEED: Final = 5e-3
"""Least difference in m/s between the velocities of a pair from which a sign is taken: at 0.3 s it
is 50 counts of an encoder of 0.03 mm, and a third of what 0.15 V to either side make of a valve of
0.05 m/s for a volt."""
LEAST_PRESSURE: Final = 2e5
"""Least difference in Pa between the load pressures of a pair from which a sign is taken. Friction
makes twice the Coulomb level over the piston area, 3.5 MPa by table 2.1 of the thesis; a mean over
0.2 s of a transducer with a noise of 100 kPa is off by 7 kPa."""
_SPOOL_PART: Final = 0.3
"""Part of the nominal spool's travel that a spool's transducer must show of a pair."""
LEAST_WAY_M: Final = 2e-3
"""Least difference in m between the ways with the one and the other bypass open from which the
sides are told apart. With a tenth of it, 7 counts, chance is excluded; the rest is for creep."""
BLOCKED_SPEED: Final = 1e-3
"""Speed in m/s below which a ram that pushes hard stands at a stop."""
BLOCKED_PRESSURE: Final = 5e6
"""Load pressure in Pa beyond which a ram that stands is at a stop: stiction alone is 3.8 MPa by
table 2.1 of the thesis."""


@dataclass(frozen=True)
class Pair:
    """What a pair of commands made of the rig, as its channels have it.

    Attributes:
        centre_V: middle of the two commands, V.
        amplitude_V: distance of either command from the middle, V.
        velocity: (up, down) mean velocity by the encoder during the greater and the smaller
            command, m/s.
        load_pressure: the same of `pressure_1_Pa` less `pressure_2_Pa`, Pa.
        spool: the same of `spool_m`, m; NaN without a spool sensor.
    """

    centre_V: float  # noqa: N815
    amplitude_V: float  # noqa: N815
    velocity: tuple[float, float]
    load_pressure: tuple[float, float]
    spool: tuple[float, float]

    @property
    def answers(self) -> bool:
        """Whether the ram answers to the command, so that a sign can be taken."""
        return abs(self.velocity[0] - self.velocity[1]) >= LEAST_SPEED

    @property
    def null_V(self) -> float:  # noqa: N802
        """The command at which the ram stands, by the line through both velocities, V."""
        up, down = self.velocity
        return self.centre_V - self.amplitude_V * (up + down) / (up - down)

    @property
    def blocked(self) -> int:
        """1 or -1 if the ram stands at a stop during the greater or the smaller command; else 0."""
        for side, velocity, pressure in zip(
            (1, -1), self.velocity, self.load_pressure, strict=True
        ):
            if abs(velocity) < BLOCKED_SPEED and abs(pressure) > BLOCKED_PRESSURE:
                return side
        return 0


@dataclass(frozen=True)
class Answers:
    """Which way each channel goes with a greater command: 1, -1, or 0 if it does not tell."""

    encoder: int
    load_pressure: int
    spool: int


def pair_commands(centre: float, amplitude: float, seconds: float) -> Array:
    """Return the commands of a pair, V, one a tick: the greater one, then the smaller one."""
    ticks = round(seconds / TICK)
    return centre + amplitude * np.repeat([1.0, -1.0], ticks)


def pair_of(rows: Array, centre: float, amplitude: float) -> Pair:
    """Return what a pair made of the rig.

    The second half of each command counts, in which valve and pressures have settled.

    Args:
        rows: (ticks, 5), command, position, both pressures and spool, SI; of `pair_commands`.
        centre: as of the commands, V.
        amplitude: as of the commands, V.
    """
    half = len(rows) // 2
    parts = [rows[half // 2 : half], rows[half + half // 2 :]]
    return Pair(
        centre,
        amplitude,
        _both(parts, lambda part: _slope(part[:, 1])),
        _both(parts, lambda part: _mean(part[:, 2] - part[:, 3])),
        _both(parts, lambda part: _mean(part[:, 4])),
    )


def answers_of(pair: Pair, valve_gain: float) -> Answers:
    """Return which way the channels go with the command.

    Args:
        pair: a pair to which the ram answers.
        valve_gain: travel of the nominal spool for a volt, m/V.
    """
    spool = _SPOOL_PART * 2.0 * pair.amplitude_V * valve_gain
    return Answers(
        _sign(pair.velocity, LEAST_SPEED),
        _sign(pair.load_pressure, LEAST_PRESSURE),
        _sign(pair.spool, spool),
    )


def encoder_by_sides(way_1_m: float, way_2_m: float) -> int:
    """Return 1 if the encoder counts up while the ram extends, -1 if down, 0 if it does not tell.

    Args:
        way_1_m: way by the encoder over a pair of commands with the bypass of chamber 1 open, m.
        way_2_m: the same with that of chamber 2.
    """
    apart = way_2_m - way_1_m
    return 0 if not abs(apart) >= LEAST_WAY_M else int(np.sign(apart))


def wiring_of(answers: Answers, encoder: int) -> Wiring:
    """Return the wiring that the answers show, given the encoder's own sign (1 or -1).

    A channel that does not tell counts as wired as its register map says.
    """
    valve = answers.encoder * encoder
    return Wiring(
        valve=_turn(valve),
        encoder=_turn(encoder),
        spool=_turn(answers.spool * valve),
        pressures="swapped" if answers.load_pressure * valve < 0 else "normal",
    )


def _turn(sign: int) -> Literal["normal", "inverted"]:
    return "inverted" if sign < 0 else "normal"


def _both(parts: list[Array], of: Callable[[Array], float]) -> tuple[float, float]:
    up, down = (of(part) for part in parts)
    return up, down


def _sign(values: tuple[float, float], least: float) -> int:
    apart = values[0] - values[1]
    return 0 if not (isfinite(apart) and abs(apart) >= least) else int(np.sign(apart))


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if known.size else float("nan")


def _slope(position: Array) -> float:
    """Return the slope of a line through positions, m/s; NaN if there are too few."""
    ticks = np.flatnonzero(np.isfinite(position))
    if ticks.size < 10:
        return float("nan")
    return float(np.polyfit(ticks * TICK, position[ticks], 1)[0])
