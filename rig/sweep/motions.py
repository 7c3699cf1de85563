"""Draws the motions of cases as tables for compiled code: sines, a wave of lines, and levels."""

import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import zip_longest
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from control import Pseudorandom, Sequence as Segments, Trapezoid
from rig.configuration import Distribution, SweptMotion

Array = NDArray[np.float64]

AMPLITUDE: Final = 0
FREQUENCY: Final = 1
CHIRP: Final = 2
PHASE: Final = 3
SINE_ROWS: Final = 4
"""Number of rows of a sine: amplitude (m or V), frequency (Hz), half the rate of change of the
frequency (Hz/s), and phase (turns)."""
WAVE_ROWS: Final = 4
"""Number of rows of a trapezoid wave: amplitude (m or V), frequency (Hz), rest at either end (s),
and phase (turns); the same rows as those of a sine but for the rest."""
HOLD: Final = 2
_UNITS: Final = {"position_gain": "V/m", "frequency": "Hz",
                 "start_frequency": "Hz", "end_frequency": "Hz", "phase": "rad",
                 "hold": "s", "hold_min": "s", "hold_max": "s", "frequencies": "Hz"}  # fmt: skip


class Column(NamedTuple):
    """A column of a sweep's table: a value for each case, (n,), its SI unit, and what it is.

    The unit is empty for a text or a plain number.
    """

    values: NDArray[np.generic]
    unit: str
    about: str


class Streams:
    """The random numbers of some successive cases.

    Each quantity has a stream of its own, seeded by the sweep's seed and the quantity's name, of
    which case n takes the n-th number.

    Args:
        seed: the sweep's seed.
        first: number of the first case.
        count: number of cases, n.
    """

    def __init__(self, seed: int, first: int, count: int) -> None:
        self.seed, self.first, self.count = seed, first, count

    def _generator(self, name: str) -> np.random.PCG64:
        words = np.random.SeedSequence([self.seed, zlib.crc32(name.encode())])
        generator = np.random.PCG64(words)
        generator.advance(self.first)
        return generator

    def uniform(self, name: str) -> Array:
        """Return for each case a number in [0, 1), (n,), from the stream with a name."""
        return np.random.Generator(self._generator(name)).random(self.count)

    def seeds(self, name: str) -> NDArray[np.uint64]:
        """Return for each case a seed of 64 bits, (n,), from the stream with a name."""
        return np.asarray(self._generator(name).random_raw(self.count), dtype=np.uint64)

    def drawn(self, name: str, law: Distribution) -> Array:
        """Return for each case the value of a quantity, (n,), drawn from its distribution."""
        return law.at(self.uniform(name))


@dataclass(frozen=True)
class Motions:
    """The setpoints of n cases: r(t) = level(t) + sum of sines + wave(t), in m, in open loop in V.

    Attributes:
        sines: `SINE_ROWS` rows for each of s sines, float64 (4 s, n).
        peak: greatest absolute value to which the sum of sines is to be scaled, float64 (n,); NaN
            if it is not scaled.
        wave: `WAVE_ROWS` rows of a trapezoid wave, float64 (4, n); without a rest it is a triangle,
            and with amplitude 0 there is none.
        levels: successive levels, float64 (k, n).
        ends: level i lasts until the time ends[i], s, float64 (k, n); the last level has no end.
        open_loop: 1 if the setpoint is the valve's command, else 0, float64 (n,).
        kind: index of the case's motion in the sweep, (n,).
        pace: a measure of the motion's speed, to compare cases with the same motion, float64 (n,);
            1 for motions that rest most of the time.
        gain: gain of the position loop that was drawn for the case, V/m, float64 (n,); NaN where
            none was.
    """

    sines: Array
    peak: Array
    wave: Array
    levels: Array
    ends: Array
    open_loop: Array
    kind: NDArray[np.intp]
    pace: Array
    gain: Array

    def of(self, lanes: NDArray[np.intp]) -> "Motions":
        """Return the motions of some of the cases, by the indices of these cases.

        Rows of sines at the end that have no amplitude in any of these cases are left out.
        """
        parts = {
            each.name: np.ascontiguousarray(getattr(self, each.name)[..., lanes])
            for each in fields(self)
        }
        # Rows below the last sine with an amplitude would only be added up as zeros.
        has = parts["sines"][AMPLITUDE::SINE_ROWS].any(axis=1)
        count = int(np.flatnonzero(has)[-1] + 1) if has.any() else 0
        return Motions(**parts | {"sines": parts["sines"][: SINE_ROWS * count]})

    def begins(self) -> Array:
        """Return the setpoints at time 0, m or V, (n,)."""
        sines = self.sines.reshape(-1, SINE_ROWS, self.kind.size)
        waves = sines[:, AMPLITUDE] * np.sin(2.0 * np.pi * sines[:, PHASE])
        lines = [
            Trapezoid(0.0, size, frequency, hold, 2.0 * np.pi * turns).sample(np.zeros(1))[0]
            for size, frequency, hold, turns in self.wave.T.tolist()
        ]
        return self.levels[0] + waves.sum(axis=0) + np.array(lines)


class _Course(NamedTuple):
    """The motion of one case: levels, their ends, rows of sines, peak, pace and wave (`Motions`).

    The last level has no end, so that the last of `ends` has no effect.
    """

    levels: Sequence[float]
    ends: Sequence[float] = (np.inf,)
    sines: Sequence[float] = ()
    peak: float = np.nan
    pace: float = 1.0
    wave: Sequence[float] = (0.0, 1.0, 0.0, 0.0)


