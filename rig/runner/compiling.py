"""What a session runs, compiled before it begins, in processes side by side.

The compiler keeps the interpreter's lock for seconds. A supervisor that compiled while its rig is
armed would fall silent, and the rig would trip; a loop would miss its ticks. So the rule is: in no
process of a session is anything compiled, or loaded from the cache, between arming and the end.
`compile_for` stands before every session. What is new in a session has its place in a piece here.

A piece runs what a session runs, on next to nothing. Pieces of a strand are compiled one after the
other, as the later ones contain the earlier; strands are compiled side by side. A piece that has
been compiled leaves a mark in the cache, beside what numba keeps there.
"""

import fcntl
import gc
import os
import pickle
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from typing import Final

from rig.compile_cache import marks_folder

from .compiled_pieces import PIECES, Needs
from .stopping import StopFlag

Tell = Callable[[str], None]
Strands = tuple[tuple[str, ...], ...]

SIMULATED: Final[Strands] = (("plant", "simulated loop"), ("filter", "detector"))
"""Of a campaign on a simulated rig."""
ON_HARDWARE: Final[Strands] = (("filter", "loop"), ("detector", "decisions"))
"""Of a campaign on hardware."""
WITHOUT_TESTS: Final[Strands] = (("filter", "loop"),)
"""Of a session on hardware that moves the ram and judges nothing."""
OF_THE_LOOP: Final = ("loop",)
"""What the loop process of a session loads itself, before it answers that it is ready."""

_LOOK_S: Final = 0.05
_LOCK: Final = "lock"


def compile_for(needs: Needs, strands: Strands, tell: Tell, stop: StopFlag) -> None:
    """Compile what a session runs, unless that is done, and tell how far it is.

    It returns early, with less, if a stop is requested. A strand that fails is told of, and left to
    whoever runs it first.

    Args:
        needs: what decides how it is compiled.
        strands: pieces by name.
        tell: shows a line to the operator.
        stop: whether somebody asked for an end.
    """
    marks = marks_folder()
    if marks is None or not _missing(marks, needs, strands):
        return
    with _alone(marks / _LOCK, tell, stop):
        missing = _missing(marks, needs, strands)
        if missing and not stop.requested:
            _compile(marks, needs, missing, tell, stop)


def load(needs: Needs, strands: Strands) -> None:
    """Load into this process what it runs in a session, without what the loop process loads."""
    for name in chain.from_iterable(strands):
        if name not in OF_THE_LOOP:
            PIECES[name](needs)


def _mark(marks: Path, needs: Needs, name: str) -> Path:
    return marks / f"{name.replace(' ', '_')}-{needs.kind}"


def _missing(marks: Path, needs: Needs, strands: Strands) -> Strands:
    """Return the strands less the pieces that are compiled."""
    left = (
        tuple(name for name in strand if not _mark(marks, needs, name).exists())
        for strand in strands
    )
    return tuple(strand for strand in left if strand)


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


def _compile(marks: Path, needs: Needs, strands: Strands, tell: Tell, stop: StopFlag) -> None:
    """Compile strands in processes of their own, as many at once as there are processors."""
    names = list(chain.from_iterable(strands))
    tell(f"compiling for this machine, once for each version of the program: {', '.join(names)}")
    waiting, running = list(strands), list[_Strand]()
    done = set[str]()
    try:
        while (waiting or running) and not stop.requested:
            if waiting and len(running) < len(os.sched_getaffinity(0)):
                running.append(_Strand(needs, waiting.pop(0)))
            time.sleep(_LOOK_S)
            ended = [strand for strand in running if strand.has_ended]
            for name in names:
                if name not in done and _mark(marks, needs, name).exists():
                    done.add(name)
                    tell(f"compiled the {name}, {len(done)} of {len(names)}")
            for strand in ended:
                running.remove(strand)
                failure = strand.failure()
                if failure:
                    tell(f"compiling the {' and the '.join(strand.names)} failed: {failure}")
    finally:
        for strand in running:
            strand.end()


class _Strand:
    """A process that compiles one strand, in a session of its own: Ctrl-C is for its parent."""

    def __init__(self, needs: Needs, names: Sequence[str]) -> None:
        self.names = names
        program = f"from {__name__} import main; main()"
        self._process = subprocess.Popen(
            [sys.executable, "-P", "-c", program, *names],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
            env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
        )
        assert self._process.stdin is not None
        with self._process.stdin as pipe:
            pipe.write(pickle.dumps(needs))
        self._process.stdin = None

    @property
    def has_ended(self) -> bool:
        return self._process.poll() is not None

    def failure(self) -> str:
        """Return what it said last, if it failed, and empty otherwise; once it has ended."""
        lines = self._process.communicate()[1].decode(errors="replace").strip().splitlines()
        if self._process.returncode == 0:
            return ""
        return lines[-1] if lines else f"ended with {self._process.returncode}"

    def end(self) -> None:
        self._process.kill()
        self._process.communicate()


def main() -> None:
    """Compile the pieces on the command line, by the needs on the standard input."""
    needs: Needs = pickle.load(sys.stdin.buffer)
    marks = marks_folder()
    # The compiler makes millions of small objects that live as long as this process: to look for
    # garbage among them takes a sixth of the time, and finds none.
    gc.disable()
    for name in sys.argv[1:]:
        PIECES[name](needs)
        if marks is not None:
            _mark(marks, needs, name).touch()
