"""Compiled code is never older than the sources it came from."""

import os
import sys
from pathlib import Path

import pytest

from rig.compile_cache import source_key, use_compile_cache


@pytest.fixture
def sources(tmp_path: Path) -> Path:
    for folder, text in (("rig/plant", "a = 1"), ("estimator", "b = 2")):
        (tmp_path / folder).mkdir(parents=True)
        (tmp_path / folder / "physics.py").write_text(text)
    return tmp_path


def test_a_change_of_the_physics_moves_the_cache(sources: Path) -> None:
    before = source_key(sources)
    (sources / "rig/plant/physics.py").write_text("a = 3")
    assert source_key(sources) != before


def test_the_same_sources_share_a_cache(sources: Path) -> None:
    assert source_key(sources) == source_key(sources)


def test_the_users_own_choice_of_cache_stands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "elsewhere")
    use_compile_cache()
    assert os.environ["NUMBA_CACHE_DIR"] == "elsewhere"


def test_caches_of_long_gone_sources_are_dropped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    home = tmp_path / "hydraulic-rig"
    for number in range(20):
        (home / f"old{number}").mkdir(parents=True)
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    use_compile_cache()
    assert len(list(home.iterdir())) == 12
    assert os.environ["NUMBA_CACHE_DIR"].startswith(str(home))
