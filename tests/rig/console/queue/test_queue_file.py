"""The queue is kept on disk, with who queued each campaign, and a kill loses nothing of it."""

import json
import os
from pathlib import Path

import pytest

from rig.cli.application import main
from rig.console.queue import QueueError, QueueFile


def names(file: QueueFile) -> list[tuple[int, str, str]]:
    return [(each.number, each.campaign, each.by) for each in file.read().entries]


@pytest.fixture
def file(tmp_path: Path) -> QueueFile:
    file = QueueFile(tmp_path)
    file.offer(["leaks", "friction"])
    return file


def test_what_is_queued_is_there_for_another_process_in_its_order_and_by_name(
    file: QueueFile,
) -> None:
    for campaign, by in (("leaks", "Anna"), ("friction", "Bo"), ("leaks", "Bo")):
        file.add(campaign, by)
    other = QueueFile(file.path.parent)
    other.move(3, "first")
    other.move(1, "later")
    other.move(2, "later")  # it is next to last: it changes places with the last one
    other.remove(3)
    assert names(file) == [(1, "leaks", "Anna"), (2, "friction", "Bo")]
    assert file.add("leaks", "Eve").entries[-1].number == 4  # a number is given once


@pytest.mark.parametrize("call", ["fsync", "rename"])
def test_a_change_that_is_cut_short_leaves_the_queue_as_it_was(
    file: QueueFile, monkeypatch: pytest.MonkeyPatch, call: str
) -> None:
    file.add("leaks", "Anna")

    def fails(*_: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        if call == "rename":
            patch.setattr(Path, "replace", fails)
        else:
            patch.setattr(os, "fsync", fails)
        with pytest.raises(QueueError, match="cannot be written: No space left"):
            file.add("friction", "Bo")
    assert names(file) == [(1, "leaks", "Anna")]
    file.add("friction", "Bo")
    assert len(names(file)) == 2


@pytest.mark.parametrize(
    "text", ["", "[]", '{"version": 2}', '{"version": 1, "entries": [{"number": "1"}]}', "[" * 9000]
)
def test_a_file_that_is_no_queue_is_refused_with_its_name_and_a_remedy(
    file: QueueFile, text: str
) -> None:
    file.path.write_text(text)
    with pytest.raises(QueueError, match="is no queue of version 1; remove it"):
        file.read()


def test_a_file_that_others_may_write_is_refused(file: QueueFile) -> None:
    file.path.chmod(0o666)
    with pytest.raises(QueueError, match="others may write it"):
        file.read()


def test_the_terminal_edits_the_queue_and_says_why_it_does_not(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def told(*arguments: str) -> tuple[object, str]:
        with pytest.raises(SystemExit) as end:
            main(["queue", *arguments, "--runs", str(tmp_path)])
        captured = capsys.readouterr()
        return end.value.code, captured.out + captured.err

    assert told("add", "leaks")[0] == 2
    assert "start `rig console` with this --runs first" in told("add", "leaks")[1]
    QueueFile(tmp_path).offer(["leaks", "friction"])
    assert "leak is not offered; the console offers: leaks, friction" in told("add", "leak")[1]
    assert told("add", "leaks", "--by", "Anna")[0] == 0
    assert "   2 friction, queued by Bo at 20" in told("add", "friction", "--by", "Bo")[1]
    assert told("move", "2", "earlier")[1].splitlines()[0].startswith("   2 friction")
    assert "the queue has no entry 7; it has: 2, 1" in told("remove", "7")[1]
    assert [each["by"] for each in json.loads(told("list", "--json")[1])] == ["Bo", "Anna"]
    told("remove", "1")
    assert "the queue is empty" in told("remove", "2")[1]
