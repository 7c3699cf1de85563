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
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final

from rig.compile_cache import marks_folder

from .compiled_pieces import PIECES, Needs
from .stopping import StopFlag

Tell = Callable[[str], None]
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


def compile_for(needs: Needs, names: Names, tell: Tell, stop: StopFlag) -> None:
    """Compile what a session runs, unless that is done, and tell how far it is.

    It returns early, with less, if a stop is requested. A piece that fails is told of, and left to
    whoever runs it first.

    Args:
        needs: what decides how it is compiled.
        names: of the pieces.
        tell: shows a line to the operator.
        stop: whether somebody asked for an end.
    """
    marks = marks_folder()
    if marks is None or not _missing(marks, needs, names):
        return
    with _alone(marks / _LOCK, tell, stop):
        missing = _missing(marks, needs, names)
        if missing and not stop.requested:
            _compile(marks, needs, missing, tell, stop)


def load(needs: Needs, names: Names) -> None:
    """Load into this process what it runs in a session, without what the loop process loads."""
    for name in names:
        if name not in OF_THE_LOOP:
            PIECES[name].run(needs)


def _mark(marks: Path, needs: Needs, name: str) -> Path:
    return marks / f"{name.replace(' ', '_')}-{needs.kind}"


def _missing(marks: Path, needs: Needs, names: Names) -> Names:
    """Return the names of the pieces that are not compiled."""
    return tuple(name for name in names if not _mark(marks, needs, name).exists())


@contextmanager
def _alone(path: Path, tell: Tell, stop: StopFlag) -> Iterator[None]:
    """Wait until no other program compiles the same; where files cannot be locked, do not wait."""
    with path.open("w") as file:
        told = False
        while not stop.requested:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                if not told:
                    tell("waiting for another program that compiles the same")
                told = True
                time.sleep(_LOOK_S)
            except OSError:
                break
        yield


def _compile(marks: Path, needs: Needs, names: Names, tell: Tell, stop: StopFlag) -> None:
    """Compile pieces in processes of their own, as many at once as there are processors."""
    tell(f"compiling for this machine, once for each version of the program: {', '.join(names)}")
    waiting, compiled = list(names), 0
    workers = [_Worker(needs) for _ in range(min(len(names), len(os.sched_getaffinity(0))))]
    try:
        while (waiting or any(worker.piece for worker in workers)) and not stop.requested:
            for number, worker in enumerate(workers):
                if not worker.piece:
                    name = _next(waiting, [other.piece for other in workers])
                    if name:
                        waiting.remove(name)
                        worker.begin(name)
                elif _mark(marks, needs, worker.piece).exists():
                    compiled += 1
                    tell(f"compiled the {worker.piece}, {compiled} of {len(names)}")
                    worker.piece = ""
                elif worker.has_ended:
                    tell(f"compiling the {worker.piece} failed: {worker.failure()}")
                    workers[number] = _Worker(needs)
            time.sleep(_LOOK_S)
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

    Attributes:
        piece: the name of what it compiles now; empty while it waits for work.
    """

    def __init__(self, needs: Needs) -> None:
        self.piece = ""
        program = f"from {__name__} import main; main()"
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", program],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        )
        self._send(pickle.dumps(needs))

    def begin(self, piece: str) -> None:
        """Have it compile a piece."""
        self.piece = piece
        self._send(f"{piece}\n".encode())

    def _send(self, data: bytes) -> None:
        assert self._process.stdin is not None
        # It may have ended; that is seen, and told, by who looks at it.
        with suppress(OSError):
            self._process.stdin.write(data)
            self._process.stdin.flush()

    @property
    def has_ended(self) -> bool:
        return self._process.poll() is not None

    def failure(self) -> str:
        """Return what it said last, once it has ended."""
        lines = self._output().decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else f"ended with {self._process.returncode}"

    def end(self) -> None:
        """End it, whatever it does."""
        self._process.kill()
        self._output()

    def _output(self) -> bytes:
        pipe, self._process.stdin = self._process.stdin, None
        with suppress(OSError):
            if pipe is not None:
                pipe.close()
        return self._process.communicate()[1]


def main() -> None:
    """Compile by the needs on the standard input the pieces that are named there, until it ends."""
    needs: Needs = pickle.load(sys.stdin.buffer)
    marks = marks_folder()
    # The compiler makes millions of small objects that live as long as this process: to look for
    # garbage among them takes a sixth of the time, and finds none.
    gc.disable()
    for line in sys.stdin.buffer:
        name = line.decode().strip()
        PIECES[name].run(needs)
        if marks is not None:
            _mark(marks, needs, name).touch()
