"""The filter of a loop, as the compiled ticks take it."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from estimator.filters import FilterMemory, ProductNoise
from rig.plant import Parameters

Array = NDArray[np.float64]


class Estimation(NamedTuple):
    """The filter that a loop runs, what it assumes, and where it writes."""

    code: int | None
    """Which filter."""
    x: Array
    """(states,) the newest estimates; updated."""
    covariance: Array
    """The filter's covariance, in its own form; updated."""
    parameters: Parameters
    """Of the rig, as the filter assumes them."""
    noise: ProductNoise
    """That the filter assumes."""
    work: Array
    """The filter's scratch space."""


def estimation(memory: FilterMemory, assumed: Parameters) -> Estimation:
    """Return a filter's memory for a compiled loop, which goes on in the same arrays."""
    return Estimation(
        memory.filter.code, memory.x, memory.covariance, assumed, memory.noise, memory.work
    )
