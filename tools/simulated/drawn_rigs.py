"""Draws rigs and motions at random, for studies of the detector."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import NOMINAL, Parameters
from rig.plant.integrator import TICK

Array = NDArray[np.float64]

MIDDLE: Final = 0.3
"""Position around which sines swing and at which open loops begin, m; about half the stroke."""


def drawn_rig(rng: np.random.Generator) -> Parameters:
    """Return a rig whose parameters spread around the model's as docs/detection.md states.

    Each of these parameters is uniform within its range; all others are nominal. Four rigs in ten
    have a spring of 2e4 N/m as their load, the others no spring.
    """
    spread = rng.uniform
    return NOMINAL._replace(
        bulk_modulus=NOMINAL.bulk_modulus * spread(0.85, 1.15),
        discharge_coefficient=NOMINAL.discharge_coefficient * spread(0.97, 1.03),
        supply_pressure=NOMINAL.supply_pressure * spread(0.97, 1.03),
        return_pressure=spread(0.0, 2e5),
        supply_droop=spread(0.0, 1e12),
        return_back_pressure=spread(0.0, 1e12),
        valve_natural_frequency=NOMINAL.valve_natural_frequency * spread(0.7, 1.3),
        valve_damping=spread(0.6, 0.9),
        spool_null_bias=spread(-3e-6, 3e-6),
        stiction=NOMINAL.stiction * spread(0.8, 1.2),
        coulomb=NOMINAL.coulomb * spread(0.8, 1.2),
        viscous=NOMINAL.viscous * spread(0.7, 1.3),
        friction_asymmetry=spread(-200.0, 200.0),
        spring_stiffness=2e4 if rng.random() < 0.4 else 0.0,
        entrained_air=spread(0.0, 0.005),
    )


_BESIDE_THE_ACCOUNT: Final = (
    "stiction",
    "coulomb",
    "viscous",
    "friction_asymmetry",
    "spring_stiffness",
)
"""Parameters that the oil accounts do not depend on: friction and load."""


def known_rig(rig: Parameters) -> Parameters:
    """Return the nominal model with the friction parameters and the spring stiffness of `rig`."""
    return NOMINAL._replace(**{name: getattr(rig, name) for name in _BESIDE_THE_ACCOUNT})


def sine(rng: np.random.Generator, ticks: int) -> Array:
    """Return a sine (ticks,) in m around `MIDDLE`, with 3 to 20 cm, 0.2 to 1 Hz, drawn phase."""
    time_s = np.arange(ticks) * TICK
    wave = np.sin(2.0 * np.pi * rng.uniform(0.2, 1.0) * time_s + rng.uniform(0.0, 6.0))
    return MIDDLE + rng.uniform(0.03, 0.2) * wave


def steps(rng: np.random.Generator, ticks: int) -> Array:
    """Return steps (ticks,) in m between levels of 0.1 to 0.5 m; each level lasts 1 to 3 s.

    The duration is drawn once for all levels, each level by itself.
    """
    time_s = np.arange(ticks) * TICK
    levels = rng.uniform(0.1, 0.5, max(200, ticks // 1000 + 1))
    return levels[(time_s / rng.uniform(1.0, 3.0)).astype(int)]


def multisine(rng: np.random.Generator, ticks: int) -> Array:
    """Return a sum of six sines (ticks,) in m, of 0.1 to 2 Hz, at most 12 cm from `MIDDLE`.

    The lower frequencies have the greater amplitudes; at one tick the sum is 12 cm from `MIDDLE`.
    """
    time_s = np.arange(ticks) * TICK
    waves = [np.sin(2.0 * np.pi * f * time_s + rng.uniform(0.0, 6.0)) / (1.0 + f)
             for f in rng.uniform(0.1, 2.0, 6)]  # fmt: skip
    return np.asarray(MIDDLE + 0.12 * sum(waves) / np.abs(sum(waves)).max())


def open_loop_sine(rng: np.random.Generator, ticks: int) -> Array:
    """Return a sine (ticks,) of the command in V, with an amplitude of 1.5 to 3 V and 0.5 to 1 Hz.

    Under this command, the null bias of a rig makes its ram drift.
    """
    time_s = np.arange(ticks) * TICK
    frequency = rng.uniform(0.5, 1.0)
    return rng.uniform(1.5, 3.0) * np.sin(2.0 * np.pi * frequency * time_s + 0.1)


def pseudorandom_holds(rng: np.random.Generator, ticks: int) -> Array:
    """Return levels of 0.1 to 0.5 m (ticks,), each of which lasts a time drawn from 0.2 to 4 s."""
    count = max(200, ticks // 200 + 1)
    changes = np.cumsum(rng.integers(200, 4000, count))
    levels = rng.uniform(0.1, 0.5, count + 1)
    return levels[np.searchsorted(changes, np.arange(ticks), "right")]


def standstill(rng: np.random.Generator, ticks: int) -> Array:
    """Return one constant level (ticks,), drawn from 0.1 to 0.5 m."""
    return np.full(ticks, rng.uniform(0.1, 0.5))


Draw = Callable[[np.random.Generator, int], Array]
MOTIONS: Final[Mapping[str, Draw]] = {
    "sine": sine,
    "steps": steps,
    "multisine": multisine,
    "open_loop_sine": open_loop_sine,
    "pseudorandom_holds": pseudorandom_holds,
}
"""Functions that draw a motion, by name; a leak can be noticed in each of these motions."""
OPEN_LOOP: Final = ("open_loop_sine",)
"""Names of the motions that are commands in V instead of positions in m."""


def drawn_motion(rng: np.random.Generator, ticks: int) -> tuple[Array, bool]:
    """Return one motion drawn from `MOTIONS` (ticks,), and whether it is in open loop.

    In open loop the motion is a command in V, otherwise a setpoint in m. All kinds are as likely.
    """
    name = tuple(MOTIONS)[rng.integers(len(MOTIONS))]
    return MOTIONS[name](rng, ticks), name in OPEN_LOOP


@dataclass(frozen=True)
class MixedMotion:
    """Stretches of different motions, one after the other.

    Attributes:
        setpoint: float64 (ticks,), m, or V where `open_loop` is True.
        open_loop: bool (ticks,), True where the setpoint is the command.
        starts: first tick of each stretch.
        kinds: name of each stretch's motion, a key of `MOTIONS` or "standstill".
    """

    setpoint: Array
    open_loop: NDArray[np.bool_]
    starts: tuple[int, ...]
    kinds: tuple[str, ...]

    def kind_at(self, tick: int) -> str:
        """Return the name of the motion of the stretch that holds a tick (0 is the first tick).

        In a stretch of an open-loop motion this is so also while the loop is closed.
        """
        return self.kinds[int(np.searchsorted(self.starts, tick, "right")) - 1]


_STRETCH_S: Final = (30.0, 90.0)
_OPEN_LOOP_TICKS: Final = 15_000
"""Ticks of open loop before the ram is brought back to the middle of the stroke.

