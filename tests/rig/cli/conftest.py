"""Fixtures that run the command line in this process, and short campaigns to run by it."""

import io
from collections.abc import Callable
from contextlib import redirect_stdout
from pathlib import Path
from typing import NamedTuple

import pytest

from rig.cli import main


class Done(NamedTuple):
    """The exit code and the output of a command."""

    code: int
    out: str
    err: str


Invoke = Callable[..., Done]

CAMPAIGN = """
name: short
rig: simulated
tests:
  - name: healthy
    duration: 10 s
    settle: 0.5 s
    setpoint: {type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 0.5 Hz}
  - name: leak [low]
    duration: 14 s
    settle: 0.5 s
    setpoint: {type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 0.5 Hz}
    faults: [{type: external_leakage_1, at: 8 s, flow: 0.8 L/min, pressure: 6.9 MPa}]
"""


def compile_nothing_ahead(patch: pytest.MonkeyPatch) -> None:
    """Patch commands so that they compile nothing in advance.

    What they would compile, and report, depends on the tests that ran before.
    """
    for module in (
        "rig.cli.hardware.home",
        "rig.cli.hardware.calibrate",
        "rig.runner.campaign.campaign_run",
    ):
        patch.setattr(f"{module}.compile_for", lambda *arguments: None)


@pytest.fixture
def invoke(
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
) -> Invoke:
    """Return a function that runs `rig` with given arguments in an empty working directory.

    Files with tracebacks, which `rig` may write, go to another folder.
    """
    monkeypatch.chdir(tmp_path)
    compile_nothing_ahead(monkeypatch)
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path_factory.mktemp("temporary")))

    def run(*arguments: object) -> Done:
        capsys.readouterr()
        with pytest.raises(SystemExit) as caught:
            main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        assert isinstance(caught.value.code, int)
        return Done(caught.value.code, captured.out, captured.err)

    return run


@pytest.fixture
def campaign_file(tmp_path: Path) -> Path:
    """Return the file of a campaign with a healthy test and one with a leak, 24 s in all."""
    path = tmp_path / "short.yaml"
    path.write_text(CAMPAIGN)
    return path


@pytest.fixture(scope="session")
def short_run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run of that campaign, for tests that change nothing in it."""
    folder = tmp_path_factory.mktemp("short")
    (folder / "short.yaml").write_text(CAMPAIGN)
    with pytest.MonkeyPatch.context() as patch, redirect_stdout(io.StringIO()):
        compile_nothing_ahead(patch)
        with pytest.raises(SystemExit) as done:
            main(["run", str(folder / "short.yaml"), "--out", str(folder / "run")])
    assert done.value.code == 0
    return folder / "run"
