"""A recording as the filter takes it: inputs, readings, and how far each reading can be trusted."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from rig.recording import Recording

from .interface import Array, Plant

BoolArray = NDArray[np.bool_]

_SMOOTHED = 11
"""Samples of the moving mean by which saturation is told."""
_MARGIN = 3.0
"""Standard deviations from a limit within which a sensor's noise is cut off."""
_BEFORE, _AFTER = 3, 30
"""Samples before and after a blow in which readings are not known to a fraction of a sample."""
LONGEST_DWELL = 100
"""Samples that an encoder's count may rest before it counts as a new reading."""
TIMES_OF_EXCHANGE = ("sent_s", "exchange_s")
"""Columns of a loop on hardware: when in a tick its exchange was, and how long it took."""
BLIND_S = 0.05
"""Without two of the readings for longer, a filter does not know where the plant went."""
UNTIMELY_S = 1.5e-4
"""How much later or earlier than usual a sample may come, s: at 0.2 m/s a count of the encoder."""


@dataclass(frozen=True, eq=False)
class Gains:
    """How strongly a filter corrected each state by each reading.

    Attributes:
        states: float64 (n, outputs, states), change of a state by an innovation.
        variances: float64 (n, outputs), of the innovations; infinite where not used.
        couplings: float64 (n, outputs, outputs), of a sample's innovations with earlier ones.
    """

    states: Array
    variances: Array
    couplings: Array


@dataclass(frozen=True, eq=False)
class Record:
    """One recording.

    Attributes:
        source: where it comes from.
        inputs: float64 (n, inputs), as commanded.
        readings: float64 (n, outputs).
        variances: float64 (n, outputs); infinite where a reading is missing or saturated.
        first: samples of its recording before it.
    """

    source: str
    inputs: Array
    readings: Array
    variances: Array
    first: int = 0

    def __len__(self) -> int:
        """Return the number of samples."""
        return len(self.inputs)


def record_of(recording: Recording, plant: Plant) -> Record:
    """Return a recording as the filter of this plant takes it.

    Raises:
        KeyError: a channel that the plant needs is missing.
    """
    inputs = np.column_stack([recording[name] for name in plant.inputs])
    readings = np.column_stack([recording[output.channel] for output in plant.outputs])
    late = np.where(untimely(recording), np.nan, lateness(recording))
    readings[~np.isfinite(late)] = np.nan
    record = made_of(recording.source, inputs, readings, plant)
    # What it was at the time that all others are of: 50 us at 0.3 m/s are half a count.
    moved = np.nan_to_num(late)[:, None] * _rates(record.readings, plant.period)
    return replace(record, readings=record.readings - moved)


def seen_parts(record: Record, period: float) -> list[Record]:
    """Return the parts of a record in which the plant's state can be followed.

    Where two readings or more (of fewer outputs all) are missing or at an end of their range for
    longer than `BLIND_S`, the state is not known: both chambers empty, their vapour may be of any
    volume, and what comes when they fill again is not the model's fault. A part begins where all
    are read: what is empty at its beginning is not known either.
    """
    unused = ~np.isfinite(record.variances)
    blind = unused.sum(1) >= min(2, unused.shape[1])
    edges = np.flatnonzero(np.diff(np.r_[False, blind, False])).reshape(-1, 2)
    lost = [(int(a), int(b)) for a, b in edges if (b - a) * period > BLIND_S]
    if not lost:
        return [record]
    parts: list[tuple[int, int]] = []
    ends = [0, *(end for stretch in lost for end in stretch), len(record)]
    for first, last in zip(ends[::2], ends[1::2], strict=True):
        known = np.flatnonzero(~unused[first:last].any(1))
        if len(known):
            parts.append((first + int(known[0]), last))
    return [
        Record(
            record.source, np.ascontiguousarray(record.inputs[a:b]),
            np.ascontiguousarray(record.readings[a:b]),
            np.ascontiguousarray(record.variances[a:b]), record.first + a,
        )
        for a, b in parts
    ]  # fmt: skip


