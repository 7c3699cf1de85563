"""Where a user's cache folder may not be written to, what is compiled is kept elsewhere, safely."""

import os
import stat
import sys
import tempfile
from pathlib import Path

import pytest

from rig.compile_cache import use_compile_cache


@pytest.fixture
def temporary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder for temporary files of a machine on which no cache folder can be made."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", "")
    monkeypatch.delenv("NUMBA_CACHE_DIR")
    monkeypatch.delitem(sys.modules, "numba", raising=False)
    in_the_way = tmp_path / "file"
    in_the_way.touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(in_the_way))
    folder = tmp_path / "tmp"
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


def test_it_is_kept_in_a_folder_that_only_this_user_may_use(temporary: Path) -> None:
    use_compile_cache()
    own = temporary / f"hydraulic-rig-{os.getuid()}"
    assert Path(os.environ["NUMBA_CACHE_DIR"]).parent == own
    assert stat.S_IMODE(own.stat().st_mode) == stat.S_IRWXU


def test_a_folder_that_others_may_write_to_is_not_taken(temporary: Path) -> None:
    own = temporary / f"hydraulic-rig-{os.getuid()}"
    own.mkdir()
    own.chmod(0o777)
    use_compile_cache()
    assert "NUMBA_CACHE_DIR" not in os.environ


def test_a_link_to_a_folder_of_somebody_else_is_not_taken(temporary: Path) -> None:
    elsewhere = temporary / "elsewhere"
    elsewhere.mkdir(mode=0o700)
    (temporary / f"hydraulic-rig-{os.getuid()}").symlink_to(elsewhere)
    use_compile_cache()
    assert "NUMBA_CACHE_DIR" not in os.environ
