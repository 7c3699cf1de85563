"""Compiled code is never older than the sources it came from."""

import importlib.util
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from rig.compile_cache import (
    drivers_key,
    marks_folder,
    source_key,
    telling_of_compiling,
    use_compile_cache,
)

TWICE = """
from numba import njit

@njit
def plus_one(x):
    return x + 1.0

@njit(cache=True)
def twice(x):
    return 2.0 * plus_one(x)
"""


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


def test_a_change_of_a_driver_from_elsewhere_moves_the_cache(
    install: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    folders, keys = list[str](), [drivers_key()]
    site = install("elsewhere", "a = 1", siren="Driver")
    install("vanished", "", horn="Driver")
    (site / "vanished.py").unlink()
    for source in ("a = 1", "a = 2"):
        (site / "elsewhere.py").write_text(source)
        keys.append(drivers_key())
        monkeypatch.delenv("NUMBA_CACHE_DIR", raising=False)
        use_compile_cache()
        folders.append(os.environ["NUMBA_CACHE_DIR"])
    assert keys[0] == ""
    assert len({*keys}) == 3
    assert [folder.endswith(f"-{key}") for folder, key in zip(folders, keys[1:], strict=True)] == [
        True,
        True,
    ]


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


def loaded_from(source: Path) -> Any:
    spec = importlib.util.spec_from_file_location("doubling", source)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_compiling_is_told_once_and_loading_from_the_cache_is_not(tmp_path: Path) -> None:
    source = tmp_path / "doubling.py"
    source.write_text(TWICE)
    told: list[tuple[str, str]] = []
    for program in ("first", "second"):
        twice = loaded_from(source).twice
        for _ in range(2):
            with telling_of_compiling(
                lambda name, by=program: told.append((by, name)),  # type: ignore[misc]
                lambda by=program: told.append((by, "done")),  # type: ignore[misc]
            ):
                assert twice(1.0) == 4.0
    assert told == [("first", "doubling.twice"), ("first", "done")]


def test_marks_of_what_is_compiled_are_kept_apart_for_each_state_of_the_sources(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path))
    before = marks_folder()
    assert before is not None
    assert before.is_dir()
    with monkeypatch.context() as moved:
        # The same sources at another place are compiled anew by numba.
        moved.setattr("rig.compile_cache.source_key", lambda root: "same")
        here = marks_folder()
        moved.setattr("rig.compile_cache.__file__", str(tmp_path / "rig" / "compile_cache.py"))
        assert marks_folder() not in (here, None)
    monkeypatch.setattr("rig.compile_cache.source_key", lambda root: "other")
    assert marks_folder() not in (before, None)


def test_where_nothing_can_be_kept_there_are_no_marks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    assert marks_folder() is None
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "file"))
    assert marks_folder() is None
