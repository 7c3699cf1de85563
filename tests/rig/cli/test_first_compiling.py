"""A command that compiles says so before it is silent for a minute."""

from pathlib import Path

import pytest

from rig.cli import first_compiling as module


@pytest.mark.parametrize("err", [False, True])
def test_that_it_compiles_is_said_once_for_each_version_as_of_a_run(
    err: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(module, "marks_folder", lambda: tmp_path)
    line = "compiling for this machine, once for each version of the program: emulated plant\n"
    for said in (line, ""):
        with module.first_compiling("emulated plant", err=err):
            # Before it takes its time, not afterwards.
            shown = capsys.readouterr()
            assert (shown.err if err else shown.out) == said
            assert (shown.out if err else shown.err) == ""
