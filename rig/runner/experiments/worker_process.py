"""Runs long computations in a process of their own, at low priority, beside an armed rig.

The supervisor of an armed rig must act many times a second, and the loop needs a processor in time.
A computation of a minute in the supervisor's own process would prevent both.
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
from typing import Any, Final, Protocol, TextIO, TypeVar, TypeVarTuple

_NICE: Final = 10
_NAP_S: Final = 0.05
_MARK: Final = "said: "
"""Begins the lines that a computation says, among all else that its process may print."""

T = TypeVar("T")
Ts = TypeVarTuple("Ts")
Waits = Callable[[], None]
"""Is called again and again while a computation goes on."""
Said = Callable[[str], None]
"""Is told in words what a computation is doing."""


class ApartError(Exception):
    """Raised for a computation in a process of its own that gave no result.

    The message is the last line that the process printed; if it printed nothing, its exit code.
    """


class Worker(Protocol):
    """A function that calls another function, in this process or in a new one."""

    def __call__(
        self, waits: Waits, said: Said, function: Callable[[Said, *Ts], T], *args: *Ts
    ) -> T:
        """Return the result of `function(said, *args)`.

        `waits` is called at least once; a worker with a process of its own calls it every 50 ms.
        `said` is called with each line that the function says through its first argument.
        """


def apart(waits: Waits, said: Said, function: Callable[[Said, *Ts], T], *args: *Ts) -> T:
    """Return the result of a function that is called in a process of its own.

    Args:
        waits: is called every 50 ms meanwhile; if it raises an exception, the process is killed and
            the exception is raised on.
        said: is called in this process with each line that the function says.
        function: a function at the top level of a module; it, its arguments and its result are
            pickled. Its first argument is a function, which it calls with each line that it says.
        args: further arguments of the function.

    Raises:
        ApartError: the function raised an exception, or the process ended without a result.
    """
    with tempfile.TemporaryDirectory(prefix="rig-apart-") as folder:
        asked, answered, printed = (Path(folder, name) for name in ("asked", "answered", "said"))
        asked.write_bytes(pickle.dumps((function, args)))
        command = [sys.executable, "-m", __name__, str(asked), str(answered)]
        with printed.open("wb") as log:
            # In a session of its own, so that Ctrl-C reaches only the process that supervises.
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                env=os.environ | {"PYTHONPATH": os.pathsep.join(path for path in sys.path if path)},
            )
        with printed.open(errors="replace") as lines_of:
            try:
                while process.poll() is None:
                    waits()
                    _pass_on(lines_of, said)
                    time.sleep(_NAP_S)
            finally:
                process.kill()
                process.wait()
            _pass_on(lines_of, said)
        if process.returncode != 0 or not answered.is_file():
            lines = printed.read_text(errors="replace").strip().splitlines()
            raise ApartError(lines[-1] if lines else f"ended with {process.returncode}")
        # Safe to unpickle: the process that just ended wrote it, in a folder of this user alone.
        result: T = pickle.loads(answered.read_bytes())
        return result


def _pass_on(lines: TextIO, said: Said) -> None:
    """Call `said` with each marked line, without the mark, that was completed since the last call.

    `lines` is the file to which the process prints, at the place to which it has been read.
    """
    while True:
        place = lines.tell()
        line = lines.readline()
        if not line.endswith("\n"):
            lines.seek(place)
            return
        if line.startswith(_MARK):
            said(line.removeprefix(_MARK).rstrip("\n"))


def _say(words: str) -> None:
    """Print a line, marked, for the process that waits for this one."""
    print(f"{_MARK}{words}", flush=True)


def main() -> None:
    """Call the function that is pickled in one file, and write its result to another.

    The command line gives the paths of both files. The process first lowers its priority.
    """
    asked, answered = map(Path, sys.argv[1:3])
    with contextlib.suppress(OSError):
        os.nice(_NICE)
    function, args = pickle.loads(asked.read_bytes())
    result: Any = function(_say, *args)
    partial = answered.with_suffix(".partial")
    partial.write_bytes(pickle.dumps(result))
    partial.replace(answered)


if __name__ == "__main__":
    main()
