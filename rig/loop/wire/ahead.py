"""Setpoints of a segment that runs are replaced ahead of the loop, while it follows earlier ones.

So a motion can go on as people ask for it, without another segment and without a change in the
compiled loop: the loop reads each setpoint at its own tick, and another thread of its process
replaces those that are still to come. What is laid out always ends at rest. If no further order
comes, for whatever reason, the ram comes to rest there.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rig.loop.board import Word

Array = NDArray[np.float64]

LEAST_AHEAD_TICKS: Final = 15
"""Number of ticks that the loop must still be before the first setpoint that changes.

The setpoints are copied in well below a millisecond. If the system takes the processor from the
thread that copies them, this is how long it may do so before the loop can meet setpoints of which
only a part is new.
"""

FILLED_TICKS: Final = 20_000
"""Number of ticks after a motion that is to go on, in which the setpoint rests.

A supervisor that sends no further order meanwhile has stopped to work, for which the rig trips
within 6 s: its main thread may be silent for 5 s, and its beat for less than 1 s.
"""


@dataclass(frozen=True)
class SetAhead:
    """The order of other setpoints for a segment that runs; the answer is whether they are taken.

    The setpoints from `first` on become `values`, and later ones the last of these, without
    feedforward: all of them if the motion ends there, else `FILLED_TICKS` of them. They are not
    taken, and the earlier ones stay, if the loop runs another segment or is fewer than
    `LEAST_AHEAD_TICKS` before `first`.

    Attributes:
        segment: number of the segment, which tracks positions and has a feedforward for each tick.
        first: index of the first setpoint that changes.
        values: (n,) setpoints in m, at least one, of a motion that ends at rest.
        feedforward: (n,) feedforward in V.
        ends: whether the motion ends there; otherwise further orders will follow.
    """

    segment: int
    first: int
    values: Array
    feedforward: Array
    ends: bool


def set_ahead(
    order: SetAhead, setpoint: Array, feedforward: Array, words: NDArray[np.int64]
) -> bool:
    """Replace setpoints as an order says, the nearest first; return whether that was in time.

    Args:
        order: the order.
        setpoint: (ticks,) setpoints of the segment that runs, m; changed in place.
        feedforward: (ticks,) its feedforward, V; changed in place.
        words: words of the board, by which it is seen where the loop is.
    """
    first, end = order.first, order.first + order.values.size
    runs = words[Word.SEGMENT] == order.segment == words[Word.SWITCH]
    fits = first >= 0 and order.values.size and end <= setpoint.size == feedforward.size
    if not runs or not fits or first < words[Word.TICK] + LEAST_AHEAD_TICKS:
        return False
    setpoint[first:end] = order.values
    feedforward[first:end] = order.feedforward
    until = setpoint.size if order.ends else end + FILLED_TICKS
    setpoint[end:until] = order.values[-1]
    feedforward[end:until] = 0.0
    return True
