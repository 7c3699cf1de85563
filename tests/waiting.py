"""How tests wait: for what is bound to come, with the same patience everywhere.

A test waits for an event and never for a time: a machine that has other work makes it slow and
not wrong. What must not happen is looked for after something that comes later has happened.
"""

import time
from collections.abc import Callable
from typing import Final, TypeVar

T = TypeVar("T")

PATIENCE_S: Final = 60.0
"""How long anything may take that is bound to happen; only a failure takes as long."""
COMPILE_S: Final = 300.0
"""How long it may take where something may have to be compiled first."""
_LOOK_S: Final = 5e-3


def until(
    done: Callable[[], T],
    what: str = "something",
    patience_s: float = PATIENCE_S,
    *,
    meanwhile: Callable[[], object] = lambda: None,
) -> T:
    """Return the first true value of a condition.

    Args:
        done: the condition.
        what: is waited for, in words.
        patience_s: how long it may take.
        meanwhile: is called between two looks.

    Raises:
        AssertionError: it did not become true in time.
    """
    end = time.monotonic() + patience_s
    while not (found := done()):
        assert time.monotonic() < end, f"waited {patience_s:g} s in vain for {what}"
        meanwhile()
        time.sleep(_LOOK_S)
    return found
