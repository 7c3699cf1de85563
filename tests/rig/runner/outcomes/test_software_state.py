import subprocess
from pathlib import Path

import pytest

from rig.plant import Model
from rig.runner.outcomes.software_state import git_state, model_sha256


@pytest.fixture
def repository(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A repository with one committed package, untouched by the user's own settings."""
    for name in ("GIT_DIR", "GIT_WORK_TREE", "GIT_INDEX_FILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", "/dev/null")
    monkeypatch.setenv("GIT_CONFIG_SYSTEM", "/dev/null")
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    (tmp_path / "package").mkdir()
    (tmp_path / "package" / "__init__.py").touch()
    git(tmp_path, "init", "-q")
    git(tmp_path, "add", ".")
    git(tmp_path, "-c", "user.name=a", "-c", "user.email=a@b", "commit", "-qm", "first")
    return tmp_path


def git(folder: Path, *arguments: str) -> None:
    subprocess.run(["git", *arguments], cwd=folder, check=True, capture_output=True)


def test_a_clean_checkout_tells_its_commit(repository: Path) -> None:
    state = git_state(repository / "package")
    assert state is not None
    assert len(state["commit"]) == 40
    assert state["dirty"] is False


def test_a_changed_file_makes_it_dirty(repository: Path) -> None:
    (repository / "package" / "__init__.py").write_text("changed")
    state = git_state(repository / "package")
    assert state is not None
    assert state["dirty"] is True


def test_a_package_that_the_repository_around_it_does_not_keep_has_no_commit(
    repository: Path,
) -> None:
    (repository / ".venv").mkdir()
    (repository / ".venv" / "__init__.py").touch()
    assert git_state(repository / ".venv") is None


def test_outside_a_repository_there_is_no_commit(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("GIT_CEILING_DIRECTORIES", str(tmp_path.parent))
    assert git_state(tmp_path) is None


def test_without_git_there_is_no_commit(repository: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    assert git_state(repository / "package") is None


def test_a_model_s_hash_follows_its_parameters_and_not_its_name() -> None:
    renamed = Model("renamed")
    changed = Model(parameters=Model().parameters._replace(viscous=351.0))
    biased = Model().with_effect("spool_null_bias", value=0.0)
    assert model_sha256(Model()) == model_sha256(renamed)
    assert len({model_sha256(model) for model in (Model(), changed, biased)}) == 3
