"""A part of the session in a process of its own, and the pipe to it.

Orders and answers are Python objects over `multiprocessing.Pipe`, between processes of this program
only. A child is in a session (setsid) of its own: Ctrl-C at the terminal reaches the supervisor
alone, which ends it in order.
"""

import contextlib
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

from rig.loop import Board, TripError
from rig.surviving import Surviving, failure

_GRACE_S: Final = 10.0
"""How long a child may take to end by itself before it is killed."""


class ChildError(TripError):
    """A child that ended, or does not answer; the message names it.

    To whoever it stops the rig has tripped: the safety thread sees the same, and makes it safe.
    """


@dataclass(frozen=True)
class News:
    """What a child reports without being asked.

    Attributes:
        at_ns: when it happened, CLOCK_MONOTONIC in ns.
        who: which part of the rig.
        text: what happened.
    """

    at_ns: int
    who: str
    text: str


class Child:
    """A process of the session.

    Args:
        name: what messages call it.
        module: its module, whose `main()` finds board and pipe by `child_ends`.
        board: shared with it.
        log: file that its stderr is appended to, and what fails in `on_news`.
        on_news: is called with its `News`, in a thread of its own.
    """

    def __init__(
        self,
        name: str,
        module: str,
        board: Board,
        log: Path,
        on_news: Callable[[News], None] = lambda news: None,
    ) -> None:
        self.name = name
        self._pipe, theirs = Pipe()
        self._on_news = on_news
        self._log = log
        self._survives = Surviving(f"hearing the {name} process", self._note_failure)
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
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
        self._reader = threading.Thread(target=self._read, name=f"from {name}", daemon=True)
        self._reader.start()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Its exit code, minus the signal that killed it, or None while it runs."""
        return self._process.poll()

    @property
    def ended(self) -> str:
        """How it ended, in words; empty while it runs."""
        code = self.exit_code
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
            self._pipe.send(order)
        except OSError:
            raise self._gone() from None

    def answer(self, timeout_s: float) -> Any:
        """Return its next answer; an answer that is an exception is raised.

        Raises:
            ChildError: none came in time, or it has ended.
        """
        try:
            answer = self._answers.get(timeout=timeout_s)
        except queue.Empty:
            state = f"did not answer within {timeout_s:g} s"
            raise ChildError(f"{self.name} process: {state}") from None
        if answer is _CLOSED:
            self._answers.put(_CLOSED)
            raise self._gone()
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def ask(self, order: object, timeout_s: float) -> Any:
        """Send an order and return the answer; see `send` and `answer`."""
        self.send(order)
        return self.answer(timeout_s)

    def end(self) -> None:
        """Close the pipe, upon which it leaves its part of the rig safe and ends; else kill it."""
        # A reader blocked in a pipe does not see it closed: half of it is shut down first.
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(self._pipe.fileno())) as end:
            end.shutdown(socket.SHUT_RDWR)
        try:
            self._process.wait(_GRACE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        self._pipe.close()

    def _read(self) -> None:
        """Take what it sends until its pipe is closed, whatever fails of a message."""
        while True:
            try:
                message = self._pipe.recv()
            except (EOFError, OSError):
                self._answers.put(_CLOSED)
                return
            except Exception as error:
                # It may have been an answer: whoever waits for one learns why there is none.
                why = f"sent what cannot be read: {failure(error)}"
                self._answers.put(ChildError(f"{self.name} process: {why}"))
                continue
            if isinstance(message, News):
                with self._survives:
                    self._on_news(message)
            else:
                self._answers.put(message)

    def _note_failure(self, line: str) -> None:
        with self._log.open("a", encoding="utf-8", errors="replace") as log:
            log.write(f"{line}\n")

    def _gone(self) -> ChildError:
        # The pipe is closed a moment before the process can be asked how it ended.
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_GRACE_S)
        return ChildError(f"{self.name} process: {self.ended or 'closed its pipe'}")


_CLOSED: Final = object()


def child_ends() -> tuple[Board, Connection]:
    """Return board and pipe of the child that this process is, from its command line."""
    board_fd, pipe_fd = (int(argument) for argument in sys.argv[1:3])
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.set_inheritable(board_fd, False)
    os.set_inheritable(pipe_fd, False)
    return Board.attach(board_fd), Connection(pipe_fd)


def obeyed_next(pipe: Connection, wait_s: float, obey: Callable[[object], None]) -> bool:
    """Have the next order on a child's pipe obeyed, if one comes within `wait_s` seconds.

    Returns:
        False if the supervisor has closed its end of the pipe, else True.
    """
    try:
        if pipe.poll(wait_s):
            obey(pipe.recv())
    except (EOFError, ConnectionError):
        return False
    return True
