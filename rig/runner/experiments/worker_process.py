"""Long computations in a process of their own, at low priority, while a rig is looked after.

A rig that is armed wants its supervisor's attention many times a second, and its loop wants a
processor in time; neither would get it from a process that computes for a minute.
"""

import contextlib
import os
import pickle
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final, ParamSpec, Protocol, TypeVar

_NICE: Final = 10
_NAP_S: Final = 0.05

P = ParamSpec("P")
T = TypeVar("T")


class ApartError(Exception):
    """The computation did not end in a result; the message is what its process said last."""


class Worker(Protocol):
    """Computes something, here or elsewhere."""

    def __call__(
        self, waits: Callable[[], None], function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
    ) -> T:
        """Return what a function returns; `waits` is called every 50 ms until then."""


def at_once(
    waits: Callable[[], None], function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
) -> T:
    """Return what a function returns, computed here: nobody else needs looking after."""
    waits()
    return function(*args, **kwargs)


def apart(
    waits: Callable[[], None], function: Callable[P, T], *args: P.args, **kwargs: P.kwargs
) -> T:
    """Return what a function of a module returns, computed in a process of its own.

    Args:
        waits: called every 50 ms meanwhile; what it raises ends the process, and is raised.
        function: is found by its name, as pickle does.
        args: of it.
        kwargs: of it.

    Raises:
        ApartError: it raised, or the process ended otherwise.
    """
    with tempfile.TemporaryDirectory(prefix="rig-apart-") as folder:
        asked, answered, said = (Path(folder, name) for name in ("asked", "answered", "said"))
        asked.write_bytes(pickle.dumps((function, args, kwargs)))
        command = [sys.executable, "-m", __name__, str(asked), str(answered)]
        with said.open("wb") as log:
            # In a session of its own: Ctrl-C is for who looks after the rig.
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            )
        try:
            while process.poll() is None:
                waits()
                time.sleep(_NAP_S)
        finally:
            process.kill()
            process.wait()
        if process.returncode != 0 or not answered.is_file():
            lines = said.read_text(errors="replace").strip().splitlines()
            raise ApartError(lines[-1] if lines else f"ended with {process.returncode}")
        # Written by the process just ended, in a folder that is nobody else's.
        result: T = pickle.loads(answered.read_bytes())
        return result


def main() -> None:
    """Compute what the first file asks for, and write the result to the second."""
    asked, answered = map(Path, sys.argv[1:3])
    with contextlib.suppress(OSError):
        os.nice(_NICE)
    function, args, kwargs = pickle.loads(asked.read_bytes())
    result: Any = function(*args, **kwargs)
    partial = answered.with_suffix(".partial")
    partial.write_bytes(pickle.dumps(result))
    partial.replace(answered)


if __name__ == "__main__":
    main()
