"""Detection of a lost filter: its innovations are far larger than expected, or it has become NaN.

The squared innovations of a window, each divided by its expected variance, follow a chi-square
distribution if the model is right. No model is. Usual errors are covered by the filter's noise;
unusual events (a ram that strikes a stroke end, a leak that opens) make innovations larger for a
while, without the filter being lost. A window therefore counts as lost only if its sum exceeds a
bound that innovations `TOLERATED` times as large as expected exceed once in 1e9 windows (16 years).
No reading counts for more than `LARGEST`, as a spike is no divergence. A filter is also lost if a
window ends with a leak far below zero, or with a spool's null that no valve has. If windows are
lost again right after a reset, the model is probably wrong. The next reset therefore waits for a
good window, or for ten seconds of lost ones.
"""

from math import isfinite, sqrt
from typing import Final

from rig.plant import inlined

SQUARES: Final = 0
"""Index in the array `watch`: sum of squared innovations of the window."""
READINGS: Final = 1
"""Index in `watch`: number of squares in that sum, which is its degrees of freedom."""
TICKS: Final = 2
"""Index in `watch`: number of ticks of the window so far."""
RESETS: Final = 3
"""Index in `watch`: how often the filter has started anew since its first sample."""
PATIENCE: Final = 4
"""Index in `watch`: number of lost windows before the next reset; a good window sets it to 0."""
SUPPLY: Final = 5
"""Index in `watch`: the newest supply pressure, Pa."""

WINDOW: Final = 500.0
"""Length of a window in ticks: half a second, in which all states but leaks and null settle."""
TOLERATED: Final = 3.0
"""Factor by which innovations may exceed their expected standard deviation."""
LARGEST: Final = 100.0
"""Upper bound of one reading's squared innovation in the sum: ten standard deviations."""
QUANTILE: Final = 6.0
"""Quantile of the normal distribution at 1 - 1e-9, from which the bound of a window follows."""
PAUSE: Final = 20.0
"""Number of lost windows (10 s) after a reset before the filter is reset again."""


@inlined
def clear_window(watch):
    """Begin a new window in `watch`: set its sums and its count of ticks to zero."""
    watch[SQUARES] = watch[READINGS] = watch[TICKS] = 0.0


@inlined
def take_innovation(watch, square):
    """Add one reading's squared innovation to the sums of the window in `watch`, in place.

    `square` has been divided by its expected variance already. It counts for `LARGEST` at most.
    """
    watch[SQUARES] += min(square, LARGEST)
    watch[READINGS] += 1.0


@inlined
def count_reset(watch):
    """Count a reset of the filter in `watch` and begin a new window.

    The next reset then waits for `PAUSE` lost windows in a row, or for a good window.
    """
    watch[RESETS] += 1.0
    watch[PATIENCE] = PAUSE
    clear_window(watch)


@inlined
def _bound(readings):
    """Return the bound of a window's sum for a number of readings, its degrees of freedom.

    It is the chi-square quantile at `QUANTILE` (Wilson and Hilferty 1931) times `TOLERATED`
    squared.
    """
    spread = 2.0 / (9.0 * readings)
    root = 1.0 - spread + QUANTILE * sqrt(spread)
    return TOLERATED * TOLERATED * readings * root * root * root


@inlined
def is_finite(x, factors):
    """Return whether a state (n,) and the diagonal of its covariance's factors are all finite."""
    total = 0.0
    for i in range(x.size):
        total += abs(x[i]) + factors[i, i]
    return isfinite(total)


@inlined
def is_lost(watch, possible):
    """Count a tick; at the end of a window, return whether the filter must start anew.

    Args:
        watch: memory with the indices above, updated.
        possible: whether leaks and null bias are in a range that a rig can have.

    Returns:
        False within a window; True at its end if it is lost and the filter may be reset again. A
        window without readings is not lost.
    """
    watch[TICKS] += 1.0
    if watch[TICKS] < WINDOW:
        return False
    readings = watch[READINGS]
    lost = readings > 0.0 and (not possible or watch[SQUARES] > _bound(readings))
    clear_window(watch)
    watch[PATIENCE] = watch[PATIENCE] - 1.0 if lost else 0.0
    return lost and watch[PATIENCE] < 0.0
