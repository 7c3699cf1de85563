"""This module finds stretches of a recording in which a channel is stuck at one value."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from rig.recording import Recording

from .interface import Array, Output, Plant

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

    A reading that has noise seldom repeats: two rows that follow each other are equal in a part p
    of a channel's other rows, so that noise repeats a reading n times somewhere in N rows with a
    chance of at most N p^n. A channel is stuck where that chance is below `CHANCE`, for `STUCK_S`
    or longer, while another channel moves. A channel is not judged if it is coarser than its noise,
    as an encoder at rest repeats its count, if p is above `OFTEN`, or if it has too few other rows
    to tell p from, as a dead sensor has. A reading at an end of its range is saturated and not
    stuck.

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
    """Return first index and end of each stretch of `least` repetitions that noise does not make.

    Missing readings repeat nothing.
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
    """Return whether a channel other than that of `index` moves within some samples."""
    for other, (output, values) in enumerate(zip(outputs, readings, strict=True)):
        part = values[first:end]
        known = part[np.isfinite(part)]
        if other != index and len(known) and np.ptp(known) > _MOVES * output.variance**0.5:
            return True
    return False
