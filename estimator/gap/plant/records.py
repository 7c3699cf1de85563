"""A record is a recording prepared for the filter: inputs, readings and each reading's variance.

Stretches of a recording in which a channel is stuck at one value are found here, too.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.recording import Recording

from .interface import Array, Output, Plant

BoolArray = NDArray[np.bool_]

_SMOOTHED = 11
"""Number of samples in the moving mean that decides whether a reading is saturated."""
_MARGIN = 3.0
"""Standard deviations. If the mean is nearer to a limit than this, the limit cuts off part of the
sensor's noise."""
_BEFORE, _AFTER = 3, 30
"""Numbers of samples before and after a blow whose readings get more variance, because the moment
of the blow within its sample is unknown."""
LONGEST_DWELL = 100
"""Greatest number of samples over which the variance of one encoder count is spread."""
TIMES_OF_EXCHANGE = ("sent_s", "exchange_s")
"""Columns of a loop on hardware: when in its tick the exchange was, and how long it took, s."""
BLIND_S = 0.05
BLIND_SAMPLES = 5
"""If two readings are missing for longer than 50 ms and than 5 samples, the filter does not know
the plant's state any more."""
UNTIMELY_S = 1.5e-4
"""s. A sample that comes later or earlier than usual by more is not used. At 0.2 m/s the ram moves
by one count of the encoder in this time."""
STUCK_S: Final = 0.1
"""s. Shorter repetitions are lost messages and not a channel that is stuck."""
CHANCE: Final = 1e-9
"""Greatest chance, in one channel of one recording, that noise alone repeats a reading as often as
in a stretch that counts as stuck."""
OFTEN: Final = 0.5
"""A channel in which a greater part of the other rows repeats has no noise of its own to be heard,
and is not judged."""
_MOVES: Final = 10.0
"""Least distance that another channel must move during the stretch, in multiples of its noise. On a
rig that is simulated without noise, all channels repeat their readings at rest."""


class Gains(NamedTuple):
    """How strongly a filter corrected each state by each reading, at each sample of a record.

    Attributes:
        states: float64 (n, outputs, states), change of a state by an innovation of one SI unit.
        variances: float64 (n, outputs), variances of the innovations; infinite where a reading is
            not used.
        couplings: float64 (n, outputs, outputs), [t, i, k] is the change of the prediction of
            reading i by one SI unit of innovation k of the same sample. It is 0 except for k < i,
            because the readings of a sample are applied in their order.
    """

    states: Array
    variances: Array
    couplings: Array


@dataclass(frozen=True, eq=False)
class Record:
    """A recording, or a part of one, as the filter takes it.

    Attributes:
        source: where the recording comes from.
        inputs: float64 (n, inputs), as commanded.
        readings: float64 (n, outputs); a missing one is replaced by the last one before it, or else
            by the first one after it.
        variances: float64 (n, outputs), of the readings' noise and rounding; infinite where a
            reading is missing or saturated.
        first: number of the recording's samples that come before this record.
        number: number of the recording among those that are looked at together, from 0.
        unread: bool (n, outputs), whether a reading is missing: the recording has none, as between
            the rows of a slower one, or `record_of` left it out; None if none is missing.
    """

    source: str
    inputs: Array
    readings: Array
    variances: Array
    first: int = 0
    number: int = 0
    unread: BoolArray | None = None

    def part(self, first: int, end: int) -> "Record":
        """Return the samples from `first` on and before `end` as a record of their own."""
        inputs, readings, variances = (
            np.ascontiguousarray(each[first:end])
            for each in (self.inputs, self.readings, self.variances)
        )
        unread = None if self.unread is None else self.unread[first:end]
        return Record(
            self.source, inputs, readings, variances, self.first + first, self.number, unread
        )

    def lacks(self, output: int) -> bool:
        """Return whether an output, given by its index, was not recorded at all."""
        return self.unread is not None and bool(self.unread[:, output].all())

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.inputs)


def record_of(recording: Recording, plant: Plant) -> Record:
    """Return a recording as the record that the filter of this plant takes.

    Readings that were not taken at their time (`untimely`), or that a stuck channel repeats
    (`stuck_stretches`), count as missing. The others are moved to the usual time, by their rate of
    change.

    Raises:
        KeyError: a channel that the plant needs is missing.
    """
    inputs = np.column_stack([recording[name] for name in plant.inputs])
    readings = np.column_stack([recording[output.channel] for output in plant.outputs])
    late = np.where(untimely(recording), np.nan, lateness(recording))
    readings[~np.isfinite(late)] = np.nan
    for each in stuck_stretches(recording, plant):
        readings[each.first : each.end, each.output] = np.nan
    record = made_of(recording.source, inputs, readings, plant)
    # All readings are brought to the usual time of a sample: 50 us at 0.3 m/s are half a count.
    moved = np.nan_to_num(late)[:, None] * _rates(record.readings, plant.period)
    return replace(record, readings=record.readings - moved)


