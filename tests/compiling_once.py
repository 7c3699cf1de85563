"""Of the workers that run the tests, one compiles a function; the others wait and load it.

They all begin with the same modules, and would each compile the same for a minute, where nothing is
in the cache yet.
"""

import fcntl
import gc
import importlib
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

PATIENCE_S: Final = 180.0
"""After which a worker compiles a function itself: to wait is to save time, no more."""
_LOOK_S: Final = 0.02
_ORDERS: Final = (
    ("estimator.gap.servo.actuator", "estimator.gap.verdict.workflow"),
    (
        "estimator.gap.prediction.side_by_side",
        "estimator.gap.prediction.sensitivities",
        "estimator.gap.verdict.workflow",
    ),
)
"""Modules that compile as they are imported, in the order of the first worker and of the others."""


def compile_once(folder: Path) -> None:
    """Have this process compile no cached function while another one does, from now on.

    Args:
        folder: for the locks; that of the other processes too.
    """
    from numba.core.caching import NullCache
    from numba.core.compiler_lock import global_compiler_lock
    from numba.core.dispatcher import Dispatcher

    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    compile_alone = Dispatcher.compile
    held: set[str] = set()

    def compile_or_load(self: Any, sig: Any) -> Any:
        if isinstance(self._cache, NullCache):
            return compile_alone(self, sig)
        code = self.py_func.__code__
        place = f"{code.co_filename}:{code.co_firstlineno}:{code.co_qualname}"
        name = sha256(place.encode()).hexdigest()[:32]
        # The lock of all compiling in this process comes first: a thread that waits for it must
        # have no lock that another process waits for. The locks of functions are then taken from
        # callers to callees everywhere, so that no two wait for each other.
        with global_compiler_lock:
            if name in held:
                return compile_alone(self, sig)
            held.add(name)
            try:
                with only_one(folder / name, PATIENCE_S), without_looking_for_garbage():
                    return compile_alone(self, sig)
            finally:
                held.remove(name)

    Dispatcher.compile = compile_or_load  # type: ignore[method-assign]


@contextmanager
def only_one(path: Path, patience_s: float) -> Iterator[None]:
    """Wait until no other process is in here with this file; no longer than that.

    Where the file system takes no locks, or no files, nobody waits.
    """
    end = time.monotonic() + patience_s
    try:
        opened = os.open(path, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC)
    except OSError:
        yield
        return
    try:
        while time.monotonic() < end:
            try:
                fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError:
                time.sleep(_LOOK_S)
            except OSError:
                break
        yield
    finally:
        # Not by closing it alone: a process forked meanwhile has it open too.
        with suppress(OSError):
            fcntl.flock(opened, fcntl.LOCK_UN)
        os.close(opened)


@contextmanager
def without_looking_for_garbage() -> Iterator[None]:
    """Leave garbage alone: compiler and imports make millions of objects, hardly any of it."""
    looking = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if looking:
            gc.enable()


def compile_apart(worker: int) -> None:
    """Import what compiles for long, each worker beginning with something else.

    Args:
        worker: its number, from 0.
    """
    # What cannot be imported is told by the tests that need it.
    with suppress(Exception):
        for module in _ORDERS[min(worker, len(_ORDERS) - 1)]:
            importlib.import_module(module)
