"""A thread or callback that must not end is kept going here after an error, which is reported.

A thread that ends by an exception leaves only a traceback that nobody reads, and its work is not
done any more. With `Surviving` it only loses the one turn that failed, and the error is reported.
"""

import errno
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from traceback import extract_tb
from types import TracebackType
from typing import Final

MOST_TOLD: Final = 100
"""Most different failures that are reported, so that a thread fills no log within weeks."""
LONGEST: Final = 300
"""Most characters of an error's type and text that are reported."""


class Surviving:
    """A context manager that suppresses and reports exceptions; it is entered at each turn.

    Exceptions that are meant to end the program (`SystemExit`, `KeyboardInterrupt`) are raised on.

    Args:
        what: name of the activity that goes on, for the line that reports a failure: "the control
            port".
        tell: is called with that line, once for each different failure of the first `MOST_TOLD`,
            from the thread that failed.

    Attributes:
        count: number of failures so far, repetitions included.
    """

    def __init__(self, what: str, tell: Callable[[str], object]) -> None:
        self._what = what
        self._tell = tell
        self._told: set[str] = set()
        self.count = 0

    def __enter__(self) -> None:
        """Begin a turn, without doing anything."""

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> bool:
        """End a turn; suppress and report an exception that was raised in it."""
        if not isinstance(error, Exception):
            return False
        self.note(error)
        return True

    def note(self, error: Exception) -> None:
        """Count a failure; report it unless the same one or `MOST_TOLD` others were reported."""
        self.count += 1
        line = failure(error)
        if line in self._told or len(self._told) >= MOST_TOLD:
            return
        self._told.add(line)
        # The thread goes on even if the report fails.
        with suppress(Exception):
            self._tell(f"{self._what} goes on after a failure: {line}")


def start(thread: threading.Thread) -> None:
    """Start a thread.

    Raises:
        OSError: the system grants no further thread (EAGAIN).
    """
    with threads_granted():
        thread.start()


@contextmanager
def threads_granted() -> Iterator[None]:
    """Let the block start threads, and do nothing else; that none is granted is a system's error.

    Raises:
        OSError: the system grants no further thread (EAGAIN). Python itself raises a RuntimeError,
            which would be taken for a mistake in the program.
    """
    try:
        yield
    except RuntimeError:
        raise OSError(errno.EAGAIN, "the system grants no further thread") from None


def failure(error: BaseException) -> str:
    """Return an exception's type and text on one line, with the file and line where it was raised.

    Type and text are cut after `LONGEST` characters; an exception that was not raised has no place.
    """
    text = " ".join(f"{type(error).__name__}: {error}".split())[:LONGEST]
    frames = extract_tb(error.__traceback__)
    return f"{text} ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else text
