"""What a run wrote outlives its folder: it is held open, and copied to another one."""

import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from rig.runner.run_folder import keeping
from rig.runner.run_folder.journal import Journal, read_journal
from rig.runner.run_folder.keeping import FolderKeeper
from tests.waiting import until


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    path = tmp_path / "run"
    path.mkdir()
    (path / "journal.jsonl").write_text("begun\n")
    return path


class Kept:
    """Notes what a keeper calls."""

    def __init__(self, folder: Path) -> None:
        self.gone = 0
        self.told: list[str] = []
        self.kept: list[Path] = []
        self.keeper = FolderKeeper(folder, self._is_gone, self.kept.append, self.told.append)

    def _is_gone(self) -> None:
        self.gone += 1


@pytest.fixture
def kept(folder: Path) -> Iterator[Kept]:
    made = Kept(folder)
    with made.keeper:
        yield made


def emptied(folder: Path) -> None:
    for file in folder.iterdir():
        file.unlink()


def moved(folder: Path) -> None:
    folder.rename(folder.with_name("elsewhere"))


def replaced(folder: Path) -> None:
    moved(folder)
    folder.mkdir()
    (folder / "journal.jsonl").write_text("of another run\n")


def with_another_journal(folder: Path) -> None:
    (folder / "journal.jsonl").rename(folder / "j")
    (folder / "journal.jsonl").write_text("of another run\n")


def taken_by_a_file(folder: Path) -> None:
    shutil.rmtree(folder)
    folder.write_text("")


@pytest.mark.parametrize(
    "lose", [shutil.rmtree, emptied, moved, replaced, with_another_journal, taken_by_a_file]
)
def test_a_folder_that_is_lost_is_noticed_and_its_files_are_kept_beside_it(
    folder: Path, kept: Kept, lose: Callable[[Path], None]
) -> None:
    with (folder / "test.mcap").open("wb") as recording:
        recording.write(b"first ")
        recording.flush()
        assert kept.keeper.look()
        lose(folder)
        until(lambda: kept.gone == 1, "the loss to be noticed")
        recording.write(b"second")
    beside = folder.with_name("run-kept")
    assert kept.keeper.folder == beside == kept.keeper.kept_in
    assert (beside / "test.mcap").read_bytes() == b"first second"
    assert (beside / "journal.jsonl").read_text() == "begun\n"
    assert kept.kept == [beside]
    assert "removed, moved or emptied" in kept.told[0]
    assert f"rig run --resume {beside}" in kept.told[1]


def test_nothing_is_noticed_while_a_run_writes_to_its_folder_as_it_does(
    folder: Path, kept: Kept
) -> None:
    for number in range(3):
        (folder / ".results.json.1.part").write_text(str(number))
        os.replace(folder / ".results.json.1.part", folder / "results.json")
        (folder / "test.mcap").write_text("attempt")
        assert kept.keeper.look()
        (folder / "test.mcap").rename(folder / f"test~{number + 1}.mcap")
        assert kept.keeper.look()
    assert kept.keeper.folder == folder
    assert not kept.told
    shutil.rmtree(folder)
    names = {path.name for path in kept.keeper.folder.iterdir()}
    assert names == {
        "journal.jsonl", "results.json", "test~1.mcap", "test~2.mcap", "test~3.mcap",
    }  # fmt: skip
    assert (kept.keeper.folder / "results.json").read_text() == "2"


def test_what_another_process_writes_until_the_end_is_kept_too(folder: Path) -> None:
    made = Kept(folder)
    with (folder / "session.log").open("w") as log, made.keeper:
        shutil.rmtree(folder)
        beside = made.keeper.folder
        log.write("the last line")
        log.flush()
    assert (beside / "session.log").read_text() == "the last line"


def test_files_are_kept_in_the_temporary_folder_where_they_cannot_be_beside(
    folder: Path, kept: Kept, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    elsewhere = tmp_path / "temporary"
    elsewhere.mkdir()
    monkeypatch.setattr("tempfile.gettempdir", lambda: str(elsewhere))
    made = Path.mkdir

    def mkdir(path: Path, *args: object, **options: bool) -> None:
        if path.parent == tmp_path:
            raise OSError(30, "Read-only file system")
        made(path, *args, **options)  # type: ignore[arg-type]

    monkeypatch.setattr(Path, "mkdir", mkdir)
    shutil.rmtree(folder)
    assert kept.keeper.folder == elsewhere / "run-kept"


def test_as_many_files_are_held_as_a_process_may_open(
    folder: Path, kept: Kept, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(keeping, "MOST_HELD", 3)
    for number in range(5):
        (folder / f"{number}.mcap").write_text("")
        kept.keeper.look()
    shutil.rmtree(folder)
    assert {"3.mcap", "4.mcap"} < {path.name for path in kept.keeper.folder.iterdir()}


def test_a_journal_goes_on_in_a_copy_of_itself(tmp_path: Path) -> None:
    for name in ("before", "after"):
        (tmp_path / name).mkdir()
    with Journal(tmp_path / "before") as journal:
        journal.write("begin", campaign="x")
        shutil.rmtree(tmp_path / "before")
        journal.move_to(tmp_path / "after")
        journal.write("end")
    entries = read_journal(tmp_path / "after" / "journal.jsonl")
    assert [each.kind for each in entries] == ["begin", "end"]
