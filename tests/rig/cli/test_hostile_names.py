"""Whatever campaign and tests are called, a run stays in its folder, and its report is text."""

import html
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import yaml

from rig.runner.run_folder.directory import recording_names

Invoke = Callable[..., Any]

NAMES = ("../../outside", "/etc/outside", "<script>alert(1)</script>")


def test_a_run_writes_to_its_own_folder_only_and_its_report_escapes_what_it_is_given(
    invoke: Invoke, tmp_path: Path
) -> None:
    inner = tmp_path / "a" / "b"
    inner.mkdir(parents=True)
    test = {
        "duration": "5 s",
        "setpoint": {"type": "sine", "mean": "0.3 m", "amplitude": "0.1 m", "frequency": "1 Hz"},
    }
    tests = [{"name": name, **test} for name in NAMES]
    content = {"name": "../../outside", "rig": "simulated", "tests": tests}
    (inner / "names.yaml").write_text(yaml.safe_dump(content))
    done = invoke("run", "a/b/names.yaml", "--pace", "fast")
    assert done.code in (0, 1), done.err
    (run,) = (tmp_path / "runs").iterdir()
    written = {path for path in tmp_path.rglob("*") if path.is_file()}
    assert {path.parent for path in written - {inner / "names.yaml"}} == {run}
    assert {path.name for path in run.glob("*.mcap")} == set(recording_names(NAMES))
    results = json.loads((run / "results.json").read_text())
    assert [each["name"] for each in results["tests"]] == list(NAMES)
    page = (run / "report.html").read_text()
    assert html.escape("<script>alert(1)</script>") in page
    assert "<script>alert(1)" not in page
    assert "<script>alert(1)" not in (run / "junit.xml").read_text()
