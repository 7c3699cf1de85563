"""What may not end: a thread or a callback that goes on whatever fails in it, and says what failed.

A thread that ends by an exception leaves nothing but a traceback that nobody reads, and whatever it
did is not done any more. Here it loses the one thing that failed, and somebody is told.
"""

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from traceback import extract_tb
from types import TracebackType
from typing import Final

MOST_TOLD: Final = 100
"""Different failures that are told; a thread that lives for weeks fills no log."""
LONGEST: Final = 300
"""Most characters of an error's type and text that are told."""


class Surviving:
    """Holds back every exception that is raised under it; a context manager, entered at each turn.

    An exception that is meant to end the program (`SystemExit`, `KeyboardInterrupt`) is not held.

    Args:
        what: goes on, in the words of the line that tells of a failure: "the control port".
        tell: is given that line, each failure once; may be called from any thread.

    Attributes:
        count: how often something failed.
    """

    def __init__(self, what: str, tell: Callable[[str], object]) -> None:
        self._what = what
        self._tell = tell
        self._told: set[str] = set()
        self.count = 0

    def __enter__(self) -> None:
        """Begin a turn."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        """End a turn; hold back what was raised in it."""
        if not isinstance(error, Exception):
            return False
        self.note(error)
        return True

    def note(self, error: Exception) -> None:
        """Count a failure, and tell of it if it is the first of its kind."""
        self.count += 1
        line = failure(error)
        if line in self._told or len(self._told) >= MOST_TOLD:
            return
        self._told.add(line)
        # Where nobody can be told, the thread goes on all the same.
        with suppress(Exception):
            self._tell(f"{self._what} goes on after a failure: {line}")


def failure(error: BaseException) -> str:
    """Return an exception on one line, with the place in the program where it was raised."""
    text = " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST]
    frames = extract_tb(error.__traceback__)
    return f"{text} ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else text
