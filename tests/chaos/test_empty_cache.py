"""A rig on which nothing is compiled yet is armed once all is, however busy its machine."""

import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tools.chaos.stage import COMPILE_S, TEST, Stage

NAMES = ("first", "second", "third")


@pytest.fixture
def busy() -> Iterator[None]:
    """Two processes that take whatever they are given."""
    spinning = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(2)]
    yield
    for process in spinning:
        process.kill()
        process.wait()


@pytest.mark.long
@pytest.mark.usefixtures("busy")
def test_a_campaign_that_begins_with_an_empty_cache_compiles_before_it_arms_and_never_trips(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    folder = tmp_path / "stage"
    folder.mkdir()
    with Stage(folder, tests=[{"name": name, **TEST} for name in NAMES]) as stage:
        stage.start()
        stage.run.wait(2.0 * COMPILE_S)
        printed = stage.printed
    assert stage.run.returncode in (0, 1), printed
    assert "6 of 6" in printed
    assert printed.index("6 of 6") < printed.index("loop: ")
    assert "compiles" not in printed
