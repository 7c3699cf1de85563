"""A batch of samples as a reader keeps it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .messages import Channels, Samples

Singles = NDArray[np.float32]


@dataclass(frozen=True)
class Received:
    """A received batch with its channels, the time of its arrival, and whether it was asked for."""

    samples: Samples
    channels: Channels
    received_ns: int
    is_past: bool = False

    def column(self, name: str) -> Singles:
        """Return the values (n,) of a channel; NaN if the batch does not have it."""
        if name in self.channels.names:
            return self.samples.values[:, self.channels.names.index(name)]
        return np.full(len(self.samples.time_s), np.nan, np.float32)


def period_s(samples: Samples) -> float:
    """Return the median time in s between two samples; 1 ms for a batch of a single sample."""
    if len(samples.time_s) < 2:
        return 1e-3
    return max(float(np.median(np.diff(samples.time_s))), 1e-6)
