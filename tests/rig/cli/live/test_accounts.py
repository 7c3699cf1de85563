"""`rig accounts` keeps accounts, and takes no password from its command line."""

import io
import json
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from rig.accounts import AccountFile, Passwords, Role
from rig.cli.application import main

PASSWORD = "four words that differ"


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    return tmp_path / "hydraulic-rig" / "console-accounts.json"


def told(
    capsys: pytest.CaptureFixture[str], *arguments: str, password: str = PASSWORD
) -> tuple[object, str]:
    with pytest.MonkeyPatch.context() as patch:
        stdin = SimpleNamespace(buffer=io.BytesIO(password.encode() + b"\n"), isatty=lambda: False)
        patch.setattr(sys, "stdin", stdin)
        with pytest.raises(SystemExit) as end:
            main(["accounts", *arguments])
    captured = capsys.readouterr()
    return end.value.code, captured.out + captured.err


def test_accounts_are_made_changed_listed_and_removed(
    capsys: pytest.CaptureFixture[str], state: Path
) -> None:
    assert "asks for its token" in told(capsys, "list")[1]
    made = told(capsys, "add", "Bo", "--role", "viewer", "--password-file", "-")
    assert made == (0, f"Bo: viewer, in {state}\n")
    assert told(capsys, "role", "bo", "engineer") == (0, "Bo: engineer from now on\n")
    another = told(capsys, "password", "Bo", "--password-file", "-", password="an other password")
    assert another[0] == 0
    account = AccountFile(state).read()["bo"]
    assert account.role == Role.ENGINEER
    assert Passwords().fits(account.password, "an other password")
    listed = told(capsys, "list", "--json")[1]
    assert json.loads(listed) == [{"name": "Bo", "role": "engineer"}]
    assert told(capsys, "remove", "Bo")[0] == 0
    assert "is refused" in told(capsys, "list")[1]


@pytest.mark.parametrize(
    ("arguments", "why"),
    [
        (("add", "Bo", "--role", "viewer"), "give --password-file"),
        (("add", "Bo", "--password-file", "-"), "--role"),
        (("add", "Bo", "--role", "king", "--password-file", "-"), "king"),
        (("add", "Bo", "--role", "viewer", "--password-file", "missing"), "cannot be read"),
        (("add", "Bo", "--role", "viewer", "--password-file", "open"), "chmod 600 open"),
        (("add", "Bo", "--role", "viewer", "--password-file", "long"), "more than one line"),
        (("role", "Bo", "viewer"), "is no account; there are none"),
        (("password", "Bo", "--password-file", "-"), "is no account"),
        (("remove", "Bo"), "is no account"),
        (("add", "Bo", PASSWORD, "--role", "viewer"), "unexpected extra argument"),
    ],
)
def test_what_cannot_be_done_is_refused_with_its_reason(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: tuple[str, ...],
    why: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "open").write_text(PASSWORD)
    (tmp_path / "open").chmod(0o644)
    (tmp_path / "long").write_text("a\nb\n")
    (tmp_path / "long").chmod(0o600)
    code, said = told(capsys, *arguments)
    assert (code, why in said) == (2, True), said


def test_no_default_and_no_short_password_is_taken(
    capsys: pytest.CaptureFixture[str], state: Path
) -> None:
    for password in ("", "admin", "password"):
        given = ("add", "Bo", "--role", "viewer", "--password-file", "-")
        code, said = told(capsys, *given, password=password)
        assert (code, "take 15 to 128" in said) == (2, True)
    assert not state.exists()
