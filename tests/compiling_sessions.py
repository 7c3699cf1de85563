"""Compiles, beside the workers of a test run, what sessions with rigs run.

Without this, the first `rig run` of the tests would compile it in processes of its own, while
workers compile the same functions for their tests. Now workers wait for it function by function
(`compiling_once.py`), and a `rig run` waits as it does for any other program that compiles.
"""

import os
import subprocess
import sys
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from rig.runner.campaign.compiled_pieces import Needs

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


def compile_longest(simulated: "Needs") -> None:
    """Compile the simulated loop, for which most tests wait, and then the lanes of a sweep."""
    from rig.configuration.sweeps.sweep import load_sweep
    from rig.runner.campaign.compiled_pieces import PIECES
    from rig.sweep.group import Group, groups_of, setting_of
    from rig.sweep.product_lanes import judged_by_product
    from rig.sweep.running import drawn_chunks

    PIECES["simulated loop"].run(simulated)
    sweep = load_sweep("detector")
    (cases,) = drawn_chunks(sweep, {0})
    judged_by_product(Group(setting_of(sweep), cases, next(groups_of(cases))))


def main() -> None:
    """Compile the pieces of a session on hardware, then those of one on a simulated rig.

    Beside them a process of its own begins with what takes longest.
    """
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
        emulated, simulated = (
            Needs(load_rig(name), DEFAULT_FILTER) for name in ("emulated", "simulated")
        )
        get_context("fork").Process(target=compile_longest, args=(simulated,), daemon=True).start()
        for needs, pieces in ((emulated, ON_HARDWARE), (simulated, SIMULATED)):
            compile_for(needs, pieces, print, StopFlag())


if __name__ == "__main__":
    main()
