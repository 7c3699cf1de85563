"""Draws cases: what each is made of, by the sweep's seed and the case's number alone.

Each quantity has a stream of its own, seeded by its name, of which case n takes the n-th number. So
a case is the same in whichever chunk it is run, and changing one quantity leaves all others as they
were: two sweeps that differ in the filter, say, judge the same rigs, leaks and noise.
"""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from rig.configuration import HEALTHY, Distribution, Sweep
from rig.plant import LEAKS, Parameters, quantities

from .motions import Motions, drawn_motions
from .setting import Setting

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Column:
    """A column of the table: values of n cases, their SI unit, and what they are."""

    values: NDArray[np.generic]
    unit: str
    about: str


class Streams:
    """The random numbers of some cases that follow one another.

    Args:
        seed: of the sweep.
        first: number of the first case.
        count: how many.
    """

    def __init__(self, seed: int, first: int, count: int) -> None:
        self.seed, self.first, self.count = seed, first, count

    def _generator(self, name: str) -> np.random.PCG64:
        words = np.random.SeedSequence([self.seed, zlib.crc32(name.encode())])
        generator = np.random.PCG64(words)
        generator.advance(self.first)
        return generator

    def uniform(self, name: str) -> Array:
        """Return a number in [0, 1) for each case (n,)."""
        return np.random.Generator(self._generator(name)).random(self.count)

    def seeds(self, name: str) -> NDArray[np.uint64]:
        """Return a seed of 64 bits for each case (n,)."""
        return np.asarray(self._generator(name).random_raw(self.count), dtype=np.uint64)

    def drawn(self, name: str, law: Distribution) -> Array:
        """Return a quantity of each case (n,)."""
        return law.at(self.uniform(name))


@dataclass(frozen=True)
class Cases:
    """Some cases as drawn: what runs them, and what the table shows of them.

    Attributes:
        chunk: number of the chunk that they make.
        numbers: int64 (n,), of the cases.
        parameters: float64 (fields, n), `rig.plant.parameters.Parameters` of each rig.
        coefficients: float64 (3, n) of the leaks, in the order of `rig.plant.LEAKS`.
        onset_tick: float64 (n,), first tick at which they act; that of a healthy rig is beyond.
        noise: float64 (n,), factor on the transducers' deviations.
        seeds: uint64 (2, n), of the noise of the pressures, and of the other transducers.
        motions: setpoints.
        faults: name of what each has, or `healthy`.
        onset_s: NaN of a healthy rig.
        columns: of the table, by name.
    """

    chunk: int
    numbers: NDArray[np.int64]
    parameters: Array
    coefficients: Array
    onset_tick: Array
    noise: Array
    seeds: NDArray[np.uint64]
    motions: Motions
    faults: NDArray[np.str_]
    onset_s: Array
    columns: Mapping[str, Column]

    @property
    def count(self) -> int:
        """Return how many cases these are."""
        return int(self.noise.size)

    def of(self, at: NDArray[np.intp], chunk: int) -> "Cases":
        """Return some of the cases, as a chunk."""
        return Cases(
            chunk, self.numbers[at], self.parameters[:, at], self.coefficients[:, at],
            self.onset_tick[at], self.noise[at], self.seeds[:, at], self.motions.of(at),
            self.faults[at], self.onset_s[at],
            {name: Column(each.values[at], each.unit, each.about)
             for name, each in self.columns.items()},
        )  # fmt: skip

    def alike(self) -> NDArray[np.intp]:
        """Return the cases (n,) in an order in which alike ones follow one another.

        Lanes wait for the slowest of them, and all of them take the root of a leak that one has.
        """
        place = np.arange(1, len(LEAKS) + 1) @ (self.coefficients != 0.0)
        stiction, coulomb = (self.parameters[Parameters._fields.index(name)]
                             for name in ("stiction", "coulomb"))  # fmt: skip
        # A ram that sticks and slips takes short steps: the more often, the larger the drop of
        # friction and the slower it moves. The power is what evened out groups best.
        slips = np.maximum(stiction - coulomb, 0.0) ** 1.5 / np.maximum(self.motions.pace, 1e-9)
        return np.lexsort((self.numbers, slips, self.motions.kind, place))