def lateness(recording: Recording) -> Array:
    """Return by how much later than usual each sample was taken, s (n,); NaN if not known.

    A loop on hardware writes and reads in one exchange: a row's command acts from its own sample
    on, and what all exchanges are late by is no delay. An exchange that is later than the others is
    a sample of another time, which no effect of the rig must be made responsible for.
    """
    if not all(name in recording for name in TIMES_OF_EXCHANGE):
        return np.zeros(len(recording))
    late = sum((recording[name] for name in TIMES_OF_EXCHANGE), np.zeros(len(recording)))
    if not np.isfinite(late).any():
        return np.zeros(len(recording))
    return np.asarray(late - np.nanmedian(late))


def untimely(recording: Recording) -> BoolArray:
    """Return for each sample whether it was taken at another time than it says (n,)."""
    return np.asarray(~(np.abs(lateness(recording)) <= UNTIMELY_S))


def _rates(readings: Array, period: float) -> Array:
    """Return rates of change (n, outputs) of readings, over some samples about each."""
    rates = np.zeros_like(readings)
    half = _SMOOTHED // 2
    rates[half:-half] = (readings[2 * half :] - readings[: -2 * half]) / (2 * half * period)
    return rates


def made_of(source: str, inputs: Array, readings: Array, plant: Plant) -> Record:
    """Return a record of inputs (n, inputs) and readings (n, outputs).

    While a counting sensor rests on one count it tells but once where the ram is: its variance is
    spread over the samples that it rests.
    """
    variances = np.empty_like(readings)
    missing = ~np.isfinite(readings)
    held = _held(readings, missing)
    for index, output in enumerate(plant.outputs):
        values = held[:, index]
        variances[:, index] = output.noise**2
        if output.resolution > 0.0:
            variances[:, index] += output.resolution**2 / 12.0 * _dwell(values)
        unusable = missing[:, index] | ~((values > output.lower) & (values < output.upper))
        # By the mean, not by the reading: those that noise keeps off the limit are too high.
        mean, margin = smoothed(values), _MARGIN * output.noise
        unusable |= (mean < output.lower + margin) | (mean > output.upper - margin)
        variances[unusable, index] = np.inf
    return Record(source, np.ascontiguousarray(inputs), np.ascontiguousarray(held), variances)


def _held(readings: Array, missing: BoolArray) -> Array:
    """Return readings (n, outputs) whose missing ones are the last there was, else the first.

    A twin is steered along them; the filter leaves them out.
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
    """Return the moving mean (n,) of values (n,) over `_SMOOTHED` samples."""
    half = _SMOOTHED // 2
    padded = np.pad(values, half, mode="edge")
    sums = np.cumsum(np.concatenate([[0.0], padded]))
    return np.asarray((sums[_SMOOTHED:] - sums[:-_SMOOTHED]) / _SMOOTHED)


def roughness(record: Record, plant: Plant, values: Mapping[str, float]) -> Array:
    """Return variances (n, outputs) to be added where the plant is violent.

    When within a sample a ram meets its stop is not known. What a reading changed by around that
    sample is what it may be wrong by.
    """
    added = np.zeros_like(record.readings)
    if plant.violent is None:
        return added
    hit = plant.violent(record.readings, values)
    if not hit.any():
        return added
    # From a little before, to when what the blow left has died down.
    around = np.convolve(hit, np.ones(_BEFORE + _AFTER + 1), mode="full") > 0.5
    around = around[_BEFORE : _BEFORE + len(hit)]
    steps = np.abs(np.diff(record.readings, axis=0, prepend=record.readings[:1]))
    for shift in range(-2, 3):
        np.maximum(added, np.roll(steps, shift, axis=0), out=added)
    added *= added
    added[~around] = 0.0
    return added


def _dwell(values: Array) -> Array:
    """Return for each sample how many samples in a row have its value, at most LONGEST_DWELL."""
    starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    lengths = np.diff(np.r_[starts, len(values)])
    return np.minimum(np.repeat(lengths, lengths), LONGEST_DWELL).astype(np.float64)
