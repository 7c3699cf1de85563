"""Workers that run the tests wait for one another's compiling, and never for ever."""

import fcntl
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from .compiling_once import after_the_first, only_one

ROOT = Path(__file__).parents[1]
COMPILING = """
import sys
from pathlib import Path
from numba.core import event
from tests.compiling_once import compile_once

class Listener(event.Listener):
    def on_start(self, event):
        print("compiles", event.data["dispatcher"].py_func.__name__)
    def on_end(self, event):
        pass

compile_once(Path(sys.argv[1]))
print("ready", flush=True)
sys.stdin.readline()
with event.install_listener("numba:compile", Listener()):
    import doubling
    print(doubling.four_times(1.0))
"""
DOUBLING = """
from numba import njit

@njit(cache=True)
def twice(x):
    return 2.0 * x

@njit(cache=True)
def four_times(x):
    return twice(twice(x))
"""


def test_of_processes_that_begin_together_one_compiles(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "doubling.py").write_text(DOUBLING)
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("PYTHONPATH", f"{ROOT}:{tmp_path}")
    begun = [
        subprocess.Popen(
            [sys.executable, "-c", COMPILING, str(tmp_path / "locks")],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )
        for _ in range(2)
    ]  # fmt: skip
    for process in begun:
        assert process.stdout is not None
        assert process.stdout.readline() == "ready\n"
    for process in begun:
        assert process.stdin is not None
        process.stdin.write("\n")
        process.stdin.flush()
    said = [process.communicate()[0].split("\n") for process in begun]
    assert all("4.0" in lines for lines in said)
    assert sum("compiles four_times" in lines for lines in said) == 1
    assert sum("compiles twice" in lines for lines in said) == 1


def test_who_waits_goes_on_as_soon_as_the_other_is_done(tmp_path: Path) -> None:
    path, went_on = tmp_path / "lock", threading.Event()

    def wait() -> None:
        with only_one(path, 60.0):
            went_on.set()

    with path.open("w") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        waiting = threading.Thread(target=wait)
        waiting.start()
        assert not went_on.wait(0.1)
        fcntl.flock(other, fcntl.LOCK_UN)
        waiting.join(60.0)
    assert went_on.is_set()


def test_after_the_first_all_others_go_on_together(tmp_path: Path) -> None:
    path, together = tmp_path / "lock", threading.Barrier(2, timeout=60.0)

    def follow() -> None:
        with after_the_first(path, 60.0):
            together.wait()

    others = [threading.Thread(target=follow) for _ in range(2)]
    with after_the_first(path, 60.0):
        for other in others:
            other.start()
        others[0].join(0.1)
        assert together.n_waiting == 0
    for other in others:
        other.join(60.0)
    assert not together.broken
    with after_the_first(path, 60.0), after_the_first(path, 0.05):
        pass


def test_a_worker_that_hangs_while_it_compiles_is_not_waited_for_for_ever(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    with path.open("w") as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        with only_one(path, 0.05):
            pass


def test_where_no_file_can_be_locked_nobody_waits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with only_one(tmp_path / "no folder" / "lock", 60.0):
        pass

    def fails(*_: object) -> None:
        raise OSError("no locks available")

    monkeypatch.setattr(fcntl, "flock", fails)
    with only_one(tmp_path / "lock", 60.0):
        pass
