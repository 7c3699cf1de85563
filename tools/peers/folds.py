"""Cross-validation over the recordings that are fitted to, or over the halves of a single one."""

from collections.abc import Iterator, Sequence
from typing import TypeVar

from tools.peers.discrepancy import Samples

Each = TypeVar("Each")


def left_out(parts: Sequence[Each]) -> Iterator[tuple[Each, list[Each]]]:
    """Yield each part with all the others."""
    for place, part in enumerate(parts):
        yield part, [*parts[:place], *parts[place + 1 :]]


def parts_of(samples: Samples) -> list[Samples]:
    """Return the two halves of the samples of one record, one after the other."""
    middle = len(samples.values) // 2
    return [
        Samples(samples.quantities[rows], samples.values[rows])
        for rows in (slice(0, middle), slice(middle, None))
    ]
