"""What is fuzzed: a reader of bytes, inputs to begin with, and the errors that it may raise."""

import resource
import time
import tracemalloc
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from tempfile import mkdtemp
from typing import Final

from rig.cli.application import is_bad_input
from rig.io import DriverError

SLOW_S: Final = 5.0
"""s of this process's time that reading one input may take at most."""
MOST_BYTES: Final = 500 << 20
"""Memory that reading one input may take at most."""


@dataclass(frozen=True)
class Target:
    """A reader that is fuzzed.

    Attributes:
        name: its name, and that of its folder in the corpus.
        read: reads an input. It may raise the errors of a bad input, and nothing else.
        seeds: returns valid inputs.
        most: most bytes of an input that is tried.
    """

    name: str
    read: Callable[[bytes], object]
    seeds: Callable[[], Sequence[bytes]]
    most: int = 16384


@dataclass(frozen=True)
class Find:
    """An input upon which a reader did what it must not.

    Attributes:
        what: type and text of the error, or that it was slow or took memory.
        place: file and line in the product where it was raised; empty if there is none.
    """

    what: str
    place: str

    def __str__(self) -> str:
        return f"{self.what} at {self.place}" if self.place else self.what


def tried(target: Target, data: bytes) -> Find | None:
    """Let a target read an input; return what it must not have done, None if all was well.

    Memory is that which Python knows of, and is measured only if `tracemalloc` traces it.
    """
    began = time.process_time()
    if tracemalloc.is_tracing():
        tracemalloc.reset_peak()
    try:
        target.read(data)
    except Exception as error:  # whatever is raised is judged
        if not is_expected(error):
            return Find(f"{type(error).__name__}: {error}"[:300], _place_of(error))
    taken_s = time.process_time() - began
    if taken_s > SLOW_S:
        return Find(f"took {taken_s:.1f} s", "")
    if tracemalloc.is_tracing() and tracemalloc.get_traced_memory()[1] > MOST_BYTES:
        return Find(f"took {tracemalloc.get_traced_memory()[1] >> 20} MiB", "")
    return None


def is_expected(error: Exception) -> bool:
    """Return whether an error is one of the product's own, upon which a command ends with 2."""
    return is_bad_input(error) or isinstance(error, DriverError)


def _place_of(error: Exception) -> str:
    place, trace = "", error.__traceback__
    while trace is not None:
        file = trace.tb_frame.f_code.co_filename
        if any(f"/{name}/" in file for name in ("rig", "estimator", "control", "faults")):
            place = f"{Path(file).name}:{trace.tb_lineno}"
        trace = trace.tb_next
    return place


@cache
def scratch() -> Path:
    """Return a folder of this process in the system's temporary folder, for inputs as files."""
    return Path(mkdtemp(prefix="rig-fuzz-"))


def as_file(name: str, reads: Callable[[Path], object]) -> Callable[[bytes], object]:
    """Return a reader of bytes that writes them to a file of this name, and reads that."""

    def read(data: bytes) -> object:
        path = scratch() / name
        path.write_bytes(data)
        return reads(path)

    return read


def resident_bytes() -> int:
    """Return the most memory that this process has had so far."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss << 10
