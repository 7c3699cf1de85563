"""Draws the random quantities of cases from the sweep's seed and the case's number.

Each quantity has a stream of random numbers of its own, seeded by its name, of which case n takes
the n-th number. So a case does not depend on the chunk in which it is run, and a change of one
quantity leaves all others as they were: two sweeps that differ only in the filter judge the same
rigs, leaks and noise. Where leaks are drawn adaptively, places and sizes of leaks follow from the
results of earlier cases besides.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.configuration import HEALTHY, Sweep
from rig.lanes import aligned
from rig.plant import LEAKS, TICK, Parameters, quantities

from .motions import Column, Motions, Streams, drawn_motions

Array = NDArray[np.float64]

_AT_ONCE_S: Final = 1e-9
"""Ramps in s that are not longer than this jump; times that are nearer are the same."""


class Span(NamedTuple):
    """The range from which the sizes of a place's leaks are drawn.

    The ends are parts, from 0 to 1, of the distribution in the sweep's file: 0 is its smallest
    size, and half of what it draws lies below 0.5.
    """

    low: float
    high: float


Spans = Mapping[str, Span]
"""The range of sizes of each place that still gets leaks, of a batch of an adaptive sweep."""


@dataclass(frozen=True)
class Cases:
    """Some cases with all that was drawn for them.

    Attributes:
        chunk: number of the chunk that these cases make up.
        numbers: numbers of the cases, int64 (n,).
        parameters: `rig.plant.parameters.Parameters` of each rig, float64 (fields, n).
        coefficients: coefficients of the leaks in the order of `rig.plant.LEAKS`, SI, float64
            (3, n).
        onset_tick: first tick at which the leak acts, float64 (n,); for a healthy rig a tick after
            the last one.
        noise: factor on the standard deviations of the transducers, float64 (n,).
        seeds: seeds of the noise of the pressures, and of the other transducers, uint64 (2, n).
        motions: setpoints of the cases.
        faults: name of the injected leak, or `healthy`, (n,).
        onset_s: onset of the leak, s, float64 (n,); NaN for a healthy rig.
        columns: columns of the table that show what was drawn, by their names.
        profile: levels of leaks that change with time, float64 (levels, 3, n): when each begins, s,
            how long it takes to be reached, s, and its part of the last level; None without such
            leaks.
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
    profile: Array | None = None

    def growth(self, at: NDArray[np.intp], ticks: int) -> Array | None:
        """Return the factors on the leaks' coefficients, as `rig.loop.LaneRigs.growth` has them.

        Args:
            at: indices of the cases, (lanes,).
            ticks: number of ticks of a case.
        """
        if self.profile is None:
            return None
        time_s = np.arange(ticks)[:, None] * TICK
        grown, before = np.zeros((ticks, at.size)), np.zeros(at.size)
        for begin, ramp, part in self.profile[..., at]:
            since = time_s - begin
            share = np.clip(since / np.maximum(ramp, _AT_ONCE_S), 0.0, 1.0)
            share = np.where(ramp > _AT_ONCE_S, share, since >= -_AT_ONCE_S)
            grown += (part - before) * share
            before = part
        return aligned(grown)

    def of(self, at: NDArray[np.intp], chunk: int) -> "Cases":
        """Return some of the cases as a chunk of its own.

        Args:
            at: indices of the cases.
            chunk: number of the new chunk.
        """
        arrays = {
            name: part[..., at] for name, part in vars(self).items() if isinstance(part, np.ndarray)
        }
        columns = {
            name: each._replace(values=each.values[at]) for name, each in self.columns.items()
        }
        return replace(self, chunk=chunk, motions=self.motions.of(at), columns=columns, **arrays)

    def alike(self) -> NDArray[np.intp]:
        """Return the indices of the cases, (n,), in an order that puts similar cases together.

        Cases that run in lanes side by side should be similar: all lanes wait for the slowest, and
        the flow of a leak is computed in all of them if one has it.
        """
        place = np.arange(1, len(LEAKS) + 1) @ (self.coefficients != 0.0)
        stiction, coulomb = (self.parameters[Parameters._fields.index(name)]
                             for name in ("stiction", "coulomb"))  # fmt: skip
        # A ram that sticks and slips needs short integration steps: more often if friction drops
        # more or the ram is slower. The power 1.5 made the costs within groups most equal.
        slips = np.maximum(stiction - coulomb, 0.0) ** 1.5 / np.maximum(self.motions.pace, 1e-9)
        return np.lexsort((self.numbers, slips, self.motions.kind, place))


