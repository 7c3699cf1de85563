"""Notices when the host let this process wait, so that a late device is not blamed for it."""

import threading
import time
from types import TracebackType
from typing import Final, Self

_SLEEP_S: Final = 0.005
_LATE_NS: Final = 30_000_000
"""A sleep that ends later than this is a pause of the host: the loop itself is late by less."""


class HostPauses:
    """Watches in a thread how late its short sleeps end, as a context manager.

    Attributes:
        found: begin and end of each pause, CLOCK_MONOTONIC in ns.
    """

    def __init__(self) -> None:
        self.found: list[tuple[int, int]] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="pauses", daemon=True)

    def __enter__(self) -> Self:
        """Begin to watch."""
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End to watch."""
        self._done.set()
        self._thread.join()

    def _watch(self) -> None:
        last_ns = time.monotonic_ns()
        while not self._done.wait(_SLEEP_S):
            now_ns = time.monotonic_ns()
            if now_ns - last_ns > _LATE_NS:
                self.found.append((last_ns, now_ns))
            last_ns = now_ns


def paused_ns(pauses: list[tuple[int, int]], begin_ns: int, end_ns: int) -> int:
    """Return for how long (ns) the host paused between two moments, CLOCK_MONOTONIC."""
    return sum(max(min(end, end_ns) - max(begin, begin_ns), 0) for begin, end in pauses)
