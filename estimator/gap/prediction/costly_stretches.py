"""This module selects the stretches of records that cost most, and so show the gap best."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from estimator.gap.plant import Array, Record

from .linear import slices_of

STRETCH: Final = 8
"""Number of blocks in a stretch. One more block before them lets the filter's response settle."""
MOST_BLOCKS: Final = 48
"""Greatest number of blocks that are selected from all records together; they last 24 s."""

OF_EACH: Final = 2
"""Number of stretches of each record that come before all others."""


@dataclass(frozen=True)
class Excerpt:
    """The selected part of a record.

    Attributes:
        samples: int64 (m,), indices of the selected samples in the record, ascending.
        blocks: the blocks that count, as slices of `samples`; the blocks that lead in are left out.
        places: int64 (blocks,), indices of these blocks among all blocks of all records.
    """

    samples: NDArray[np.int64]
    blocks: tuple[slice, ...]
    places: NDArray[np.int64]


def excerpts(records: Sequence[Record], period: float, costs: Array) -> list[Excerpt]:
    """Return the costliest stretches of all records, as one excerpt for each record.

    A stretch has 8 blocks, or what is left at a record's end, and is as costly as its mean block.
    At most 48 blocks are taken together; a stretch that would exceed that is left out.
    The two costliest of each record come first: what depends on a quantity that hardly changes
    within a record, such as the pressure on a seal, shows in several records only. The excerpt of a
    record of which no stretch is taken is empty.

    Args:
        records: the records.
        period: sampling period, s.
        costs: float64 (blocks,), of the blocks of all records, one after the other.
    """
    stretches = []
    blocks_of = [slices_of(record, period) for record in records]
    firsts = np.cumsum([0, *map(len, blocks_of)])
    for index, (blocks, first) in enumerate(zip(blocks_of, firsts, strict=False)):
        for begin in range(0, len(blocks), STRETCH):
            end = min(begin + STRETCH, len(blocks))
            cost = float(costs[first + begin : first + end].mean())
            stretches.append((cost, index, begin, end))
    chosen: list[list[int]] = [[] for _ in records]
    left = MOST_BLOCKS
    ranked = sorted(stretches, reverse=True)
    of_record = [[each for each in ranked if each[1] == index] for index in range(len(records))]
    # One after the other of each record, so that each is in two folds of a cross-validation.
    first_of_all = [
        stretch
        for number in range(OF_EACH)
        for stretch in sorted((own[number] for own in of_record if number < len(own)), reverse=True)
    ]
    for _, index, begin, end in dict.fromkeys([*first_of_all, *ranked]):
        if end - begin <= left:
            chosen[index] += range(begin, end)
            left -= end - begin
    found = []
    for blocks, kept, first in zip(blocks_of, chosen, firsts, strict=False):
        kept.sort()
        length = blocks[0].stop - blocks[0].start if blocks else 0
        wanted: set[int] = set()
        for number in kept:
            wanted.update(range(max(blocks[number].start - length, 0), blocks[number].stop))
        samples = np.array(sorted(wanted), dtype=np.int64)
        starts = [int(np.searchsorted(samples, blocks[number].start)) for number in kept]
        own = tuple(slice(start, start + length) for start in starts)
        found.append(Excerpt(samples, own, np.array(kept, dtype=np.int64) + first))
    return found