def draw(sweep: Sweep, first: int, count: int, spans: Spans | None = None) -> Cases:
    """Return `count` cases of a sweep from number `first` on, with 0 as number of the chunk.

    Args:
        sweep: the sweep.
        first: number of the first case.
        count: number of cases.
        spans: places and sizes of the leaks of an adaptive sweep; None for all places and sizes.
    """
    streams = Streams(sweep.seed, first, count)
    parameters, columns = _parameters(sweep, streams)
    noise = streams.drawn("noise", sweep.noise)
    columns["noise"] = Column(noise, "", "factor on the deviation of every transducer")
    coefficients, onset_s, faults, shown = _leaks(sweep, streams, spans)
    profile, levels = _profile(sweep, streams, shown)
    motions, described = drawn_motions(sweep.motions, streams, sweep.duration_s)
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
        columns={
            "case": Column(numbers, "", "number of the case"),
            **columns,
            **described,
            **shown,
            **levels,
        },
        profile=profile,
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
    sweep: Sweep, streams: Streams, spans: Spans | None
) -> tuple[Array, Array, NDArray[np.str_], dict[str, Column]]:
    """Return the leaks of all cases: coefficients (3, n), onsets (n,), names (n,), and columns.

    For a healthy case the coefficients are zero, the onset is NaN and the name is `healthy`.
    """
    count, leaks = streams.count, sweep.leaks
    coefficients = np.zeros((len(LEAKS), count))
    onset_s, size = np.full(count, np.nan), np.full(count, np.nan)
    faults = np.full(count, HEALTHY, dtype=f"<U{max(map(len, LEAKS))}")
    if leaks is not None:
        leaky = streams.uniform("healthy") >= leaks.healthy
        places = list(leaks.places if spans is None else spans)
        at = (streams.uniform("place") * len(places)).astype(np.intp)
        faults = np.where(leaky, np.array(places)[at], faults)
        parts = streams.uniform("leak")
        if spans is not None:
            parts = _spread(parts, np.where(leaky, at, -1), np.array(list(spans.values())))
        size = np.where(leaky, leaks.size.at(parts), np.nan)
        if leaks.profile:
            last = len(leaks.profile)
            size = np.where(leaky, streams.drawn(f"leak level {last}", leaks.size), np.nan)
        if leaks.pressure is not None:
            drops = dict(zip(leaks.places, leaks.pressure, strict=True))
            size = size / np.sqrt(np.array([drops[place] for place in places])[at])
        begin = "leak at 1" if leaks.profile else "onset"
        onset_s = np.where(leaky, streams.drawn(begin, leaks.onset), np.nan)
        for row, name in enumerate(LEAKS):
            coefficients[row] = np.where(faults == name, size, 0.0)
    shown = {
        "fault": Column(faults, "", "what was injected"),
        "onset_s": Column(onset_s, "s", "when it began"),
        "coefficient": Column(size, "m^3/(s Pa^0.5)", "of the leak injected"),
    }
    return coefficients, onset_s, faults, shown


def _spread(parts: Array, place: NDArray[np.intp], spans: Array) -> Array:
    """Return parts of the distribution of sizes that are spread evenly over the span of each place.

    The span of a place is divided into as many equal pieces as it has leaks, and each leak is drawn
    from one of them, in order of the cases.

    Args:
        parts: random numbers from 0 to 1, (n,).
        place: index of the place of each case's leak; -1 for a healthy case, (n,).
        spans: lower and upper end of each place's span, (places, 2).
    """
    spread = parts.copy()
    for index, (low, high) in enumerate(spans):
        at = np.flatnonzero(place == index)
        spread[at] = low + (high - low) * (np.arange(at.size) + parts[at]) / max(at.size, 1)
    return spread


def _profile(
    sweep: Sweep, streams: Streams, shown: Mapping[str, Column]
) -> tuple[Array | None, dict[str, Column]]:
    """Return the levels of leaks that change with time, and the columns that show them.

    Args:
        sweep: the sweep.
        streams: random numbers of the cases.
        shown: columns of the cases' leaks, with the coefficient of the last level.

    Returns:
        `Cases.profile`, or None without such leaks; and columns by their names, NaN for a healthy
        case.
    """
    leaks = sweep.leaks
    if leaks is None or not leaks.profile:
        return None, {}
    last = shown["coefficient"].values.astype(np.float64)
    leaky = ~np.isnan(last)
    profile = np.zeros((len(leaks.profile), 3, streams.count))
    columns: dict[str, Column] = {}
    drawn_last = streams.drawn(f"leak level {len(leaks.profile)}", leaks.size)
    for index, level in enumerate(leaks.profile):
        number = index + 1
        begin = streams.drawn(f"leak at {number}", level.at)
        ramp = streams.drawn(f"leak ramp {number}", level.ramp)
        part = streams.drawn(f"leak level {number}", level.size) / drawn_last
        profile[index] = begin, ramp, part
        about = f"of level {number} of the leak"
        columns |= {
            f"level_{number}_s": Column(np.where(leaky, begin, np.nan), "s", f"begin {about}"),
            f"level_{number}_coefficient": Column(
                part * last, "m^3/(s Pa^0.5)", f"coefficient {about}"
            ),
        }
    return profile, columns
