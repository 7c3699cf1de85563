"""Asking a run to end: by a signal, from another thread, or because nobody is reading any more."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

SIGNALS: Final = tuple(
    getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name)
)


class StopFlag:
    """Asks a run to end after its present batch.

    A plain attribute and no lock: a signal handler runs between any two steps of the thread it
    interrupts, which may hold the very lock it would wait for.
    """

    def __init__(self) -> None:
        self._reason = ""

    def request(self, reason: str) -> None:
        """Ask the run to end; the first reason given is kept."""
        self._reason = self._reason or reason

    @property
    def requested(self) -> bool:
        """Whether the run shall end."""
        return bool(self._reason)

    @property
    def reason(self) -> str:
        """Why the run shall end; empty if it shall not."""
        return self._reason


@contextmanager
def stop_on_signals(stop: StopFlag) -> Iterator[None]:
    """Let SIGINT (Ctrl-C), SIGTERM and SIGHUP set the flag instead of killing, however often.

    Signals that are ignored (nohup, a job in the background) stay so. Main thread only.
    """

    def request(number: int, _: FrameType | None) -> None:
        stop.request(signal.Signals(number).name)

    previous = {number: signal.getsignal(number) for number in SIGNALS}
    caught = [number for number in SIGNALS if previous[number] is not signal.SIG_IGN]
    try:
        for number in caught:
            signal.signal(number, request)
        yield
    finally:
        for number in caught:
            signal.signal(number, previous[number])
