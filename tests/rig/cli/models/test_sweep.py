import json
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner, Result

from rig.cli.application import EXIT_BAD_INPUT, EXIT_STOPPED, main as rig_main
from rig.cli.models.sweep import command
from rig.sweep import local, running
from rig.sweep.drawing import Cases
from rig.sweep.group import Setting
from rig.sweep.run_cases import Judged, run_chunk

TEXT = """\
name: tiny
rig: ideal
cases: 16
duration: 20 s
leaks: {flow: {log_uniform: [0.1 L/min, 3 L/min]}, onset: 15.5 s}
motions:
  - {type: sine, mean: 0.3 m, amplitude: {uniform: [0.05 m, 0.2 m]}, frequency: 0.5 Hz}
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(running, "_CHUNK_RIG_S", 100.0)
    (tmp_path / "tiny.yaml").write_text(TEXT)
    return tmp_path


def rig_sweep(*arguments: str) -> Result:
    return CliRunner().invoke(command, [*arguments, "--jobs", "1"], standalone_mode=False)


def test_a_sweep_leaves_table_page_and_summary(folder: Path) -> None:
    done = rig_sweep("tiny.yaml", "--out", "out", "--json")
    assert done.return_value == 0, done.output
    reported = json.loads(done.stdout.splitlines()[-1])
    assert reported["cases"] == 16
    assert reported["timing"]["rig_s"] == 320.0
    kept = json.loads((folder / "out" / "summary.json").read_text())
    assert kept == reported
    assert pq.read_table(folder / "out" / "sweep.parquet").num_rows == 16
    page = (folder / "out" / "sweep.html").read_text()
    (figures,) = re.findall(r'id="figures">(.*?)</script>', page)
    assert set(json.loads(figures)) == {"power", "roc", "confusion", "cases"}
    assert not re.search(r'(src|href)="http', page.split("<script>")[0])
    assert not (folder / "out" / "parts").exists()


def test_being_stopped_keeps_what_there_is_and_says_how_to_go_on(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(setting: Setting, cases: Cases) -> Judged:
        judged = run_chunk(setting, cases)
        os.kill(os.getpid(), signal.SIGTERM)
        return judged

    monkeypatch.setattr(local, "run_chunk", interrupted)
    stopped = rig_sweep("tiny.yaml", "--out", "out")
    assert stopped.return_value == EXIT_STOPPED
    assert "8 of 16 cases are done; rig sweep out --resume" in stopped.output
    monkeypatch.undo()
    monkeypatch.chdir(folder)
    monkeypatch.setattr(running, "_CHUNK_RIG_S", 100.0)
    done = rig_sweep("out", "--resume")
    assert done.return_value == 0
    again = rig_sweep("out", "--resume")  # nothing is left to run; the page is made anew
    assert again.return_value == 0
    assert pq.read_table(folder / "out" / "sweep.parquet").num_rows == 16


def exit_code(*arguments: str) -> int:
    with pytest.raises(SystemExit) as left:
        rig_main(["sweep", *arguments])
    code = left.value.code
    assert isinstance(code, int)
    return code


def test_bad_input_is_reported_and_nothing_is_written(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "bad.yaml").write_text(TEXT.replace("cases: 16", "cases: none"))
    assert exit_code("bad.yaml", "--out", "out") == EXIT_BAD_INPUT
    assert "bad.yaml:3:1 cases: none" in capsys.readouterr().err
    assert exit_code("missing.yaml", "--out", "out") == EXIT_BAD_INPUT
    assert not (folder / "out").exists()
    (folder / "full").mkdir()
    (folder / "full" / "thesis.doc").write_text("x")
    assert exit_code("tiny.yaml", "--out", "full", "--jobs", "1") == EXIT_BAD_INPUT
    assert "holds thesis.doc" in capsys.readouterr().err


def test_a_cluster_without_its_extra_is_bad_input(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "distributed", SimpleNamespace())
    assert exit_code("tiny.yaml", "--cluster", "tcp://127.0.0.1:9") == EXIT_BAD_INPUT
    assert "hydraulic-rig[dask]" in capsys.readouterr().err


def test_a_failing_case_is_reported_and_the_others_are_kept(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from rig.sweep.group import SweepError

    def fails(chunks: Iterator[Cases], setting: Setting, stopped: object) -> Iterator[Judged]:
        yield run_chunk(setting, next(chunks))
        raise SweepError("cases 8, 9: a rig needed too many integration steps throughout")

    monkeypatch.setattr("rig.sweep.run_here", fails)
    assert exit_code("tiny.yaml", "--out", "out", "--jobs", "1") == 1
    assert "cases 8, 9" in capsys.readouterr().err
    assert len(list((folder / "out" / "parts").glob("part-*"))) == 1
