"""The function by which tests wait for an event.

A test waits for an event, never for a fixed time. A busy machine then makes the test slow, but
does not make it fail. To check that something does not happen, a test waits for a later event
first.
"""

import time
from collections.abc import Callable
from typing import Final, TypeVar

T = TypeVar("T")

PATIENCE_S: Final = 60.0
"""s: how long a test waits for an event; only a failure takes so long."""
COMPILE_S: Final = 300.0
"""s: how long a test waits if something may have to be compiled first."""
_LOOK_S: Final = 0.02


def until(
    done: Callable[[], T],
    what: str = "something",
    patience_s: float = PATIENCE_S,
    *,
    meanwhile: Callable[[], object] = lambda: None,
) -> T:
    """Call `done` again and again, and return its first true value.

    Args:
        done: the condition to wait for.
        what: the event that is waited for, in words for the message.
        patience_s: how long to wait, s.
        meanwhile: is called between two calls of `done`.

    Raises:
        AssertionError: `done` returned no true value in time.
    """
    end = time.monotonic() + patience_s
    while not (found := done()):
        assert time.monotonic() < end, f"waited {patience_s:g} s in vain for {what}"
        meanwhile()
        time.sleep(_LOOK_S)
    return found
