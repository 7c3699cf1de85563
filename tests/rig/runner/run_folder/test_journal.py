"""The journal: what is in it stays, whatever a kill or a power cut leaves of its end."""

import json
import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from hypothesis import given, strategies as st

from rig.runner.run_folder.journal import JOURNAL, Journal, JournalError, is_written, read_journal


@pytest.fixture
def lines(tmp_path: Path) -> list[bytes]:
    """A journal of four lines."""
    with Journal(tmp_path) as journal:
        journal.write("begin", tests=["one", "two"])
        journal.write("phase", durable=False, test=0, phase="main")
        journal.write("operator", text="leaks; see above: µ, }\n", who="anna")
        journal.write("end", reason="")
    return (tmp_path / JOURNAL).read_bytes().splitlines(keepends=True)


def test_lines_are_json_numbered_and_timed(lines: list[bytes]) -> None:
    content = [json.loads(line) for line in lines]
    assert [each["n"] for each in content] == [0, 1, 2, 3]
    assert content[2]["text"] == "leaks; see above: µ, }\n"
    assert all(each["at"].endswith("+00:00") for each in content)


def test_cut_at_any_byte_every_whole_line_is_read_and_the_journal_goes_on(
    lines: list[bytes], tmp_path: Path
) -> None:
    content = b"".join(lines)
    for cut in range(len(content) + 1):
        (tmp_path / JOURNAL).write_bytes(content[:cut])
        whole = sum(len(b"".join(lines[:count])) <= cut for count in range(1, 5))
        assert len(read_journal(tmp_path / JOURNAL)) == whole
        with Journal(tmp_path, resume=True) as journal:
            assert len(journal.entries) == whole
            journal.write("resume")
        assert [entry.number for entry in read_journal(tmp_path / JOURNAL)] == [*range(whole + 1)]


@given(data=st.data())
def test_a_changed_byte_never_changes_what_is_read(data: st.DataObject) -> None:
    lines = _written()
    content = bytearray(b"".join(lines))
    at = data.draw(st.integers(0, len(content) - 1))
    content[at] ^= data.draw(st.integers(1, 255))
    path = _folder() / JOURNAL
    whole = read_journal(path)
    path.write_bytes(bytes(content))
    if at < len(b"".join(lines[:-2])):
        with pytest.raises(JournalError, match="is damaged"):
            read_journal(path)
        return
    try:
        found = read_journal(path)
    except JournalError:
        return
    assert found == whole[: len(found)]
    assert len(whole) - 2 <= len(found) < len(whole)


def test_a_checksum_in_other_letters_is_damage_too(tmp_path: Path) -> None:
    with Journal(tmp_path) as journal:
        for number in range(40):
            journal.write("note", text=f"number {number}")
    lines = (tmp_path / JOURNAL).read_bytes().splitlines(keepends=True)
    place = next(k for k, line in enumerate(lines[:-2]) if line[-11:-3] != line[-11:-3].upper())
    lines[place] = lines[place][:-11] + lines[place][-11:-3].upper() + lines[place][-3:]
    (tmp_path / JOURNAL).write_bytes(b"".join(lines))
    with pytest.raises(JournalError, match="is damaged"):
        read_journal(tmp_path / JOURNAL)


def _folder() -> Path:
    path = Path(os.environ["JOURNAL_FOLDER"])
    path.mkdir(exist_ok=True)
    return path


def _written() -> list[bytes]:
    with Journal(_folder()) as journal:
        for number in range(4):
            journal.write("note", text=f"number {number}")
    return (_folder() / JOURNAL).read_bytes().splitlines(keepends=True)


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JOURNAL_FOLDER", str(tmp_path / "changed"))


def test_two_cannot_write_the_same_journal_and_a_killed_one_holds_no_lock(tmp_path: Path) -> None:
    program = (
        "import sys, pathlib; from rig.runner.run_folder.journal import Journal\n"
        "journal = Journal(pathlib.Path(sys.argv[1])).__enter__()\n"
        "journal.write('begin', tests=[])\n"
        "print('ready', flush=True); sys.stdin.read()"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program, str(tmp_path)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "ready\n"
        assert is_written(tmp_path)
        with pytest.raises(JournalError, match="a campaign is running in it"):
            Journal(tmp_path, resume=True).__enter__()
        other.kill()
        other.wait()
    assert not is_written(tmp_path)
    with Journal(tmp_path, resume=True) as journal:
        assert [entry.kind for entry in journal.entries] == ["begin"]


def test_what_is_not_there_is_said_with_a_remedy(tmp_path: Path) -> None:
    with pytest.raises(JournalError, match="give the folder of a run"):
        read_journal(tmp_path / JOURNAL)
    assert not is_written(tmp_path)


def test_a_pipe_in_the_place_of_a_journal_keeps_nobody_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / JOURNAL)
    # Whoever waits for a writer gets one after a while, so that this test fails and does not hang.
    writer = threading.Timer(5.0, os.open, (tmp_path / JOURNAL, os.O_WRONLY | os.O_NONBLOCK))
    writer.daemon = True
    writer.start()
    assert not is_written(tmp_path)
    assert writer.is_alive()
    writer.cancel()
