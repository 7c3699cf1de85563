"""A part of the session runs in a process of its own, a child, which has a pipe to the supervisor.

Orders and answers are Python objects over `multiprocessing.Pipe`, between processes of this program
only. A child has a process session (setsid) of its own, so that Ctrl-C at the terminal only reaches
the supervisor, which then ends the child in order.
"""

import contextlib
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final, TypeVar

from rig.loop import Board, TripError
from rig.plain_output import make_output_plain, shown_line
from rig.reserves import refusal
from rig.surviving import Surviving, failure, start

Last = TypeVar("Last")
"""Type of the answer to the last order."""

_GRACE_S: Final = 10.0
"""Time in s within which a child must end by itself; then it is killed."""


class ChildError(TripError):
    """Raised if a child has ended, or its answer does not come or cannot be read.

    The message names the child. It is a `TripError`, as the safety thread notices a dead or silent
    child too, and makes the rig safe.
    """


class NoAnswerError(ChildError):
    """The error of a child that has not answered yet; whoever has the time may wait on."""


@dataclass(frozen=True)
class News:
    """A report that a child sends without being asked.

    Attributes:
        at_ns: time of the event, CLOCK_MONOTONIC in ns.
        who: the part of the rig or of the software that it concerns.
        text: what happened.
    """

    at_ns: int
    who: str
    text: str


@dataclass(frozen=True)
class Compiling:
    """A report that a child begins to compile a function, or has compiled it.

    Attributes:
        what: full name of the function; empty once it is compiled.
    """

    what: str


class Child:
    """A process of the session, as the supervisor sees it; making the object starts the process.

    Args:
        name: name of the process in messages.
        module: module whose `main()` the process runs; that gets board and pipe by `child_ends`.
        board: memory that the process shares.
        log: file to which its stdout and stderr are appended, and also errors of `on_news`.
        on_news: is called with each `News` that the process sends, in a thread of its own.
        kept: further descriptors that stay open for as long as the process lives.

    Attributes:
        name: name of the process in messages.
        compiles: full name of the function that the process compiles now; empty if it does not.

    Raises:
        OSError: the system grants no further process, thread or file; no process is left then.
    """

    def __init__(
        self,
        name: str,
        module: str,
        board: Board,
        log: Path,
        on_news: Callable[[News], None],
        kept: Sequence[int] = (),
    ) -> None:
        self.name = name
        self.compiles = ""
        self._pipe, theirs = Pipe()
        self._on_news = on_news
        self._log = log
        self._survives = Surviving(f"hearing the {name} process", self._note_failure)
        self._answers: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._was_asked = False
        descriptors = (board.fd, theirs.fileno())
        # The module is imported rather than run as __main__, so that the classes of its orders are
        # the same as the sender's.
        program = f"from {module} import main; main()"
        with log.open("ab") as stderr, theirs:
            self._process = subprocess.Popen(
                [sys.executable, "-P", "-c", program, *(str(fd) for fd in descriptors)],
                pass_fds=(*descriptors, *kept),
                stdin=subprocess.DEVNULL,
                stdout=stderr,
                stderr=stderr,
                start_new_session=True,
            )
        self._reader = threading.Thread(target=self._read, name=f"from {name}", daemon=True)
        try:
            start(self._reader)
        except OSError:
            self._process.kill()
            self._process.wait()
            self._pipe.close()
            raise

    @property
    def exit_code(self) -> int | None:
        """The exit code; -n if signal n killed the process; None while it runs."""
        return self._process.poll()

    @property
    def ended(self) -> str:
        """A text on how the process ended; empty while it runs."""
        code = self.exit_code
        if code is None:
            return ""
        if code < 0:
            return f"killed by {signal.Signals(-code).name}"
        return f"ended with exit code {code}"

    def send(self, order: object) -> None:
        """Send an order to the process.

        Raises:
            ChildError: the process has ended or closed its pipe.
        """
        self._was_asked = True
        try:
            self._pipe.send(order)
        except OSError:
            raise self._gone() from None

    def answer(self, timeout_s: float) -> Any:
        """Wait for the next answer of the process and return it; if it is an exception, raise it.

        Raises:
            NoAnswerError: no answer came within `timeout_s`.
            ChildError: the answer cannot be read, or the process has ended or closed its pipe.
        """
        try:
            answer = self._answers.get(timeout=timeout_s)
        except queue.Empty:
            raise self._unanswered(timeout_s) from None
        if answer is _CLOSED:
            self._answers.put(_CLOSED)
            raise self._gone()
        if isinstance(answer, BaseException):
            raise answer
        return answer

    def _unanswered(self, timeout_s: float) -> NoAnswerError:
        return NoAnswerError(f"{self.name} process: did not answer within {timeout_s:g} s")

    def ask(self, order: object, timeout_s: float) -> Any:
        """Send an order, wait up to `timeout_s` for the next answer, and return it.

        Raises:
            ChildError: the process has ended, did not answer in time, or its answer cannot be read.
                An answer that is an exception is raised too.
        """
        self.send(order)
        return self._to_this(self.answer(timeout_s))

    def ask_patiently(
        self, order: object, timeout_s: float, look_s: float, look: Callable[[], None]
    ) -> Any:
        """Send an order, and wait up to `timeout_s` for its answer while the process lives.

        Args:
            order: the order.
            timeout_s: longest time in s for which the answer is awaited. It begins anew when the
                process has compiled a function: how long that takes is the machine's matter.
            look_s: time in s after which `look` is called, again and again, while it is awaited.
            look: what is called then; it may raise an error, which ends the waiting.

        Returns:
            The answer.

        Raises:
            ChildError: the process has ended, did not answer in time, or its answer cannot be read.
                An answer that is an exception is raised too.
        """
        self.send(order)
        until = time.monotonic() + timeout_s
        while True:
            try:
                return self._to_this(self.answer(look_s))
            except NoAnswerError:
                if self.ended:
                    raise
                if self.compiles:
                    until = time.monotonic() + timeout_s
                elif time.monotonic() > until:
                    raise self._unanswered(timeout_s) from None
            look()

    def _to_this(self, answer: Any) -> Any:
        """Return the answer to an order.

        Raises:
            ChildError: it is the loop's last word, as it ends by itself, such as after an answer
                that the system refused to send.
        """
        # The children import this module too, and some of them need no loop and no compiler.
        from rig.loop import Closed

        if isinstance(answer, Closed):
            raise self._gone()
        return answer

    def last_answer(self, order: object, kind: type[Last], timeout_s: float) -> Last:
        """Send the final order to the process, wait for its answer of type `kind`, and return it.

        Answers of other types that come first are late answers to earlier orders, for which nobody
        waits any more. They are dropped, also those that are exceptions.

        Args:
            order: the order after which no other one is sent.
            kind: the type of the answer to it; no answer to an earlier order is of this type.
            timeout_s: longest time in s for the whole wait.

        Raises:
            ChildError: the process has ended, the answer did not come in time, or some message of
                the process, even a late one, cannot be read.
        """
        self.send(order)
        until = time.monotonic() + timeout_s
        while True:
            try:
                answer = self.answer(max(until - time.monotonic(), 0.0))
            except ChildError:
                raise
            except Exception:
                continue
            if isinstance(answer, kind):
                return answer

    def end(self, grace_s: float = _GRACE_S) -> None:
        """Close the pipe, and wait until the process has ended; kill it after `grace_s` seconds.

        A process whose pipe is closed brings its part of the rig to the safe state and ends itself.
        One that was never sent an order has no device yet, and may take long to begin on a busy
        machine, so that it is killed at once.
        """
        if not self._was_asked:
            self._process.kill()
        # A thread that is blocked in reading the pipe does not notice `close`, so shut it down.
        with contextlib.suppress(OSError), socket.socket(fileno=os.dup(self._pipe.fileno())) as end:
            end.shutdown(socket.SHUT_RDWR)
        try:
            self._process.wait(grace_s)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()
        self._reader.join()
        self._pipe.close()

    def _read(self) -> None:
        """Receive messages until the pipe is closed; sort them into reports and answers.

        A message that cannot be read becomes an answer, a `ChildError`.
        """
        while True:
            try:
                message = self._pipe.recv()
            except (EOFError, OSError):
                self._answers.put(_CLOSED)
                return
            except Exception as error:
                # It may have been an answer, so a caller that waits for one gets this error.
                why = f"sent what cannot be read: {failure(error)}"
                self._answers.put(ChildError(f"{self.name} process: {why}"))
                continue
            if isinstance(message, Compiling):
                self.compiles = message.what
            elif isinstance(message, News):
                with self._survives:
                    self._on_news(message)
            else:
                self._answers.put(message)

    def _note_failure(self, line: str) -> None:
        with self._log.open("a", encoding="utf-8", errors="replace") as log:
            log.write(f"{shown_line(line)}\n")

    def _gone(self) -> ChildError:
        # The pipe closes a moment before the exit code is known.
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(_GRACE_S)
        return ChildError(f"{self.name} process: {self.ended or 'closed its pipe'}")


