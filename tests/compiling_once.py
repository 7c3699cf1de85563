"""Lets one worker compile a function, while the other workers of a test run wait and then load it.

All workers begin with the same modules. While the cache is empty, each would otherwise compile the
same functions for a minute.
"""

import fcntl
import gc
import importlib
import os
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

PATIENCE_S: Final = 180.0
"""s: a worker that has waited so long compiles the function itself; waiting only saves time."""
_LOOK_S: Final = 0.02
_ORDERS: Final = (
    ("estimator.gap.servo.actuator", "estimator.gap.verdict.workflow"),
    (
        "estimator.gap.prediction.side_by_side",
        "estimator.gap.prediction.sensitivities",
        "estimator.gap.verdict.workflow",
    ),
)
"""Modules that compile when imported: first the list for worker 0, then that for the others."""


def compile_once(folder: Path) -> None:
    """Patch numba so that this process waits while another process compiles the same function.

    Functions that are not cached are compiled as before.

    Args:
        folder: folder of the lock files, which all processes share; it is created if missing.
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
        # The lock on all compiling in this process is acquired first, because a thread that waits
        # for it must hold no lock that another process waits for. The locks of functions are then
        # acquired from callers to callees in all processes, so that no two wait for each other.
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
    """Hold an exclusive lock on the file `path` in this context; wait for it at most `patience_s`.

    After that time the context is entered without the lock. So it is at once where the file cannot
    be opened or the file system has no locks.
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
        # Closing the file is not enough, because a process forked meanwhile has it open too.
        with suppress(OSError):
            fcntl.flock(opened, fcntl.LOCK_UN)
        os.close(opened)


@contextmanager
def after_the_first(path: Path, patience_s: float) -> Iterator[None]:
    """Enter this context at once in the first process that comes, in others once it has left it.

    The others are in it together. A process that has waited for `patience_s` enters it too.
    """
    with ExitStack() as held:
        with suppress(OSError):
            file = held.enter_context(path.open("w"))
            _lock_first(file.fileno(), time.monotonic() + patience_s)
        yield


def _lock_first(opened: int, end: float) -> None:
    """Lock an open file for this process alone, or else, when that is free, for all who wait."""
    try:
        fcntl.flock(opened, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        while time.monotonic() < end:
            with suppress(BlockingIOError):
                return fcntl.flock(opened, fcntl.LOCK_SH | fcntl.LOCK_NB)
            time.sleep(_LOOK_S)


@contextmanager
def without_looking_for_garbage() -> Iterator[None]:
    """Switch the garbage collector off in this context.

    Compiler and imports make millions of objects, of which hardly any is garbage.
    """
    looking = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if looking:
            gc.enable()


def compile_apart(worker: int) -> None:
    """Import the modules that compile for long; worker 0 begins with others than the rest.

    Args:
        worker: number of this worker, from 0.
    """
    # A failing import is not reported here, because the tests that need the module report it.
    with suppress(Exception):
        for module in _ORDERS[min(worker, len(_ORDERS) - 1)]:
            importlib.import_module(module)
