"""Whether a valve gets where it was sent, in time, and stays there."""

from collections.abc import Callable
from math import isnan

Clock = Callable[[], int]
"""Returns the present moment in ns, as `time.monotonic_ns`."""


class Travel:
    """The last move of one valve.

    Args:
        allowed_s: time within which feedback must confirm a move.
        tolerance: distance from the target that still counts as there.
        clock: tells the time.
    """

    def __init__(self, allowed_s: float, tolerance: float, clock: Clock) -> None:
        self._allowed_ns = round(allowed_s * 1e9)
        self._tolerance = tolerance
        self._clock = clock
        self._begun_ns = 0
        self._arrived = False
        self.target: float | None = None
        """Where it was sent; None before the first move."""

    def begin(self, target: float) -> None:
        """Note that the valve has just been sent to a position."""
        self.target = target
        self._arrived = False
        self._begun_ns = self._clock()

    def reached(self, position: float) -> bool:
        """Return whether a valve at `position` is where it was sent."""
        return self.target is not None and abs(position - self.target) <= self._tolerance

    def fault(self, position: float) -> str:
        """Return what is wrong with a valve that now stands at `position`; empty if nothing is."""
        if self.target is None:
            return ""
        if self.reached(position):
            self._arrived = True
            return ""
        if self._arrived:
            return f"has left {self.target:g} and stands {shown(position)}"
        elapsed_ns = self._clock() - self._begun_ns
        if elapsed_ns < self._allowed_ns:
            return ""
        return f"stuck {shown(position)} after {elapsed_ns * 1e-9:.1f} s, sent to {self.target:g}"


def shown(position: float) -> str:
    """Say where a valve stands."""
    return "with both switches on" if isnan(position) else f"at {position:.3g}"