A null bias of 3 um moves the ram at 8 mm/s, by 12 cm in this time.
"""
_BACK_TICKS: Final = 3_000
"""Ticks of closed loop in which the ram is brought back to the middle."""


def _with_returns(setpoint: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return setpoints (ticks,) that alternate between closed and open loop, and where it is open.

    Each cycle begins with `_BACK_TICKS` of closed loop at the middle of the stroke.
    """
    phase = np.arange(setpoint.size) % (_BACK_TICKS + _OPEN_LOOP_TICKS)
    is_open = phase >= _BACK_TICKS
    return np.where(is_open, setpoint, MIDDLE), is_open


def mixed_motion(rng: np.random.Generator, ticks: int) -> MixedMotion:
    """Return a motion of stretches of 30 to 90 s, each drawn from `MOTIONS` or a standstill.

    The last stretch may be shorter. A stretch in open loop alternates between 3 s of closed loop,
    which bring the ram to the middle of the stroke, and 15 s of open loop.
    """
    draws = {**MOTIONS, "standstill": standstill}
    setpoint, open_loop = np.empty(ticks), np.zeros(ticks, dtype=np.bool_)
    starts, kinds = [], []
    first = 0
    while first < ticks:
        length = min(round(rng.uniform(*_STRETCH_S) / TICK), ticks - first)
        kind = tuple(draws)[rng.integers(len(draws))]
        part = slice(first, first + length)
        setpoint[part] = draws[kind](rng, length)
        if kind in OPEN_LOOP:
            setpoint[part], open_loop[part] = _with_returns(setpoint[part])
        starts.append(first)
        kinds.append(kind)
        first += length
    return MixedMotion(setpoint, open_loop, tuple(starts), tuple(kinds))
