"""What a session runs, compiled before it begins, in processes side by side.

The compiler keeps the interpreter's lock for seconds. A supervisor that compiled while its rig is
armed would fall silent, and the rig would trip; a loop would miss its ticks. So the rule is: in no
process of a session is anything compiled, or loaded from the cache, between arming and the end.
`compile_for` stands before every session. What is new in a session has its place in a piece here.

A piece runs what a session runs, on next to nothing, or has it compiled without a run. Processes
take pieces one after the other, each piece as soon as those are compiled that it contains. A piece
that has been compiled leaves a mark in the cache, beside what numba keeps there.
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
from typing import Final

from rig.compile_cache import marks_folder

from .compiled_pieces import PIECES, Needs
from .stopping import StopFlag

Say = Callable[[str], None]
Names = tuple[str, ...]

SIMULATED: Final[Names] = (
    "estimates", "plant", "interlock", "simulated loop", "detector", "filter",
)  # fmt: skip
"""Pieces of a campaign on a simulated rig; of those that could be compiled next, the first one
is."""
ON_HARDWARE: Final[Names] = ("filter", "detector", "loop", "decisions")
"""Pieces of a campaign on hardware."""
WITHOUT_TESTS: Final[Names] = ("filter", "loop")
"""Pieces of a session on hardware that moves the ram and judges nothing."""
OF_THE_LOOP: Final = ("loop",)
"""What the loop process of a session loads itself, before it answers that it is ready."""

_LOOK_S: Final = 0.05
_LOCK: Final = "lock"
_FORK: Final = multiprocessing.get_context("fork")


def compile_for(needs: Needs, names: Names, say: Say, stop: StopFlag) -> None:
    """Compile what a session runs, unless that is done, and report how far it is.

    It returns early, with less, if a stop is requested. A piece that fails is reported, and is
    compiled by whoever runs it first.

    Args:
        needs: what decides how it is compiled.
        names: of the pieces.
        say: shows a line to the operator.
        stop: whether somebody asked for an end.
    """
    marks = marks_folder()
    if marks is None or not _missing(marks, needs, names):
        return
    with _alone(marks / _LOCK, say, stop):
        missing = _missing(marks, needs, names)
        if missing and not stop.requested:
            _compile(marks, needs, missing, say, stop)


def load(needs: Needs, names: Names) -> None:
    """Load into this process what it runs in a session, without what the loop process loads."""
    for name in names:
        if name not in OF_THE_LOOP:
            PIECES[name].run(needs)


def _mark(marks: Path, needs: Needs, name: str) -> Path:
    words = [name.replace(" ", "_"), needs.kind]
    if PIECES[name].exchanges:
        words.append(needs.fast.type)
    return marks / "-".join(words)


def _missing(marks: Path, needs: Needs, names: Names) -> Names:
    """Return the names of the pieces that are not compiled."""
    return tuple(name for name in names if not _mark(marks, needs, name).exists())


@contextmanager
def _alone(path: Path, say: Say, stop: StopFlag) -> Iterator[None]:
    """Wait until no other program compiles the same; where files cannot be locked, do not wait."""
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


def _compile(marks: Path, needs: Needs, names: Names, say: Say, stop: StopFlag) -> None:
    """Compile pieces in processes of their own, as many at once as there are processors."""
    say(f"compiling for this machine, once for each version of the program: {', '.join(names)}")
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
    """Return the first piece that waits for none of the others; empty if there is none."""
    unfinished = {*waiting, *running}
    ready = (name for name in waiting if unfinished.isdisjoint(PIECES[name].after))
    return next(ready, "")


class _Worker:
    """A process that compiles pieces, in a session of its own: Ctrl-C is for its parent.

    It is forked, so that it has loaded already what its parent has, the compiler above all.

    Attributes:
        piece: the name of what it compiles now; empty while it waits for work.
        replies: where it answers, and where its end is seen.
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
        """Have it compile a piece."""
        self.piece = piece
        # It may have ended; that is seen where it would have answered.
        with suppress(OSError):
            self.replies.send(piece)

    def failure(self) -> str | None:
        """Return why its piece was not compiled; empty if it was, None while that is open."""
        try:
            return str(self.replies.recv()) if self.replies.poll() else None
        except (EOFError, OSError):
            self._process.join()
            return f"its process ended with {self._process.exitcode}"

    def end(self) -> None:
        """End it, whatever it does."""
        self._process.kill()
        self._process.join()
        self._process.close()
        self.replies.close()


def _compile_what_is_asked(needs: Needs, orders: Connection, others_end: Connection) -> None:
    """Compile the pieces that are named, and answer to each name what went wrong, until the end."""
    others_end.close()
    os.setsid()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_DFL)
    silent = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(silent, stream)
    # The compiler makes millions of small objects that live as long as this process: to look for
    # garbage among them takes a sixth of the time, and finds none.
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
