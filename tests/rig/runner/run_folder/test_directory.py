import json
import re
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, strategies as st

from rig.recording import McapWriter
from rig.runner.run_folder.directory import (
    SCHEMA,
    DirectoryError,
    default_directory,
    prepare_directory,
    recording_names,
)


def write_recording(path: Path) -> None:
    with McapWriter(path, ["time_s"]) as writer:
        writer.write(np.zeros((1, 1)))


def write_run(path: Path, *tests: str) -> None:
    content = {"schema": SCHEMA, "tests": [{"name": name} for name in tests]}
    (path / "results.json").write_text(json.dumps(content))
    for name in recording_names(tests):
        write_recording(path / name)


def names_in(path: Path) -> set[str]:
    return {file.name for file in path.iterdir()}


def test_a_new_folder_is_made_with_its_parents(tmp_path: Path) -> None:
    prepare_directory(tmp_path / "a" / "b", ["x.mcap"])
    assert names_in(tmp_path / "a" / "b") == set()


def test_of_an_earlier_run_everything_goes_and_what_others_put_there_stays(tmp_path: Path) -> None:
    write_run(tmp_path, "one", "two")
    trip = ("trip-1.json", "trip-1.txt", "trip-1.csv", "session.log")
    for name in ("junit.xml", "report.html", "errors.log", "notes.txt", *trip):
        (tmp_path / name).touch()
    write_recording(tmp_path / "kept.mcap")
    prepare_directory(tmp_path, ["one.mcap"])
    assert names_in(tmp_path) == {"notes.txt", "kept.mcap"}


@pytest.mark.parametrize(
    "content", ["", "[]", "{}", '{"schema": "rig-results"}', '{"schema": "x", "tests": []}', "\xff"]
)
def test_results_of_another_program_are_not_replaced(tmp_path: Path, content: str) -> None:
    (tmp_path / "results.json").write_text(content)
    with pytest.raises(DirectoryError, match="no results of an earlier run"):
        prepare_directory(tmp_path, [])
    assert (tmp_path / "results.json").read_text() == content


def test_a_collection_of_recordings_is_no_run(tmp_path: Path) -> None:
    write_recording(tmp_path / "x.mcap")
    with pytest.raises(DirectoryError):
        prepare_directory(tmp_path, ["x.mcap"])
    assert names_in(tmp_path) == {"x.mcap"}


def test_a_file_that_the_run_would_overwrite_and_no_run_wrote_is_in_the_way(tmp_path: Path) -> None:
    write_run(tmp_path, "one")
    (tmp_path / "two.mcap").write_text("not a recording")
    (tmp_path / "three.mcap").write_text("nor is this")
    with pytest.raises(DirectoryError) as caught:
        prepare_directory(tmp_path, ["two.mcap", "three.mcap"])
    assert len(caught.value.problems) == 2
    assert names_in(tmp_path) == {"results.json", "one.mcap", "two.mcap", "three.mcap"}


def test_what_was_put_in_the_place_of_a_recording_is_not_deleted(tmp_path: Path) -> None:
    write_run(tmp_path, "one")
    (tmp_path / "one.mcap").write_text("somebody's notes")
    prepare_directory(tmp_path, ["two.mcap"])
    assert names_in(tmp_path) == {"one.mcap"}


def test_nothing_outside_the_folder_is_deleted_whatever_the_results_say(tmp_path: Path) -> None:
    inside = tmp_path / "run"
    inside.mkdir()
    write_recording(tmp_path / "outside.mcap")
    content = {"schema": SCHEMA, "tests": [{"name": "../outside"}]}
    (inside / "results.json").write_text(json.dumps(content))
    prepare_directory(inside, [])
    assert names_in(tmp_path) == {"run", "outside.mcap"}


def test_a_file_is_no_folder(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(DirectoryError, match="is a file"):
        prepare_directory(tmp_path / "file", [])
    with pytest.raises(DirectoryError, match="cannot be written"):
        prepare_directory(tmp_path / "file" / "below", [])


def test_a_second_run_in_the_same_second_gets_its_own_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    moment = datetime(2026, 2, 3, 4, 5, 6, tzinfo=UTC)
    first = default_directory("my campaign", moment)
    assert first == Path("runs/my_campaign-20260203T040506Z")
    first.mkdir(parents=True)
    assert default_directory("my campaign", moment) == Path("runs/my_campaign-20260203T040506Z-2")


@given(st.lists(st.text(), max_size=8))
def test_every_test_has_a_file_name_of_its_own_on_any_file_system(tests: list[str]) -> None:
    names = recording_names(tests)
    assert len({name.lower() for name in names}) == len(tests)
    assert all(re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9._-]*\.mcap", name) for name in names)
    assert all(len(name) <= 120 for name in names)


def test_a_folder_s_name_tells_the_test_s() -> None:
    assert recording_names(["leak 1: low", "leak 1/ low", "LEAK_1_low"]) == [
        "leak_1_low.mcap",
        "leak_1_low-2.mcap",
        "LEAK_1_low-3.mcap",
    ]
