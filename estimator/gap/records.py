"""A recording as the filter takes it: inputs, readings, and how far each reading can be trusted."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from rig.recording import Recording

from .plant import Array, Plant

LONGEST_DWELL = 100
"""Samples that an encoder's count may rest before it counts as a new reading."""


@dataclass(eq=False)
class Record:
    """One recording, and the gains with which it was last filtered.

    Attributes:
        source: where it comes from.
        inputs: float64 (n, inputs), as commanded.
        readings: float64 (n, outputs).
        variances: float64 (n, outputs); infinite where a reading is missing or saturated.
        gains: float64 (n, outputs, states), of the last filter run.
        innovation_variances: float64 (n, outputs), likewise.
    """

    source: str
    inputs: Array
    readings: Array
    variances: Array
    gains: Array = field(init=False, repr=False)
    innovation_variances: Array = field(init=False, repr=False)

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
    return made_of(recording.source, inputs, readings, plant)


def made_of(source: str, inputs: Array, readings: Array, plant: Plant) -> Record:
    """Return a record of inputs (n, inputs) and readings (n, outputs).

    While a counting sensor rests on one count it tells but once where the ram is: its variance is
    spread over the samples that it rests.
    """
    variances = np.empty_like(readings)
    for index, output in enumerate(plant.outputs):
        values = readings[:, index]
        variances[:, index] = output.noise**2
        if output.resolution > 0.0:
            variances[:, index] += output.resolution**2 / 12.0 * _dwell(values)
        unusable = ~((values > output.lower) & (values < output.upper))
        variances[unusable, index] = np.inf
    clean = np.where(np.isfinite(readings), readings, 0.0)
    return Record(source, np.ascontiguousarray(inputs), np.ascontiguousarray(clean), variances)


def _dwell(values: Array) -> Array:
    """Return for each sample how many samples in a row have its value, at most LONGEST_DWELL."""
    starts = np.flatnonzero(np.r_[True, values[1:] != values[:-1]])
    lengths = np.diff(np.r_[starts, len(values)])
    return np.minimum(np.repeat(lengths, lengths), LONGEST_DWELL).astype(np.float64)


def delayed(inputs: Array, samples: float) -> Array:
    """Return inputs (n, k), each held over its sample, that act later by a number of samples."""
    if samples <= 0.0:
        return inputs
    whole = int(samples)
    part = samples - whole
    index = np.arange(len(inputs))
    later = inputs[np.maximum(index - whole, 0)]
    earlier = inputs[np.maximum(index - whole - 1, 0)]
    return np.ascontiguousarray((1.0 - part) * later + part * earlier)


def inputs_of(record: Record, plant: Plant, values: Mapping[str, float]) -> Array:
    """Return the inputs (n, inputs) as they act, later by the plant's input delay."""
    if plant.input_delay is None:
        return record.inputs
    return delayed(record.inputs, values[plant.input_delay] / plant.period)
