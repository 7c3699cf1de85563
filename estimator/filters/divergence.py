"""Tells when a filter is lost: by its innovations against what it expects of them, and by NaN.

The squared innovations of a window, each over its expected variance, are of chi-square if the model
is right. It never is: a budget of model errors covers what is usual, and what is unusual (a stroke
end struck, a leak that opens) makes innovations larger for a while without the filter being lost.
So a window counts as lost only beyond what innovations `TOLERATED` times as large as expected
would show once in 1e9 windows, that is in 16 years. No reading counts for more than `LARGEST`: a
spike is no divergence. Lost is as well who ends a window with a leak far below zero, or a spool's
null where no valve has it. If a window is lost again right after a reset, the model is wrong rather
than the filter lost: the next reset then waits for a good window, or for ten seconds.
"""

from math import isfinite, sqrt
from typing import Final

from rig.plant import inlined

SQUARES: Final = 0
"""Index in a `Watch` row: sum of squared innovations of the window."""
READINGS: Final = 1
"""Index: how many squares were summed, the degrees of freedom."""
TICKS: Final = 2
"""Index: ticks of the window so far."""
RESETS: Final = 3
"""Index: how often the filter has started anew since its first sample."""
PATIENCE: Final = 4
"""Index: windows to wait before the next reset, unless one is good."""
SUPPLY: Final = 5
"""Index: the newest supply pressure, Pa."""

WINDOW: Final = 500.0
"""Ticks: half a second, in which every state but leaks and null settles."""
TOLERATED: Final = 3.0
LARGEST: Final = 100.0
"""The most that the squared innovation of one reading counts for: ten standard deviations."""
QUANTILE: Final = 6.0
"""Quantile of the normal distribution at 1 - 1e-9, from which the bound of a window follows."""
PAUSE: Final = 20.0
"""Windows that the filter has after a reset before it may be reset again."""


@inlined
def clear_window(watch):
    """Begin a window."""
    watch[SQUARES] = watch[READINGS] = watch[TICKS] = 0.0


@inlined
def take_innovation(watch, square):
    """Count a squared innovation, over its expected variance, into the window."""
    watch[SQUARES] += min(square, LARGEST)
    watch[READINGS] += 1.0


@inlined
def count_reset(watch):
    """Count a reset and begin a window."""
    watch[RESETS] += 1.0
    watch[PATIENCE] = PAUSE
    clear_window(watch)


@inlined
def _bound(readings):
    """Return the quantile of chi-square (Wilson and Hilferty 1931) times the tolerated square."""
    spread = 2.0 / (9.0 * readings)
    root = 1.0 - spread + QUANTILE * sqrt(spread)
    return TOLERATED * TOLERATED * readings * root * root * root


@inlined
def is_finite(x, factors):
    """Return whether a state (n,) and the factors (n, n) of its covariance are finite."""
    total = 0.0
    for i in range(x.size):
        total += abs(x[i]) + factors[i, i]
    return isfinite(total)


@inlined
def is_lost(watch, possible):
    """Count a tick and return whether the filter has to start anew; found out window by window.

    Args:
        watch: the row kept for this.
        possible: whether the estimates are what a rig can have.
    """
    watch[TICKS] += 1.0
    if watch[TICKS] < WINDOW:
        return False
    readings = watch[READINGS]
    lost = readings > 0.0 and (not possible or watch[SQUARES] > _bound(readings))
    clear_window(watch)
    watch[PATIENCE] = watch[PATIENCE] - 1.0 if lost else 0.0
    return lost and watch[PATIENCE] < 0.0
