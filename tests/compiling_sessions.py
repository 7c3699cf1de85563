"""Compiles, beside the workers of a test run, what sessions with rigs run.

Without this, the first `rig run` of the tests would compile it in processes of its own, while
workers compile the same functions for their tests. Now workers wait for it function by function
(`compiling_once.py`), and a `rig run` waits as it does for any other program that compiles.
"""

import os
import subprocess
import sys
from pathlib import Path
from typing import Final

ROOT: Final = Path(__file__).parents[1]


def begin() -> "subprocess.Popen[bytes]":
    """Start the compiling in a process of its own, which the caller ends with the test run.

    Whatever fails there is not reported, because the tests that need it report it.
    """
    silent = subprocess.DEVNULL
    arguments = [sys.executable, "-m", "tests.compiling_sessions"]
    return subprocess.Popen(arguments, cwd=ROOT, stdin=silent, stdout=silent, stderr=silent)


def end(process: "subprocess.Popen[bytes]") -> None:
    """End the compiling, which has long come to its end unless the test run was very short."""
    process.terminate()
    process.wait()


def main() -> None:
    """Compile the pieces of a session on hardware, then those of one on a simulated rig."""
    from estimator.filters import DEFAULT_FILTER
    from rig.compile_cache import use_compile_cache
    from rig.configuration.rigs.rig import load_rig
    from rig.runner import StopFlag
    from rig.runner.campaign.compiled_pieces import Needs
    from rig.runner.campaign.compiling import ON_HARDWARE, SIMULATED, compile_for

    from .compiling_once import compile_once

    use_compile_cache()
    folder = os.environ.get("NUMBA_CACHE_DIR")
    if folder:
        compile_once(Path(folder) / "locks")
        for rig, pieces in (("emulated", ON_HARDWARE), ("simulated", SIMULATED)):
            compile_for(Needs(load_rig(rig), DEFAULT_FILTER), pieces, print, StopFlag())


if __name__ == "__main__":
    main()
