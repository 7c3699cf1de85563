"""Of a run that was refused before anything moved nothing is left, and of any other everything."""

from pathlib import Path
from typing import Any

import pytest

from rig.runner.run_folder.acknowledging import acknowledge_ended
from rig.runner.run_folder.directory import RESULTS, SCHEMA
from rig.runner.run_folder.journal import JOURNAL, Journal, JournalError, read_journal
from rig.runner.run_folder.refused import discard_refused
from rig.runner.run_folder.resuming import standing_of


def run_of(folder: Path, *entries: tuple[str, dict[str, Any]]) -> Path:
    """Write journal and results of a run of two tests."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / RESULTS).write_text(f'{{"schema": "{SCHEMA}", "tests": []}}')
    with Journal(folder) as journal:
        journal.write("begin", campaign="leaks", tests=["one", "two"])
        for kind, details in entries:
            journal.write(kind, **details)
    return folder


def test_a_refused_run_leaves_no_folder(tmp_path: Path) -> None:
    run = run_of(tmp_path / "run")
    assert discard_refused(run, existed=False)
    assert not run.exists()


def test_a_folder_that_was_there_and_files_of_others_stay(tmp_path: Path) -> None:
    run = run_of(tmp_path / "run")
    (run / "photo.jpg").write_text("")
    assert discard_refused(run, existed=False)
    assert [file.name for file in run.iterdir()] == ["photo.jpg"]
    there = run_of(tmp_path / "there")
    assert discard_refused(there, existed=True)
    assert list(there.iterdir()) == []


@pytest.mark.parametrize(
    "entry",
    [
        ("phase", {"test": 0, "attempt": 1, "phase": "setup", "kept": None}),
        ("operator", {"request": "note", "who": "root", "text": "oil"}),
        ("resume", {"versions_changed": ""}),
    ],
)
def test_a_run_in_which_something_happened_stays(
    tmp_path: Path, entry: tuple[str, dict[str, Any]]
) -> None:
    run = run_of(tmp_path / "run", entry)
    assert not discard_refused(run, existed=False)
    assert (run / JOURNAL).exists()


def test_a_run_that_goes_on_in_another_process_stays(tmp_path: Path) -> None:
    run = run_of(tmp_path / "run")
    with Journal(run, resume=True):
        assert not discard_refused(run, existed=False)
    assert not discard_refused(tmp_path / "nothing", existed=False)


def test_a_trip_is_acknowledged_after_its_run_has_ended_by_name(tmp_path: Path) -> None:
    outcome = {"test": 1, "outcome": {"status": "tripped"}}
    run = run_of(tmp_path / "run", ("outcome", outcome), ("end", {"reason": "a trip"}))
    said = acknowledge_ended(run, "root", "Anna: it was me", "Anna")
    assert said == "acknowledged: two: tripped; stopped by a trip"
    last = read_journal(run / JOURNAL)[-1]
    assert (last.kind, last["request"], last["who"]) == ("operator", "acknowledge", "root")
    assert (last["person"], last["seen"]) == ("Anna", ["two: tripped", "stopped by a trip"])
    seen = standing_of([read_journal(run / JOURNAL)[0], last]).history[-1]
    assert (seen.who, seen.what) == (
        "Anna", "acknowledge two: tripped; stopped by a trip: it was me",
    )  # fmt: skip


def test_only_a_run_that_has_ended_takes_it(tmp_path: Path) -> None:
    run = run_of(tmp_path / "run")
    with Journal(run, resume=True), pytest.raises(JournalError, match="is running"):
        acknowledge_ended(run, "root")
    with pytest.raises(JournalError, match="give the folder of a run"):
        acknowledge_ended(tmp_path, "root")
