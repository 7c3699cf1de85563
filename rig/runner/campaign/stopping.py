"""Lets a signal, another thread or the loss of the output ask a run to end."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Final

from rig.control_socket import interrupted_by

SIGNALS: Final = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
_UNNAMED: Final = "somebody without a name"
"""Reason for a stop that was asked for without one."""


class _Interruption(BaseException):
    """Raised by a signal in a block that `StopFlag.interruptible` lets it end.

    It is no `Exception`, as a library may take those for failures of its own, and go on.
    """


class StopFlag:
    """A flag that asks a run to end after its present batch.

    It is a plain attribute without a lock: a signal handler interrupts a thread between any two
    steps, and would wait for ever for a lock that this very thread has.

    Attributes:
        reason: why the run has been asked to end; empty if it has not.
    """

    def __init__(self) -> None:
        self.reason = ""
        self._interrupts = False

    def request(self, reason: str) -> None:
        """Ask the run to end; the first reason stays.

        An empty reason, as of an operator whose name is empty, becomes "somebody without a name".
        """
        self.reason = self.reason or reason or _UNNAMED

    @property
    def requested(self) -> bool:
        """Whether the run has been asked to end."""
        return bool(self.reason)

    @contextmanager
    def interruptible(self) -> Iterator[None]:
        """Let a signal that asks for the end also end the block, which is left without an error.

        It is for what takes long without a look at the flag and leaves nothing to be tidied up,
        such as loading compiled code. Only the main thread may call it.
        """
        try:
            self._interrupts = True
            yield
            self._interrupts = False
        except _Interruption:
            pass
        except BaseException:
            self._interrupts = False
            raise

    def interrupt(self) -> None:
        """End the block of `interruptible` that the main thread is in; signal handlers call this.

        Without such a block nothing happens.
        """
        if self._interrupts:
            self._interrupts = False
            raise _Interruption


@contextmanager
def stop_on_signals(stop: StopFlag, folder: Path | None = None) -> Iterator[None]:
    """Let SIGINT (Ctrl-C), SIGTERM and SIGHUP set a flag instead of ending the process.

    This holds while the context is entered, however often a signal comes. Signals that the process
    ignores already (nohup, a job in the background) stay ignored. Only the main thread may call it.

    Args:
        stop: the flag.
        folder: folder of a run, in which a console notes who interrupts it by a signal.
    """

    def request(number: int, _: FrameType | None) -> None:
        name, is_first = signal.Signals(number).name, not stop.requested
        # The stop is asked for before any file is read, as a disk may hang.
        stop.request(name)
        if is_first and folder and (who := interrupted_by(folder)):
            stop.reason = f"{who} ({name})"
        stop.interrupt()

    previous = {number: signal.getsignal(number) for number in SIGNALS}
    caught = [number for number in SIGNALS if previous[number] is not signal.SIG_IGN]
    try:
        for number in caught:
            signal.signal(number, request)
        yield
    finally:
        for number in caught:
            signal.signal(number, previous[number])
