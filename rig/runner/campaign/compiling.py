"""Compiles all code that a session runs before the session begins, in parallel processes.

The compiler holds the interpreter's lock for seconds. A supervisor that compiled while its rig is
armed would stop beating, and the rig would trip; a loop would miss its ticks. So the rule is: no
process of a session compiles anything, or loads it from the cache, between arming and the end.
`compile_for` is called before every session. New code of a session must be added to a piece.

A piece runs a part of a session's code on tiny inputs, or compiles it without running it. Each
process compiles one piece at a time, and begins a piece only when all pieces that it contains are
compiled. For each compiled piece an empty file, its mark, is put beside numba's cache.
"""

import fcntl
import gc
import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from multiprocessing import Pipe
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Final, Protocol

from rig.compile_cache import COMPILED_ONCE, marks_folder

from .compiled_pieces import LOOP, PIECES, Needs
from .stopping import StopFlag

Say = Callable[[str], None]
Names = tuple[str, ...]


class Stop(Protocol):
    """A flag by which compiling is ended; see `rig.runner.campaign.stopping.StopFlag`."""

    @property
    def requested(self) -> bool:
        """Whether somebody asked for the end."""


SIMULATED: Final[Names] = (
    "estimates", "plant", "interlock", "reaction", "change of control", "simulated loop",
    "detector", "filter",
)  # fmt: skip
"""Pieces of a campaign on a simulated rig; of those that can be compiled next, a worker takes the
first in this order."""
ON_HARDWARE: Final[Names] = (
    "filter", "detector", "change of control", LOOP, "decisions", "expected position",
)  # fmt: skip
"""Pieces of a campaign on hardware. A simulated rig waits while its code is compiled, so that there
the expected position may be compiled when a test first needs it."""
WITHOUT_TESTS: Final[Names] = ("filter", "change of control", LOOP)
"""Pieces of a session on hardware that moves the ram without any test."""

_LOOK_S: Final = 0.05
_LOCK: Final = "lock"
_FORK: Final = multiprocessing.get_context("fork")


def compile_for(needs: Needs, names: Names, say: Say, stop: Stop) -> None:
    """Compile the pieces that are not compiled yet, and report the progress to the operator.

    The function returns when all are compiled, or earlier if a stop is requested. While another
    program compiles for this machine, it waits before it begins. If a piece cannot be compiled,
    that is reported; its code is then compiled when a process first runs it. Without a folder for
    compiled code nothing is done.

    Args:
        needs: rig and filter, on which the compiled code depends.
        names: names of the pieces, as in `PIECES`.
        say: shows a line to the operator.
        stop: once a stop is requested on it, compiling ends.
    """
    marks = marks_folder()
    if marks is None or is_compiled(needs, names):
        return
    with _alone(marks / _LOCK, say, stop):
        missing = _missing(marks, needs, names)
        if missing and not stop.requested:
            _compile(marks, needs, missing, say, stop)


def is_compiled(needs: Needs, names: Names) -> bool:
    """Return whether `compile_for` has nothing to do."""
    marks = marks_folder()
    return marks is None or not _missing(marks, needs, names)


def load(needs: Needs, names: Names, stop: StopFlag) -> None:
    """Load the compiled pieces into this process, except the one that the loop process loads.

    A piece that was not compiled before is compiled now. The function returns earlier if a stop is
    requested; by a signal at once, as on a busy machine one piece may take a minute.
    """
    with stop.interruptible():
        for name in names:
            if name != LOOP and not stop.requested:
                PIECES[name].run(needs)


def _mark(marks: Path, needs: Needs, name: str) -> Path:
    exchanged = (needs.fast.type,) if name == LOOP else ()
    return marks / "-".join((name.replace(" ", "_"), needs.filter_name, *exchanged))


def _missing(marks: Path, needs: Needs, names: Names) -> Names:
    """Return the names of those pieces that are not compiled yet."""
    return tuple(name for name in names if not _mark(marks, needs, name).exists())


