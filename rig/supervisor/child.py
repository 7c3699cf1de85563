"""A part of the session in a process of its own, and the pipe to it.

Orders and answers are Python objects over `multiprocessing.Pipe`, between processes of this program
only. A child is in a session (setsid) of its own: Ctrl-C at the terminal reaches the supervisor
alone, which ends it in order.
"""

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Callable
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

from rig.loop.board import Board

_GRACE_S: Final = 3.0
"""How long a child may take to end by itself before it is killed."""


class ChildError(Exception):
    """A child that ended, or does not answer; the message names it."""


class Child:
    """A process of the session.

    Args:
        name: what messages call it.
        module: its module, whose `main()` finds board and pipe by `child_ends`.
        board: shared with it.
        log: file that its stderr is appended to.
    """

    def __init__(self, name: str, module: str, board: Board, log: Path) -> None:
        self.name = name
        self.pipe, theirs = Pipe()
        descriptors = (board.fd, theirs.fileno())
        # Imported, not run as __main__: the classes of its orders are then those of the sender.
        program = f"from {module} import main; main()"
        with log.open("ab") as stderr, theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", program, *(str(fd) for fd in descriptors)],
                pass_fds=descriptors,
                stdin=subprocess.DEVNULL,
                stdout=stderr,
                stderr=stderr,
                start_new_session=True,
            )

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def ended(self) -> str:
        """How it ended, in words; empty while it runs."""
        code = self._process.poll()
        if code is None:
            return ""
        if code < 0:
            return f"killed by {signal.Signals(-code).name}"
        return f"ended with exit code {code}"

    def send(self, order: object) -> None:
        """Send an order.

        Raises:
            ChildError: it has ended.
        """
        try:
            self.pipe.send(order)
        except OSError:
            raise ChildError(f"{self.name} process: {self.ended or 'closed its pipe'}") from None

    def answer(self, timeout_s: float, goes_on: Callable[[], bool] = lambda: True) -> Any:
        """Return its next answer; an answer that is an exception is raised.

        Args:
            timeout_s: how long to wait at most.
            goes_on: asked now and then; the wait ends when it returns False.

        Raises:
            ChildError: none came in time, or it has ended.
        """
        waited = 0.0
        try:
            while not self.pipe.poll(_POLL_S):
                waited += _POLL_S
                if self.ended or waited >= timeout_s or not goes_on():
                    break
            if self.pipe.poll():
                answer = self.pipe.recv()
                if isinstance(answer, BaseException):
                    raise answer
                return answer
        except (EOFError, ConnectionError):
            # The pipe is closed a moment before the process can be asked how it ended.
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_GRACE_S)
        state = self.ended or f"did not answer within {timeout_s:g} s"
        raise ChildError(f"{self.name} process: {state}")

    def end(self) -> None:
        """Close the pipe, upon which it leaves its part of the rig safe and ends; else kill it."""
        self.pipe.close()
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_GRACE_S)
            return
        self._process.kill()
        self._process.wait()


_POLL_S: Final = 0.05


def child_ends() -> tuple[Board, Connection]:
    """Return board and pipe of the child that this process is, from its command line."""
    board_fd, pipe_fd = (int(argument) for argument in sys.argv[1:3])
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.set_inheritable(board_fd, False)
    os.set_inheritable(pipe_fd, False)
    return Board.attach(board_fd), Connection(pipe_fd)
