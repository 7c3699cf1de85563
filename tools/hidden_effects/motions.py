"""Draws the motions of trials: those that identify a rig, and those that show next to nothing."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from math import pi
from typing import Final

import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from tools.hidden_effects.physics import TICK

Array = NDArray[np.float64]

_SPEED: Final = 0.25
"""m/s: the greatest speed of smooth setpoints."""


@dataclass(frozen=True)
class Motion:
    """One motion, with one row for each tick.

    Attributes:
        setpoint: (n,) m; in open loop only the first value counts, as the place to start from.
        feed: (n,) V, added to the command of the position loop.
        gain: gain of the position loop, V/m; 0 means open loop.
    """

    setpoint: Array
    feed: Array
    gain: float


def _time(n: int) -> Array:
    return np.arange(n, dtype=np.float64) * TICK


def _closed(rng: Generator, setpoint: Array) -> Motion:
    return Motion(setpoint, np.zeros(len(setpoint)), float(rng.uniform(25.0, 70.0)))


def _open(rng: Generator, feed: Array) -> Motion:
    return Motion(np.full(len(feed), rng.uniform(0.2, 0.4)), feed, 0.0)


def _middle(rng: Generator) -> float:
    return float(rng.uniform(0.22, 0.38))


def _tones(rng: Generator, n: int, low: float, high: float) -> Array:
    """Return a sum of 6 to 12 sines (n,) with frequencies from `low` to `high` (Hz), at most ±1."""
    time = _time(n)
    frequencies = np.exp(rng.uniform(np.log(low), np.log(high), rng.integers(6, 13)))
    phases = rng.uniform(0.0, 2.0 * pi, len(frequencies))
    angles = 2.0 * pi * frequencies[:, None] * time + phases[:, None]
    total = np.sum(np.sin(angles) / frequencies[:, None], axis=0)
    return np.asarray(total / np.abs(total).max())


def _limited(wave: Array, amplitude: float) -> Array:
    """Return a wave (n,) multiplied by `amplitude` (m), or by less if it would exceed `_SPEED`."""
    speed = float(np.abs(np.diff(wave)).max()) / TICK
    return wave * min(amplitude, _SPEED / max(speed, 1e-9))


def _multisine(rng: Generator, n: int) -> Motion:
    wave = _tones(rng, n, 0.1, rng.uniform(1.0, 4.0))
    return _closed(rng, _middle(rng) + _limited(wave, rng.uniform(0.05, 0.2)))


def _sines(rng: Generator, n: int) -> Motion:
    wave = np.sin(2.0 * pi * rng.uniform(0.2, 1.5) * _time(n))
    return _closed(rng, _middle(rng) + _limited(wave, rng.uniform(0.03, 0.2)))


def _chirp(rng: Generator, n: int, low: float, high: float) -> tuple[Array, Array]:
    """Return the phase (n,) in rad and frequency (n,) in Hz of an exponential sweep.

    The frequency rises from `low` to `high`.
    """
    time = _time(n)
    rate = np.log(high / low) / time[-1]
    return 2.0 * pi * low * np.expm1(rate * time) / rate, low * np.exp(rate * time)


def _sweep(rng: Generator, n: int) -> Motion:
    phase, frequency = _chirp(rng, n, 0.1, rng.uniform(3.0, 8.0))
    amplitude = np.minimum(rng.uniform(0.03, 0.12), 0.8 * _SPEED / (2.0 * pi * frequency))
    return _closed(rng, _middle(rng) + amplitude * np.sin(phase))


def _dwells(rng: Generator, n: int, shortest: float, longest: float) -> Array:
    """Return the number (n,) of the dwell that each row is in, counted from 0.

    The length of each dwell is drawn between `shortest` and `longest` (s).
    """
    lengths = rng.uniform(shortest, longest, int(n * TICK / shortest) + 1)
    return np.asarray(np.searchsorted(np.cumsum(lengths), _time(n), side="right"))


def _steps(rng: Generator, n: int) -> Motion:
    dwell = _dwells(rng, n, 0.8, 3.0)
    # One motion in eight may ask for a place beyond a stroke end.
    ends = (-0.02, 0.63) if rng.random() < 0.125 else (0.08, 0.52)
    return _closed(rng, rng.uniform(*ends, dwell.max() + 1)[dwell])


def _ramps(rng: Generator, n: int) -> Motion:
    # The ram goes to and fro, at speeds from creeping to sliding.
    dwell = _dwells(rng, n, 1.5, 5.0)
    speeds = np.exp(rng.uniform(np.log(0.004), np.log(0.12), dwell.max() + 1))
    speeds *= np.where(np.arange(len(speeds)) % 2, -1.0, 1.0)
    path = np.cumsum(speeds[dwell]) * TICK
    path -= 0.5 * (path.max() + path.min())
    return _closed(rng, _middle(rng) + path * min(1.0, 0.2 / np.abs(path).max()))


def _pseudorandom(rng: Generator, n: int) -> Motion:
    dwell = _dwells(rng, n, 0.15, 1.2)
    levels = rng.choice([-1.0, -0.4, 0.4, 1.0], dwell.max() + 1)
    return _closed(rng, _middle(rng) + rng.uniform(0.01, 0.06) * levels[dwell])


def _open_multisine(rng: Generator, n: int) -> Motion:
    return _open(rng, rng.uniform(2.0, 6.0) * _tones(rng, n, 0.5, rng.uniform(4.0, 15.0)))


def _open_sweep(rng: Generator, n: int) -> Motion:
    phase, _ = _chirp(rng, n, rng.uniform(0.4, 0.8), rng.uniform(8.0, 25.0))
    return _open(rng, rng.uniform(1.5, 4.0) * np.sin(phase))


def _open_steps(rng: Generator, n: int) -> Motion:
    # The ram goes to and fro, but drifts meanwhile and may meet a stroke end.
    dwell = _dwells(rng, n, 0.15, 0.6)
    levels = rng.uniform(0.3, 5.0, dwell.max() + 1) * np.where(
        np.arange(dwell.max() + 1) % 2, -1, 1
    )
    return _open(rng, levels[dwell])


def _standstill(rng: Generator, n: int) -> Motion:
    return _closed(rng, np.full(n, _middle(rng)))


def _no_command(rng: Generator, n: int) -> Motion:
    return _open(rng, np.zeros(n))


def _in_the_seals(rng: Generator, n: int) -> Motion:
    wave = np.sin(2.0 * pi * rng.uniform(0.1, 0.5) * _time(n))
    return _closed(rng, _middle(rng) + 3e-5 * wave)


def _pressed_on_the_stop(rng: Generator, n: int) -> Motion:
    place = rng.choice([-0.03, 0.64])
    return Motion(np.full(n, place), np.zeros(n), float(rng.uniform(40.0, 70.0)))


BRISK: Final[Mapping[str, Callable[[Generator, int], Motion]]] = {
    "multisine": _multisine,
    "pseudorandom": _pseudorandom,
    "steps": _steps,
}
"""Brisk motions by name; one of the two recordings to identify with is of one of these kinds."""
MOTIONS: Final[Mapping[str, Callable[[Generator, int], Motion]]] = {
    **BRISK,
    "sines": _sines,
    "sweep": _sweep,
    "ramps": _ramps,
    "open_multisine": _open_multisine,
    "open_sweep": _open_sweep,
    "open_steps": _open_steps,
}
STILL: Final[Mapping[str, Callable[[Generator, int], Motion]]] = {
    "standstill": _standstill,
    "no_command": _no_command,
    "in_the_seals": _in_the_seals,
    "pressed_on_the_stop": _pressed_on_the_stop,
}
"""Motions, by name, that show next to nothing of a rig."""


def drawn(name: str, rng: Generator, rows: int) -> Motion:
    """Return a motion of `rows` rows (1 ms each), of the kind `name` in `MOTIONS` or `STILL`.

    Its amplitudes, frequencies, places and gain are drawn by `rng`.
    """
    return {**MOTIONS, **STILL}[name](rng, rows)