_CLOSED: Final = object()


def child_ends() -> tuple[Board, Connection]:
    """Return the board and the pipe of this process, a child, from its command line's descriptors.

    From then on the process ignores SIGINT (Ctrl-C), and what it prints is plain.
    """
    make_output_plain()
    board_fd, pipe_fd = (int(argument) for argument in sys.argv[1:3])
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    os.set_inheritable(board_fd, False)
    os.set_inheritable(pipe_fd, False)
    return Board.attach(board_fd), Connection(pipe_fd)


def run_to_end(name: str, run: Callable[[], None]) -> None:
    """Do the work of a child; if the system refuses something, say so in the log and end.

    The exit code is then the number of the system's error, and the log has no traceback.

    Args:
        name: name of the process.
        run: does the work, and leaves the part of the rig safe, also after an error.
    """
    try:
        run()
    except OSError as error:
        # If the disk is full, this line may fail too, which must not hide the first error.
        with contextlib.suppress(OSError):
            line = shown_line(f"{name}: {refusal(error)}")
            os.write(sys.stderr.fileno(), f"{line}\n".encode(errors="replace"))
        sys.exit(error.errno or 1)


def obeyed_next(pipe: Connection, wait_s: float, obey: Callable[[object], None]) -> bool:
    """Wait up to `wait_s` seconds for an order on a child's pipe, and call `obey` with it.

    Returns:
        False if the supervisor has closed its end of the pipe, else True, also if no order came.
    """
    try:
        if pipe.poll(wait_s):
            obey(pipe.recv())
    except (EOFError, ConnectionError):
        return False
    return True
