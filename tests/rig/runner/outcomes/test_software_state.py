import hashlib
import json
import subprocess
from pathlib import Path

import pytest

from rig.plant import NOMINAL, Model, model_sha256
from rig.plant.added_terms import AddedTerm, fields_of
from rig.runner.outcomes.software_state import git_state


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


def test_terms_and_tables_count_in_the_hash_of_a_model() -> None:
    knots = ((0.0, 0.0), (0.1, 30.0))
    tables = [
        AddedTerm("force balance", "velocity", "table", False, 1.0, knots=(*knots, last))
        for last in ((0.2, 40.0), (0.2, 50.0))
    ]
    held = [Model(parameters=NOMINAL._replace(**fields_of((table,)))) for table in tables]
    others = [Model(discovered=(table._replace(of="time"),)) for table in tables]
    assert len({model_sha256(model) for model in (Model(), *held, *others)}) == 5


def test_the_hash_of_a_model_without_tables_is_that_from_before_there_were_tables() -> None:
    content = {
        "parameters": {
            name: value
            for name, value in NOMINAL._asdict().items()
            if not name.startswith("table_")
        },
        "effects": [],
    }
    before = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
    assert model_sha256(Model()) == before
