"""Moving average of absolute residuals, the thesis's detection signal (section 4.4, chapter 8)."""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from rig.jit import njit

Array = NDArray[np.float64]

THESIS_WINDOW: Final = 4000
"""Number of samples that are averaged (section 4.4): four seconds at 1 kHz."""


class MovingAverage(NamedTuple):
    """The memory of a moving average over n samples; `start_moving_average` makes it.

    Samples are divided into blocks of n. The window consists of the end of the old block and the
    start of the new one. For each sample of the old block the sum from there to the block's end is
    stored, so that nothing is ever subtracted: no rounding error builds up, and the huge residual
    of a diverged filter leaves no trace once it is out of the window.

    Attributes:
        sums: (n,), before the present position the new block's absolute values, and from there on
            the old block's sums to its end.
        counts: (n,), the same for the number of values that are not NaN.
        present: (3,), position in the new block, sum and count of the new block so far.
    """

    sums: Array
    counts: Array
    present: Array


def start_moving_average(n: int = THESIS_WINDOW) -> MovingAverage:
    """Return the memory of a moving average over n samples, before its first sample.

    Raises:
        ValueError: n is below 1.
    """
    if n < 1:
        raise ValueError(f"moving average: window of {n} samples; give at least 1")
    return MovingAverage(np.zeros(n), np.zeros(n), np.zeros(3))


@njit(cache=True, error_model="numpy")
def moving_average_step(memory: MovingAverage, residual: float) -> float:
    """Add one residual and return the mean absolute value of the last n, NaN residuals left out.

    Before n residuals have come, it is the mean of those so far. It is NaN if all of them are NaN.
    The time is O(1) on average, but the n-th sample of a block costs n additions. `memory` is
    updated in place.
    """
    sums, counts, present = memory
    n = sums.size
    position = int(present[0])
    valid = residual == residual
    sums[position] = abs(residual) if valid else 0.0
    counts[position] = 1.0 if valid else 0.0
    present[1] += sums[position]
    present[2] += counts[position]
    position += 1
    total, count = present[1], present[2]
    if position < n:
        present[0] = position
        total += sums[position]
        count += counts[position]
    else:
        present[:] = 0.0
        for i in range(n - 2, -1, -1):
            sums[i] += sums[i + 1]
            counts[i] += counts[i + 1]
    return total / count if count > 0.0 else np.nan


@njit(cache=True, error_model="numpy")
def _fill(residual: Array, memory: MovingAverage, averages: Array) -> None:
    for k in range(residual.size):
        averages[k] = moving_average_step(memory, residual[k])


def moving_average_absolute(residual: Array, n: int = THESIS_WINDOW) -> Array:
    """Return the moving average of absolute values over the last n samples, (N,) as `residual`.

    NaN residuals are left out; the first n - 1 values are means of the samples so far. The result
    is bit for bit that of `moving_average_step` for sample after sample.

    Raises:
        ValueError: n is below 1, or `residual` is not one-dimensional.
    """
    if residual.ndim != 1:
        raise ValueError(f"moving average: residual of shape {residual.shape}; give one series")
    return extend_moving_average(start_moving_average(n), np.asarray(residual, dtype=np.float64))


def extend_moving_average(memory: MovingAverage, residual: Array) -> Array:
    """Add residuals (m,) to `memory`, in place, and return the moving average after each (m,)."""
    averages = np.empty(residual.size)
    _fill(np.ascontiguousarray(residual), memory, averages)
    return averages