def seen_parts(record: Record, period: float) -> list[Record]:
    """Return the parts of a record in which the filter can follow the plant's state.

    The state is unknown where two or more readings, or the only one of a plant, are missing or
    saturated for longer than `BLIND_S` and `BLIND_SAMPLES`; these stretches are left out. For
    example, the vapour in two empty chambers may have any volume, and the errors when they fill
    again are not the model's fault. A record without such a stretch is returned whole. Otherwise
    each part begins at the first sample in which all readings can be used; a part without such a
    sample is left out. A channel that was never recorded is not asked for.
    """
    unused = ~np.isfinite(record.variances)
    if record.unread is not None:
        unused = unused[:, ~record.unread.all(0)]
    longest = max(BLIND_S, BLIND_SAMPLES * period)
    blind = unused.sum(1) >= min(2, unused.shape[1])
    edges = np.flatnonzero(np.diff(np.r_[False, blind, False])).reshape(-1, 2)
    lost = [(int(a), int(b)) for a, b in edges if (b - a) * period > longest]
    if not lost:
        return [record]
    parts: list[tuple[int, int]] = []
    ends = [0, *(end for stretch in lost for end in stretch), len(record)]
    for first, last in zip(ends[::2], ends[1::2], strict=True):
        known = np.flatnonzero(~unused[first:last].any(1))
        if len(known):
            parts.append((first + int(known[0]), last))
    return [record.part(first, end) for first, end in parts]


def lateness(recording: Recording) -> Array:
    """Return how much later than usual each sample was taken, s (n,); NaN where that is unknown.

    A loop on hardware writes and reads in one exchange per tick. A sample's time within its tick is
    the end of the exchange (the sum of `TIMES_OF_EXCHANGE`), and usual is the recording's median.
    Samples at the usual time count as not late, because a row's command acts from the row's own
    sample on. A later exchange samples a later moment, and no effect of the rig must be made to
    explain the difference. Recordings without the times of exchanges, or with none that is finite,
    give zeros.
    """
    if not all(name in recording for name in TIMES_OF_EXCHANGE):
        return np.zeros(len(recording))
    late = sum((recording[name] for name in TIMES_OF_EXCHANGE), np.zeros(len(recording)))
    if not np.isfinite(late).any():
        return np.zeros(len(recording))
    return np.asarray(late - np.nanmedian(late))


def untimely(recording: Recording) -> BoolArray:
    """Return for each sample, bool (n,), whether it was taken off its time or at an unknown time.

    A sample is off its time if its `lateness` is more than `UNTIMELY_S`, early or late.
    """
    return np.asarray(~(np.abs(lateness(recording)) <= UNTIMELY_S))


def _rates(readings: Array, period: float) -> Array:
    """Return the rates of change of readings, per s (n, outputs), each over `_SMOOTHED` samples.

    The rates of the first five and the last five samples are 0.
    """
    rates = np.zeros_like(readings)
    half = _SMOOTHED // 2
    rates[half:-half] = (readings[2 * half :] - readings[: -2 * half]) / (2 * half * period)
    return rates


def made_of(source: str, inputs: Array, readings: Array, plant: Plant) -> Record:
    """Return a record of inputs (n, inputs) and readings (n, outputs), with their variances.

    While a counting sensor rests on one count, all these samples together show only once where the
    ram is. So the variance of its rounding is multiplied by their number, at most `LONGEST_DWELL`.
    Readings that are not finite are missing: each is replaced by the last one before it, or else by
    the first one after it. Missing and saturated readings get an infinite variance. A reading is
    saturated if it is at an end of its range, or if the moving mean of the readings is within three
    standard deviations of that end.
    """
    variances = np.empty_like(readings)
    missing = ~np.isfinite(readings)
    held = _held(readings, missing)
    for index, output in enumerate(plant.outputs):
        values = held[:, index]
        variances[:, index] = output.noise**2
        if output.resolution > 0.0:
            known = ~missing[:, index]
            variances[known, index] += output.resolution**2 / 12.0 * _dwell(values[known])
        unusable = missing[:, index] | ~((values > output.lower) & (values < output.upper))
        # The mean decides, not the reading: those readings that noise keeps off the limit are too
        # high.
        mean, margin = smoothed(values), _MARGIN * output.noise
        unusable |= (mean < output.lower + margin) | (mean > output.upper - margin)
        variances[unusable, index] = np.inf
    unread = missing if missing.any() else None
    return Record(
        source, np.ascontiguousarray(inputs), np.ascontiguousarray(held), variances, unread=unread
    )


def _held(readings: Array, missing: BoolArray) -> Array:
    """Return readings (n, outputs) with each missing one replaced by the last reading before it.

    Readings that are missing at the beginning are replaced by the first one; a channel without
    readings is 0. A twin is steered along these values, while the filter leaves them out.
    """
    held = np.empty_like(readings)
    for index in range(readings.shape[1]):
        known = np.flatnonzero(~missing[:, index])
        if not len(known):
            held[:, index] = 0.0
            continue
        last = np.searchsorted(known, np.arange(len(readings)), side="right") - 1
        held[:, index] = readings[known[np.maximum(last, 0)], index]
    return held


