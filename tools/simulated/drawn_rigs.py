"""Rigs and motions drawn at random, for studies of the detector: no two runs are alike."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.plant import NOMINAL, Parameters
from rig.plant.integrator import TICK

Array = NDArray[np.float64]

MIDDLE: Final = 0.3
"""m. Where sines are centred and open loops begin: half the stroke, in round figures."""


def drawn_rig(rng: np.random.Generator) -> Parameters:
    """Return a rig unlike the model (spreads in docs/detection.md), four in ten with a spring."""
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
"""What no oil account depends on."""


def known_rig(rig: Parameters) -> Parameters:
    """Return a rig that is exactly the model, but for friction and load, which are the rig's."""
    return NOMINAL._replace(**{name: getattr(rig, name) for name in _BESIDE_THE_ACCOUNT})


def sine(rng: np.random.Generator, ticks: int) -> Array:
    """Return a sine of 3 to 20 cm and 0.2 to 1 Hz, in m."""
    time_s = np.arange(ticks) * TICK
    wave = np.sin(2.0 * np.pi * rng.uniform(0.2, 1.0) * time_s + rng.uniform(0.0, 6.0))
    return MIDDLE + rng.uniform(0.03, 0.2) * wave


def steps(rng: np.random.Generator, ticks: int) -> Array:
    """Return steps between levels within the stroke, one every 1 to 3 s throughout, in m."""
    time_s = np.arange(ticks) * TICK
    levels = rng.uniform(0.1, 0.5, max(200, ticks // 1000 + 1))
    return levels[(time_s / rng.uniform(1.0, 3.0)).astype(int)]


def multisine(rng: np.random.Generator, ticks: int) -> Array:
    """Return six sines of 0.1 to 2 Hz that make 12 cm together, in m."""
    time_s = np.arange(ticks) * TICK
    waves = [np.sin(2.0 * np.pi * f * time_s + rng.uniform(0.0, 6.0)) / (1.0 + f)
             for f in rng.uniform(0.1, 2.0, 6)]  # fmt: skip
    return np.asarray(MIDDLE + 0.12 * sum(waves) / np.abs(sum(waves)).max())


def open_loop_sine(rng: np.random.Generator, ticks: int) -> Array:
    """Return a sine of 1.5 to 3 V and 0.5 to 1 Hz, in V: the ram drifts with the null bias."""
    time_s = np.arange(ticks) * TICK
    frequency = rng.uniform(0.5, 1.0)
    return rng.uniform(1.5, 3.0) * np.sin(2.0 * np.pi * frequency * time_s + 0.1)


def pseudorandom_holds(rng: np.random.Generator, ticks: int) -> Array:
    """Return levels within the stroke, each held for 0.2 to 4 s, in m."""
    count = max(200, ticks // 200 + 1)
    changes = np.cumsum(rng.integers(200, 4000, count))
    levels = rng.uniform(0.1, 0.5, count + 1)
    return levels[np.searchsorted(changes, np.arange(ticks), "right")]


def standstill(rng: np.random.Generator, ticks: int) -> Array:
    """Return one level within the stroke, in m."""
    return np.full(ticks, rng.uniform(0.1, 0.5))


Draw = Callable[[np.random.Generator, int], Array]
MOTIONS: Final[Mapping[str, Draw]] = {
    "sine": sine,
    "steps": steps,
    "multisine": multisine,
    "open_loop_sine": open_loop_sine,
    "pseudorandom_holds": pseudorandom_holds,
}
"""Motions that show a leak, by name."""
OPEN_LOOP: Final = ("open_loop_sine",)


def drawn_motion(rng: np.random.Generator, ticks: int) -> tuple[Array, bool]:
    """Return one motion throughout (m, or V in open loop), and whether it is open loop."""
    name = tuple(MOTIONS)[rng.integers(len(MOTIONS))]
    return MOTIONS[name](rng, ticks), name in OPEN_LOOP


@dataclass(frozen=True)
class MixedMotion:
    """Stretches of different motions, one after the other.

    Attributes:
        setpoint: float64 (ticks,), m, or V where `open_loop`.
        open_loop: bool (ticks,).
        starts: first tick of each stretch.
        kinds: its name, in `MOTIONS` or "standstill".
    """

    setpoint: Array
    open_loop: NDArray[np.bool_]
    starts: tuple[int, ...]
    kinds: tuple[str, ...]

    def kind_at(self, tick: int) -> str:
        """Return the name of the stretch that holds a tick."""
        return self.kinds[int(np.searchsorted(self.starts, tick, "right")) - 1]


_STRETCH_S: Final = (30.0, 90.0)
_OPEN_LOOP_TICKS: Final = 15_000
"""A null bias of 3 um moves the ram by 8 mm/s: by 12 cm until it is brought back to the middle."""
_BACK_TICKS: Final = 3_000


def _with_returns(setpoint: Array) -> tuple[Array, NDArray[np.bool_]]:
    """Return an open loop with a closed one in between, that brings the ram back to the middle."""
    phase = np.arange(setpoint.size) % (_BACK_TICKS + _OPEN_LOOP_TICKS)
    is_open = phase >= _BACK_TICKS
    return np.where(is_open, setpoint, MIDDLE), is_open


def mixed_motion(rng: np.random.Generator, ticks: int) -> MixedMotion:
    """Return stretches of 30 to 90 s, each of a motion drawn from `MOTIONS` or a standstill.

    Open loops start from the middle of the stroke and are taken back there every 18 s.
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
