"""Limits how often passwords can be tried, without locking an account for its owner."""

from collections import OrderedDict, deque
from collections.abc import Callable, Iterator
from typing import Final

OF_A_NAME: Final = 5
"""Passwords that one source may try for one name within `WITHIN_S` s, as many as tokens."""
OF_A_SOURCE: Final = 20
"""Passwords that one source may try for all names within `WITHIN_S` s.

Four people behind one tunnel may all mistype as often as they can; whoever tries one password for
every name of a list is stopped.
"""
WITHIN_S: Final = 60.0
MOST_SOURCES: Final = 2000
"""Most pairs of source and name that are kept; the one unused for longest is forgotten first."""


class TooManyAttemptsError(Exception):
    """The error of an attempt that must wait.

    Attributes:
        wait_s: time in s after which another attempt is taken.
    """

    def __init__(self, wait_s: float) -> None:
        self.wait_s = wait_s
        super().__init__(f"too many attempts; wait {wait_s:.0f} s")


class Attempts:
    """The attempts of the last minute that have failed, or whose end is not known yet.

    An attempt counts from its beginning on, so that many at once are limited as well.

    Args:
        clock: returns a monotonic time in s.
    """

    def __init__(self, clock: Callable[[], float]) -> None:
        self._clock = clock
        self._times: OrderedDict[tuple[str, str], deque[float]] = OrderedDict()

    def begin(self, source: str, name: str) -> None:
        """Count an attempt.

        Args:
            source: where it comes from: an address, or a browser that was logged in as this name.
            name: the name that is tried, which is not empty.

        Raises:
            TooManyAttemptsError: there were too many; this one does not count.
        """
        now = self._clock()
        for times, most in self._counted(source, name):
            while times and times[0] <= now - WITHIN_S:
                times.popleft()
            if len(times) >= most:
                raise TooManyAttemptsError(WITHIN_S - (now - times[0]))
        for times, _ in self._counted(source, name):
            times.append(now)
        while len(self._times) > MOST_SOURCES:
            self._times.popitem(last=False)

    def take_back(self, source: str, name: str) -> None:
        """Do not count the newest attempt: its password was right, or was not looked at."""
        for times, _ in self._counted(source, name):
            if times:
                times.pop()

    def _counted(self, source: str, name: str) -> Iterator[tuple[deque[float], int]]:
        for key, most in (((source, name), OF_A_NAME), ((source, ""), OF_A_SOURCE)):
            times = self._times.setdefault(key, deque())
            self._times.move_to_end(key)
            yield times, most