def _columns(of_cases: Sequence[Sequence[float]], padding: float = 0.0) -> Array:
    """Return sequences as the columns of an array, (longest, n), filled up with `padding`."""
    rows = list(zip_longest(*of_cases, fillvalue=padding))
    return np.array(rows, dtype=np.float64).reshape(-1, len(of_cases))


def drawn_motions(
    motions: Sequence[SweptMotion], streams: Streams, duration_s: float
) -> tuple[Motions, dict[str, Column]]:
    """Return the drawn setpoints of some cases, and the columns of the table that show them.

    Args:
        motions: motions of the sweep, of which one is drawn for each case.
        streams: random numbers of these cases.
        duration_s: duration of a case, s.

    Returns:
        The setpoints, and by its name each column: the motion's name, and each quantity that is
        drawn, NaN for cases with another motion.
    """
    shares = np.cumsum([motion.share for motion in motions])
    kind = np.searchsorted(shares / shares[-1], streams.uniform("motion"), side="right")
    kind = np.minimum(kind, len(motions) - 1)
    names = np.array([motion.name for motion in motions])
    columns = {"motion": Column(names[kind], "", "name of the motion")}
    made: dict[int, _Course] = {}
    gain = np.full(streams.count, np.nan)
    open_loop = np.array([float(motion.quantity == "command") for motion in motions])
    for index, motion in enumerate(motions):
        called = f"motion {motion.name}"
        drawn = {
            key: [streams.drawn(f"{called} {key} {i}", law) for i, law in enumerate(laws)]
            for key, laws in motion.values.items()
        }
        if "position_gain" in drawn:
            gain = np.where(kind == index, drawn["position_gain"][0], gain)
        seeds, waves = streams.seeds(called), len(drawn.get("frequencies", ()))
        phases = [streams.uniform(f"{called} phase {i}") for i in range(waves)]
        for case in np.flatnonzero(kind == index).tolist():
            own = {key: [float(values[case]) for values in each] for key, each in drawn.items()}
            turns = [float(phase[case]) for phase in phases]
            if motion.sequence is not None:
                made[case] = _segments(motion.sequence)
                continue
            made[case] = _motion(motion.type, own, duration_s, int(seeds[case]), turns)
        columns |= _columns_of(motion, drawn, kind == index)
    cases = [made[case] for case in range(streams.count)]
    setpoints = Motions(
        sines=_columns([each.sines for each in cases]),
        peak=np.array([each.peak for each in cases]),
        wave=_columns([each.wave for each in cases]),
        levels=_columns([each.levels for each in cases]),
        ends=_columns([(*each.ends[:-1], np.inf) for each in cases], padding=np.inf),
        open_loop=open_loop[kind],
        kind=kind,
        pace=np.array([each.pace for each in cases]),
        gain=gain,
    )
    return setpoints, columns


def _columns_of(
    motion: SweptMotion, drawn: dict[str, list[Array]], chosen: NDArray[np.bool_]
) -> dict[str, Column]:
    """Return the quantities of a motion that are random as columns, by the columns' names.

    Cases with another motion have NaN. Quantities that are the same in every case are left out.
    """
    level = "m" if motion.quantity == "position" else "V"
    columns = {}
    names = iter(motion.drawn)
    for key, laws in motion.values.items():
        for index, law in enumerate(laws):
            if not law.is_drawn:
                continue
            name = next(names)
            values = np.where(chosen, drawn[key][index], np.nan)
            about = f"{key} of the motion {motion.name}"
            columns[name] = Column(values, _UNITS.get(key, level), about)
    return columns


def _segments(sequence: Segments) -> _Course:
    """Return the begin of a motion with segments, as its only level.

    What the cases follow is the table that a group of them has (`Group.setpoints`).
    """
    return _Course([float(sequence.sample(np.zeros(1))[0])])


def _motion(
    kind: str, own: dict[str, list[float]], until: float, seed: int, turns: list[float]
) -> _Course:
    """Return the motion of one case.

    Args:
        kind: type of the motion.
        own: the values drawn for the case, by the keys of the sweep's file.
        until: duration of the case, s.
        seed: seed of a pseudorandom motion.
        turns: phases of a multisine, in turns.
    """
    one = {key: values[0] for key, values in own.items()}
    if kind == "constant":
        return _Course(own["value"])
    if kind == "steps":
        return _Course(own["levels"], [one["hold"] * (i + 1) for i in range(len(own["levels"]))])
    if kind == "pseudorandom":
        keys = ("lower", "upper", "hold_min", "hold_max")
        lower, upper, shortest, longest = (one[key] for key in keys)
        ends, held = Pseudorandom(lower, upper, shortest, longest, seed).sequence(until)
        return _Course(held.tolist(), ends.tolist())
    amplitude, peak = one["amplitude"], np.nan
    if kind in ("triangle", "trapezoid"):
        hold, turn = one.get("hold", 0.0), one["phase"] / (2.0 * np.pi)
        wave = (amplitude, one["frequency"], hold, turn)
        return _Course(own["mean"], pace=amplitude * one["frequency"], wave=wave)
    if kind == "multisine":
        peak, pace = amplitude, amplitude * sum(own["frequencies"])
        pairs = zip(own["frequencies"], turns, strict=True)
        sines = [value for frequency, turn in pairs for value in (1.0, frequency, 0.0, turn)]
    elif kind == "sine":
        pace = amplitude * one["frequency"]
        sines = [amplitude, one["frequency"], 0.0, one["phase"] / (2.0 * np.pi)]
    else:
        first, last = one["start_frequency"], one["end_frequency"]
        pace = amplitude * (first + last)
        sines = [amplitude, first, 0.5 * (last - first) / until, one["phase"] / (2.0 * np.pi)]
    return _Course(own["mean"], sines=sines, peak=peak, pace=pace)
