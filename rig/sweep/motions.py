"""Draws the motions of cases as tables for compiled code: sums of sines, and successive levels."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np
from numpy.typing import NDArray

from control import Pseudorandom
from rig.configuration import Distribution, SweptMotion

Array = NDArray[np.float64]

AMPLITUDE: Final = 0
FREQUENCY: Final = 1
CHIRP: Final = 2
PHASE: Final = 3
SINE_ROWS: Final = 4
"""Number of rows of a sine: amplitude (m or V), frequency (Hz), half the rate of change of the
frequency (Hz/s), and phase (turns)."""
_UNITS: Final = {"frequency": "Hz", "start_frequency": "Hz", "end_frequency": "Hz", "phase": "rad",
                 "hold": "s", "hold_min": "s", "hold_max": "s", "frequencies": "Hz"}  # fmt: skip


class Draws(Protocol):
    """A source of random numbers for `count` cases, such as `rig.sweep.drawing.Streams`."""

    count: int

    def uniform(self, name: str) -> Array:
        """Return for each case a number in [0, 1), (n,), from the stream with a name."""

    def seeds(self, name: str) -> NDArray[np.uint64]:
        """Return for each case a seed, (n,), from the stream with a name."""

    def drawn(self, name: str, law: Distribution) -> Array:
        """Return for each case the value of a quantity, (n,), drawn from its distribution."""


@dataclass(frozen=True)
class Motions:
    """The setpoints of n cases: r(t) = level(t) + sum of sines, in m, or in V in open loop.

    Attributes:
        sines: `SINE_ROWS` rows for each of s sines, float64 (4 s, n).
        peak: greatest absolute value to which the sum of sines is to be scaled, float64 (n,); NaN
            if it is not scaled.
        levels: successive levels, float64 (k, n).
        ends: level i lasts until the time ends[i], s, float64 (k, n); the last level has no end.
        open_loop: 1 if the setpoint is the valve's command, else 0, float64 (n,).
        kind: index of the case's motion in the sweep, (n,).
        pace: a measure of the motion's speed, to compare cases with the same motion, float64 (n,);
            1 for motions that rest most of the time.
    """

    sines: Array
    peak: Array
    levels: Array
    ends: Array
    open_loop: Array
    kind: NDArray[np.intp]
    pace: Array

    def of(self, lanes: NDArray[np.intp]) -> "Motions":
        """Return the motions of some of the cases, by the indices of these cases."""
        parts = (self.sines[: self._sine_rows(lanes)], self.levels, self.ends)
        sines, levels, ends = (np.ascontiguousarray(part[:, lanes]) for part in parts)
        rest = (self.open_loop[lanes], self.kind[lanes], self.pace[lanes])
        return Motions(sines, self.peak[lanes], levels, ends, *rest)

    def _sine_rows(self, lanes: NDArray[np.intp]) -> int:
        """Return how many rows of sines some cases need, up to the last sine with an amplitude."""
        has = self.sines[AMPLITUDE::SINE_ROWS, lanes].any(axis=1)
        return SINE_ROWS * int(np.flatnonzero(has)[-1] + 1) if has.any() else 0


class _Table:
    """Tables of the motions of some cases, which are filled one case after another."""

    def __init__(self, count: int) -> None:
        self.sines: list[list[float]] = [[] for _ in range(count)]
        self.levels: list[Sequence[float]] = [(0.0,)] * count
        self.ends: list[Sequence[float]] = [(np.inf,)] * count
        self.peak = np.full(count, np.nan)
        self.open_loop = np.zeros(count)
        self.pace = np.ones(count)

    def finish(self, kind: NDArray[np.intp]) -> Motions:
        levels = _columns(self.levels, padding=None)
        ends = _columns(self.ends, padding=np.inf)
        ends[-1] = np.inf
        none = np.zeros((0, self.peak.size))
        sines = _columns(self.sines, padding=0.0) if any(self.sines) else none
        return Motions(sines, self.peak, levels, ends, self.open_loop, kind, self.pace)


def _columns(of_cases: Sequence[Sequence[float]], padding: float | None) -> Array:
    """Return sequences of different lengths as the columns of an array, (longest, n).

    Shorter columns are filled up with `padding`, or with their last value if that is None.
    """
    longest = max(map(len, of_cases))
    table = np.empty((longest, len(of_cases)))
    for column, values in enumerate(of_cases):
        table[: len(values), column] = values
        table[len(values) :, column] = values[-1] if padding is None else padding
    return table


def drawn_motions(
    motions: Sequence[SweptMotion], draws: Draws, duration_s: float
) -> tuple[Motions, dict[str, tuple[Any, str, str]]]:
    """Return the drawn setpoints of some cases, and the columns of the table that show them.

    Args:
        motions: motions of the sweep, of which one is drawn for each case.
        draws: random numbers of these cases.
        duration_s: duration of a case, s.

    Returns:
        The setpoints, and by its name each column as (values, unit, description): the motion's
        name, and each quantity that is drawn, NaN for cases with another motion.
    """
    shares = np.cumsum([motion.share for motion in motions])
    chosen = np.searchsorted(shares / shares[-1], draws.uniform("motion"), side="right")
    chosen = np.minimum(chosen, len(motions) - 1)
    names = np.array([motion.name for motion in motions])
    columns: dict[str, tuple[Any, str, str]] = {"motion": (names[chosen], "", "name of the motion")}
    table = _Table(draws.count)
    for index, motion in enumerate(motions):
        drawn = {
            key: [draws.drawn(f"motion {motion.name} {key} {i}", law) for i, law in enumerate(laws)]
            for key, laws in motion.values.items()
        }
        cases = np.flatnonzero(chosen == index)
        table.open_loop[cases] = motion.quantity == "command"
        seeds = draws.seeds(f"motion {motion.name}")
        phases = [draws.uniform(f"motion {motion.name} phase {i}")
                  for i in range(len(drawn.get("frequencies", ())))]  # fmt: skip
        for case in cases:
            own = {key: [float(values[case]) for values in each] for key, each in drawn.items()}
            turns = [float(phase[case]) for phase in phases]
            _FILL[motion.type](table, int(case), own, duration_s, int(seeds[case]), turns)
        columns |= _columns_of(motion, drawn, chosen == index)
    return table.finish(chosen), columns


def _columns_of(
    motion: SweptMotion, drawn: dict[str, list[Array]], chosen: NDArray[np.bool_]
) -> dict[str, tuple[Any, str, str]]:
    """Return the drawn quantities of a motion as columns, NaN for cases with another motion."""
    level = "m" if motion.quantity == "position" else "V"
    columns = {}
    for key, laws in motion.values.items():
        for index, law in enumerate(laws):
            if not law.is_drawn:
                continue
            name = f"{motion.name}_{key}" + (f"_{index + 1}" if len(laws) > 1 else "")
            values = np.where(chosen, drawn[key][index], np.nan)
            columns[name] = (values, _UNITS.get(key, level), f"{key} of the motion {motion.name}")
    return columns


Own = dict[str, list[float]]


def _turns(phase_rad: float) -> float:
    return phase_rad / (2.0 * np.pi)


def _constant(t: _Table, case: int, own: Own, until: float, seed: int, turns: list[float]) -> None:
    t.levels[case] = own["value"]


def _sine(t: _Table, case: int, own: Own, until: float, seed: int, turns: list[float]) -> None:
    t.levels[case] = own["mean"]
    amplitude, frequency = own["amplitude"][0], own["frequency"][0]
    t.sines[case] = [amplitude, frequency, 0.0, _turns(own["phase"][0])]
    t.pace[case] = amplitude * frequency


def _chirp(t: _Table, case: int, own: Own, until: float, seed: int, turns: list[float]) -> None:
    t.levels[case] = own["mean"]
    first, last = own["start_frequency"][0], own["end_frequency"][0]
    rate = 0.5 * (last - first) / until
    t.sines[case] = [own["amplitude"][0], first, rate, _turns(own["phase"][0])]
    t.pace[case] = own["amplitude"][0] * (first + last)


def _multisine(t: _Table, case: int, own: Own, until: float, seed: int, turns: list[float]) -> None:
    t.levels[case] = own["mean"]
    t.peak[case] = own["amplitude"][0]
    t.pace[case] = own["amplitude"][0] * sum(own["frequencies"])
    t.sines[case] = [
        value
        for frequency, turn in zip(own["frequencies"], turns, strict=True)
        for value in (1.0, frequency, 0.0, turn)
    ]


def _steps(t: _Table, case: int, own: Own, until: float, seed: int, turns: list[float]) -> None:
    t.levels[case] = own["levels"]
    t.ends[case] = [own["hold"][0] * (i + 1) for i in range(len(own["levels"]))]


def _random(t: _Table, case: int, own: Own, until: float, seed: int, turns: list[float]) -> None:
    keys = ("lower", "upper", "hold_min", "hold_max")
    lower, upper, shortest, longest = (own[key][0] for key in keys)
    levels = Pseudorandom(lower, upper, shortest, longest, seed)
    ends, held = levels.sequence(until)
    t.ends[case], t.levels[case] = ends.tolist(), held.tolist()


_FILL: Final = {
    "constant": _constant,
    "sine": _sine,
    "chirp": _chirp,
    "multisine": _multisine,
    "steps": _steps,
    "pseudorandom": _random,
}