def draw(sweep: Sweep, first: int, count: int) -> Cases:
    """Return `count` cases from number `first` on, as one chunk."""
    streams = Streams(sweep.seed, first, count)
    parameters, columns = _parameters(sweep, streams)
    noise = streams.drawn("noise", sweep.noise)
    columns["noise"] = Column(noise, "", "factor on the deviation of every transducer")
    coefficients, onset_s, faults, shown = _leaks(sweep, streams)
    motions, described = drawn_motions(sweep.motions, streams, sweep.duration_s)
    columns |= {name: Column(*column) for name, column in described.items()}
    numbers = np.arange(first, first + count, dtype=np.int64)
    seeds = [streams.seeds(f"noise of {part}") for part in ("pressures", "others")]
    never = float(sweep.ticks)
    return Cases(
        chunk=0,
        numbers=numbers,
        parameters=parameters,
        coefficients=coefficients,
        onset_tick=np.where(np.isnan(onset_s), never, np.ceil(np.nan_to_num(onset_s) * 1000.0)),
        noise=noise,
        seeds=np.array(seeds),
        motions=motions,
        faults=faults,
        onset_s=onset_s,
        columns={"case": Column(numbers, "", "number of the case"), **columns, **shown},
    )


def _parameters(sweep: Sweep, streams: Streams) -> tuple[Array, dict[str, Column]]:
    base = sweep.rig.plant.parameters
    values = np.repeat(np.array(base, dtype=np.float64)[:, None], streams.count, axis=1)
    place = Parameters._fields.index
    columns = {}
    known = quantities()
    for field, law in sweep.parameters.items():
        values[place(field)] = streams.drawn(field, law)
    for follower, field in sweep.followers.items():
        ratio = values[place(field)] / getattr(base, field)
        values[place(follower)] = getattr(base, follower) * ratio
    for field in (*sweep.parameters, *sweep.followers):
        about = known[field].symbol or field
        columns[field] = Column(values[place(field)], known[field].unit, about)
    return values, columns


def _leaks(
    sweep: Sweep, streams: Streams
) -> tuple[Array, Array, NDArray[np.str_], dict[str, Column]]:
    """Return coefficients (3, n), onsets (n,), names (n,), and the columns that show them."""
    count, leaks = streams.count, sweep.leaks
    coefficients = np.zeros((len(LEAKS), count))
    onset_s, size = np.full(count, np.nan), np.full(count, np.nan)
    faults = np.full(count, HEALTHY, dtype=f"<U{max(map(len, LEAKS))}")
    if leaks is not None:
        leaky = streams.uniform("healthy") >= leaks.healthy
        at = (streams.uniform("place") * len(leaks.places)).astype(np.intp)
        faults = np.where(leaky, np.array(leaks.places)[at], faults)
        size = np.where(leaky, streams.drawn("leak", leaks.size), np.nan)
        if leaks.pressure is not None:
            size = size / np.sqrt(np.array(leaks.pressure)[at])
        onset_s = np.where(leaky, streams.drawn("onset", leaks.onset), np.nan)
        for row, name in enumerate(LEAKS):
            coefficients[row] = np.where(faults == name, size, 0.0)
    shown = {
        "fault": Column(faults, "", "what was injected"),
        "onset_s": Column(onset_s, "s", "when it began"),
        "coefficient": Column(size, "m^3/(s Pa^0.5)", "of the leak injected"),
    }
    return coefficients, onset_s, faults, shown


def still_case(setting: Setting) -> Cases:
    """Return one healthy case at rest, to load the code with that runs them."""
    count = 1
    still = Motions(
        np.zeros((0, count)), np.full(count, np.nan), np.full((1, count), setting.middle),
        np.full((1, count), np.inf), np.zeros(count), np.zeros(count, dtype=np.intp),
        np.zeros(count),
    )  # fmt: skip
    return Cases(
        chunk=0,
        numbers=np.zeros(count, dtype=np.int64),
        parameters=np.array(setting.like, dtype=np.float64)[:, None],
        coefficients=np.zeros((len(LEAKS), count)),
        onset_tick=np.full(count, float(setting.ticks)),
        noise=np.ones(count),
        seeds=np.zeros((2, count), dtype=np.uint64),
        motions=still,
        faults=np.array([HEALTHY]),
        onset_s=np.full(count, np.nan),
        columns={},
    )