@contextmanager
def _alone(path: Path, say: Say, stop: Stop) -> Iterator[None]:
    """Lock a file while the context is entered, and wait for another program that has locked it.

    The context is entered without a lock if a stop is requested or if files cannot be locked.
    """
    with path.open("w") as file:
        has_said = False
        while not stop.requested:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if not has_said:
                    say("waiting for another program that compiles the same")
                has_said = True
                time.sleep(_LOOK_S)
            except OSError:
                break
        yield


def _compile(marks: Path, needs: Needs, names: Names, say: Say, stop: Stop) -> None:
    """Compile pieces in processes of their own, with at most one process per processor.

    Each compiled piece gets its mark. If a stop is requested, the processes are killed.
    """
    say(f"compiling for this machine, {COMPILED_ONCE}: {', '.join(names)}")
    waiting, compiled = list(names), 0
    workers = [_Worker(needs) for _ in range(min(len(names), len(os.sched_getaffinity(0))))]
    try:
        while (waiting or any(worker.piece for worker in workers)) and not stop.requested:
            for number, worker in enumerate(workers):
                if worker.piece and (failure := worker.failure()) is not None:
                    if failure:
                        say(f"compiling the {worker.piece} failed: {failure}")
                        worker.end()
                        worker = workers[number] = _Worker(needs)
                    else:
                        compiled += 1
                        _mark(marks, needs, worker.piece).touch()
                        say(f"compiled the {worker.piece}, {compiled} of {len(names)}")
                        worker.piece = ""
                if not worker.piece and (name := _next(waiting, [each.piece for each in workers])):
                    waiting.remove(name)
                    worker.begin(name)
            wait([worker.replies for worker in workers], _LOOK_S)
    finally:
        for worker in workers:
            worker.end()


def _next(waiting: Sequence[str], running: Sequence[str]) -> str:
    """Return the first waiting piece that can be compiled now; empty if there is none.

    A piece can be compiled once none of the pieces that it contains is waiting or running.
    """
    unfinished = {*waiting, *running}
    ready = (name for name in waiting if unfinished.isdisjoint(PIECES[name].after))
    return next(ready, "")


class _Worker:
    """A process that compiles one piece after the other.

    It runs in a session of its own, so that Ctrl-C reaches its parent only. It is forked, so that
    it need not load the compiler again.

    Attributes:
        piece: name of the piece that it compiles now; empty while it waits for work.
        replies: this side of the pipe to the process, which is also readable when the process ends.
    """

    def __init__(self, needs: Needs) -> None:
        self.piece = ""
        self.replies, theirs = Pipe()
        self._process = _FORK.Process(
            target=_compile_what_is_asked, args=(needs, theirs, self.replies), daemon=True
        )
        self._process.start()
        theirs.close()

    def begin(self, piece: str) -> None:
        """Let the process compile a piece, without waiting for it."""
        self.piece = piece
        # The process may have ended; then `failure` notices that.
        with suppress(OSError):
            self.replies.send(piece)

    def failure(self) -> str | None:
        """Return why compiling the piece failed; empty if it succeeded, None while it goes on.

        The answer of the process is taken from the pipe, so that it is returned only once.
        """
        try:
            return str(self.replies.recv()) if self.replies.poll() else None
        except (EOFError, OSError):
            self._process.join()
            return f"its process ended with {self._process.exitcode}"

    def end(self) -> None:
        """Kill the process, whatever it is doing, and close the pipe."""
        self._process.kill()
        self._process.join()
        self._process.close()
        self.replies.close()


def _compile_what_is_asked(needs: Needs, orders: Connection, others_end: Connection) -> None:
    """Compile each piece whose name is received, and answer why it failed, or with an empty text.

    This is the main function of a worker process; it returns when the parent closes the pipe.

    Args:
        needs: rig and filter of the session.
        orders: this process's side of the pipe.
        others_end: the parent's side of the pipe, which is closed here.
    """
    others_end.close()
    os.setsid()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    silent = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(silent, stream)
    # The compiler makes millions of small objects that live as long as this process: searching
    # them for garbage takes a sixth of the time, and finds none.
    gc.disable()
    with suppress(EOFError, OSError):
        while True:
            name = orders.recv()
            try:
                PIECES[name].run(needs)
            except Exception as error:
                orders.send(f"{type(error).__name__}: {error}".splitlines()[0])
            else:
                orders.send("")
