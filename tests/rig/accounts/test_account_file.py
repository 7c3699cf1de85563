"""The file of accounts is its owner's alone, and is whole at any moment."""

import json
import os
from pathlib import Path
from typing import Any
from unittest.mock import MagicMock

import pytest

from rig.accounts import Account, AccountFile, AccountsError, Passwords, Role
from rig.accounts.account_file import LARGEST_FILE, MOST_ACCOUNTS

HASH = Passwords(memory_kib=8, passes=1).decoy


@pytest.fixture
def file(tmp_path: Path) -> AccountFile:
    return AccountFile(tmp_path / "kept" / "accounts.json")


def test_accounts_are_kept_where_only_their_owner_reads_them(file: AccountFile) -> None:
    file.add("Bo", Role.OPERATOR, HASH)
    file.add("  Zoe\u0308  ", Role.VIEWER, HASH)
    file.change("bO", role=Role.ENGINEER)
    assert file.read() == {
        "bo": Account("Bo", Role.ENGINEER, HASH),
        "zo\u00eb": Account("Zo\u00eb", Role.VIEWER, HASH),
    }
    file.remove("ZOE\u0308")
    assert [*file.read()] == ["bo"]
    assert file.path.stat().st_mode & 0o777 == 0o600
    assert file.path.parent.stat().st_mode & 0o777 == 0o700


@pytest.mark.parametrize(
    "name", ["", " ", "x" * 33, "a: b", "a\nb", "\ud800", "-x", "<b>", "a\u202eb", "a,b", "\x1b[2J"]
)
def test_a_name_that_would_mislead_a_reader_is_none(file: AccountFile, name: str) -> None:
    with pytest.raises(ValueError, match="name"):
        file.add(name, Role.VIEWER, HASH)
    assert not file.exists()


@pytest.mark.parametrize("name", ["Jo O'Neill-Smith 2", "Łukasz", "山田", "नीता", "a.b_c"])
def test_people_of_all_countries_have_names(file: AccountFile, name: str) -> None:
    assert file.add(name, Role.VIEWER, HASH).name == name
    assert AccountFile(file.path).read()


@pytest.mark.parametrize("name", ["BO", "\uff22\uff4f"])
def test_nobody_gets_the_name_of_another_in_other_spelling(file: AccountFile, name: str) -> None:
    file.add("Bo", Role.VIEWER, HASH)
    with pytest.raises(AccountsError, match="an account Bo already"):
        file.add(name, Role.VIEWER, HASH)


def test_who_is_not_there_is_not_changed(file: AccountFile) -> None:
    file.add("Bo", Role.VIEWER, HASH)
    for change in (file.remove, file.change, file.check):
        with pytest.raises(AccountsError, match="Eva: is no account; there are Bo"):
            change("Eva")


def test_there_are_no_more_accounts_than_a_console_has_visitors(file: AccountFile) -> None:
    file.add("Bo", Role.VIEWER, HASH)
    content = json.loads(file.path.read_text())
    entry = content["accounts"][0]
    content["accounts"] = [entry | {"name": f"Bo {number}"} for number in range(MOST_ACCOUNTS)]
    file.path.write_text(json.dumps(content))
    with pytest.raises(AccountsError, match="holds 200 accounts"):
        file.add("Eva", Role.VIEWER, HASH)


@pytest.mark.parametrize("step", ["fsync", "replace"])
def test_a_process_that_dies_amid_a_change_leaves_the_accounts_as_they_were(
    file: AccountFile, step: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    file.add("Bo", Role.VIEWER, HASH)
    before = file.path.read_bytes()

    def dies(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(os, step, dies)
        with pytest.raises(KeyboardInterrupt):
            file.add("Eva", Role.VIEWER, HASH)
    assert file.path.read_bytes() == before
    file.add("Eva", Role.VIEWER, HASH)
    assert [*file.read()] == ["bo", "eva"]


def test_a_full_disk_is_reported_and_changes_nothing(
    file: AccountFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: Any) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(AccountsError, match="cannot be changed: No space left"):
        file.add("Bo", Role.VIEWER, HASH)
    assert not file.exists()


@pytest.mark.parametrize("mode", [0o640, 0o604, 0o620])
def test_a_file_that_others_may_read_or_write_is_refused(file: AccountFile, mode: int) -> None:
    file.add("Bo", Role.VIEWER, HASH)
    file.path.chmod(mode)
    with pytest.raises(AccountsError, match="chmod 600"):
        file.read()


def test_a_pipe_a_folder_and_a_file_of_another_user_hold_no_accounts(
    file: AccountFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    file.path.parent.mkdir()
    os.mkfifo(file.path, 0o600)
    with pytest.raises(AccountsError, match="no file of this user"):
        file.read()
    file.path.unlink()
    file.add("Bo", Role.VIEWER, HASH)
    own = os.geteuid()
    monkeypatch.setattr(os, "geteuid", lambda: own + 1)
    with pytest.raises(AccountsError, match="no file of this user"):
        file.read()


@pytest.mark.parametrize(
    "content",
    ["", "[]", "{", "[" * 100_000, '{"version": 2, "accounts": []}', '{"version": 1}', "\x00",
     '{"version": 1, "accounts": [1, {"name": "x"}]}', " " * (LARGEST_FILE + 1)],
)  # fmt: skip
def test_a_damaged_file_is_refused_with_its_name_and_not_overwritten(
    file: AccountFile, content: str
) -> None:
    file.path.parent.mkdir()
    file.path.write_text(content)
    file.path.chmod(0o600)
    with pytest.raises(AccountsError, match=str(file.path)):
        file.read()
    with pytest.raises(AccountsError):
        file.add("Bo", Role.VIEWER, HASH)
    assert file.path.read_text() == content


def test_all_that_is_wrong_with_accounts_is_told_at_once(file: AccountFile) -> None:
    good = {"name": "Bo", "role": "viewer", "password": HASH}
    bad = [good, good | {"role": "king"}, good | {"name": "a:b"}, good | {"password": "x"}, good]
    file.path.parent.mkdir()
    file.path.write_text(json.dumps({"version": 1, "accounts": bad}))
    file.path.chmod(0o600)
    with pytest.raises(AccountsError) as refused:
        file.read()
    assert [line.split(": account ")[1][:1] for line in refused.value.problems] == [*"2345"]


def test_an_account_that_is_made_anew_is_another_one(file: AccountFile) -> None:
    passwords = Passwords(memory_kib=8, passes=1)
    first = file.add("Bo", Role.VIEWER, passwords.hash("the same password"))
    file.remove("Bo")
    assert file.add("Bo", Role.VIEWER, passwords.hash("the same password")).proof != first.proof


def test_accounts_that_nobody_may_look_for_are_not_called_none(
    file: AccountFile, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not file.exists()
    monkeypatch.setattr(os, "lstat", MagicMock(side_effect=PermissionError(13, "denied")))
    with pytest.raises(PermissionError):
        file.exists()
