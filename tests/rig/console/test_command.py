"""`rig console` says what is wrong with what it is given, and opens nothing."""

import socket
from pathlib import Path

import pytest

from rig.cli.application import main


def ended(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[object, str]:
    with pytest.raises(SystemExit) as end:
        main(["console", *arguments])
    return end.value.code, capsys.readouterr().err


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    profile = "name: here\nlisten: [tcp/127.0.0.1:0]\n"
    (tmp_path / "here.yaml").write_text(profile)
    monkeypatch.chdir(tmp_path)


def test_off_this_machine_it_is_refused_without_tls(capsys: pytest.CaptureFixture[str]) -> None:
    code, said = ended(capsys, "--listen", "0.0.0.0:8480")
    assert code == 2
    assert "--listen" in said
    assert "give --certificate and --key" in said
    assert "ssh -L 8480" in said


def test_a_port_that_is_taken_is_reported(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        where = f"127.0.0.1:{taken.getsockname()[1]}"
        code, said = ended(capsys, "--listen", where, "--profile", "here.yaml")
    assert code == 2
    assert f"cannot listen on {where}" in said


def test_a_token_that_others_may_read_is_refused(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    folder = tmp_path / "hydraulic-rig"
    folder.mkdir()
    (folder / "console.token").write_text("ab" * 32)
    (folder / "console.token").chmod(0o644)
    code, said = ended(capsys, "--listen", "127.0.0.1:0", "--profile", "here.yaml")
    assert (code, "may be read by others" in said) == (2, True)


def test_campaigns_that_are_not_there_are_reported(capsys: pytest.CaptureFixture[str]) -> None:
    code, said = ended(capsys, "--campaign", "nothing.yaml")
    assert (code, "does not exist" in said) == (2, True)