def smoothed(values: Array) -> Array:
    """Return the moving mean (n,) of values (n,), over the 11 samples around each.

    Beyond the ends, the first and the last value are repeated.
    """
    half = _SMOOTHED // 2
    padded = np.pad(values, half, mode="edge")
    sums = np.cumsum(np.concatenate([[0.0], padded]))
    return np.asarray((sums[_SMOOTHED:] - sums[:-_SMOOTHED]) / _SMOOTHED)


def roughness(record: Record, plant: Plant, values: Mapping[str, float]) -> Array:
    """Return what to add to the variances of readings near violent samples, (n, outputs).

    When exactly within a sample a ram meets its stop is unknown. So a reading near such a blow may
    be wrong by as much as readings change there from sample to sample: the square of the greatest
    change within two samples is added. Near means from 3 samples before to 30 samples after a
    sample that `Plant.violent` marks at these parameter `values`. The result is 0 elsewhere.
    """
    added = np.zeros_like(record.readings)
    if plant.violent is None:
        return added
    hit = plant.violent(record.readings, values)
    if not hit.any():
        return added
    # This marks the samples from a little before the blow until its effects have died down.
    around = np.convolve(hit, np.ones(_BEFORE + _AFTER + 1), mode="full") > 0.5
    around = around[_BEFORE : _BEFORE + len(hit)]
    steps = np.abs(np.diff(record.readings, axis=0, prepend=record.readings[:1]))
    for shift in range(-2, 3):
        np.maximum(added, np.roll(steps, shift, axis=0), out=added)
    added *= added
    added[~around] = 0.0
    return added


def _dwell(values: Array) -> Array:
    """Return for each sample the number of equal samples in its run, at most LONGEST_DWELL."""
    starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    lengths = np.diff(np.r_[starts, len(values)])
    return np.minimum(np.repeat(lengths, lengths), LONGEST_DWELL).astype(np.float64)


@dataclass(frozen=True)
class Stuck:
    """A stretch of a recording in which a channel repeats one reading.

    Attributes:
        source: where the recording comes from.
        output: index of the channel in `Plant.outputs`.
        first: index of the first repeated sample: the one before is still a reading.
        end: index after the last repeated sample.
        value: the reading that is repeated, in the channel's SI unit.
    """

    source: str
    output: int
    first: int
    end: int
    value: float


def stuck_stretches(recording: Recording, plant: Plant) -> tuple[Stuck, ...]:
    """Return all stretches in which a channel of a recording is stuck, channel by channel.

    A channel is stuck where it repeats one reading for `STUCK_S` or longer, while another channel
    moves, and where noise would hardly do that. Let p be the part of a channel's rows that repeat
    the row before, apart from repetitions that last `STUCK_S` or longer. Then noise repeats a
    reading n times somewhere in N rows with a chance of at most N p^n, which must be below
    `CHANCE`. A channel is not judged if its noise is no more than its resolution, as an encoder at
    rest repeats its count, if p is above `OFTEN`, or if there are too few rows to tell p from, as
    of a dead sensor. A reading at an end of its range is saturated and not stuck.

    Raises:
        KeyError: a channel that the plant needs is missing.
    """
    readings = [np.asarray(recording[output.channel]) for output in plant.outputs]
    least = max(round(STUCK_S / plant.period), 2)
    found = []
    for index, (output, values) in enumerate(zip(plant.outputs, readings, strict=True)):
        if not output.noise > output.resolution:
            continue
        for first, end in _repeated(values, least):
            value = float(values[first])
            inside = output.lower < value < output.upper
            if inside and _moves(readings, plant.outputs, index, first, end):
                found.append(Stuck(recording.source, index, first, end, value))
    return tuple(found)


def _repeated(values: Array, least: int) -> list[tuple[int, int]]:
    """Return the stretches of at least `least` repetitions that noise would hardly make.

    Each has the index of its first repeated reading and the index after its last. Missing readings
    (NaN) repeat nothing. There are no stretches if the channel cannot be judged: if fewer than
    `least` of the other rows are left, or if more than the part `OFTEN` of them repeats.
    """
    same = values[1:] == values[:-1]
    edges = np.flatnonzero(np.diff(np.r_[False, same, False])).reshape(-1, 2)
    long = [(int(a), int(b)) for a, b in edges if b - a >= least]
    others = int(same.sum()) - sum(b - a for a, b in long)
    rest = len(same) - sum(b - a for a, b in long)
    if rest < least:
        return []
    # One repetition more than was seen: a channel that was never seen to repeat may do so.
    likely = (others + 1) / (rest + 1)
    if likely > OFTEN:
        return []
    return [(a + 1, b + 1) for a, b in long if len(values) * likely ** (b - a) < CHANCE]


def _moves(
    readings: Sequence[Array], outputs: Sequence[Output], index: int, first: int, end: int
) -> bool:
    """Return whether a channel other than that of `index` moves from `first` on and before `end`.

    It moves if its readings there span more than `_MOVES` times their noise and rounding.
    """
    for other, (output, values) in enumerate(zip(outputs, readings, strict=True)):
        part = values[first:end]
        known = part[np.isfinite(part)]
        if other != index and len(known) and np.ptp(known) > _MOVES * output.variance**0.5:
            return True
    return False
