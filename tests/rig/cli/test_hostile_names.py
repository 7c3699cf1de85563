"""Whatever campaign and tests are called, a run stays in its folder, and its report is text."""

import html
import io
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click
import pytest
import yaml

from rig.cli.screen import Screen
from rig.plain_output import plain_output
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


HOSTILE = "a\x1b[2J\x9b2J\x07\rb\u202ec\td\n"
PLAIN = "a\\u001b[2J\\u009b2J\\u0007\\u000db\\u202ec\td\n"


def test_no_text_that_is_printed_moves_the_cursor_or_turns_a_line_round(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    out, err = io.StringIO(), io.StringIO()
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    with plain_output():
        click.echo(HOSTILE, nl=False, color=True)
        click.echo(HOSTILE, nl=False, color=True, err=True)
        print(json.dumps(HOSTILE, ensure_ascii=False))
    assert out.getvalue().startswith(PLAIN)
    assert err.getvalue() == PLAIN
    assert json.loads(out.getvalue().removeprefix(PLAIN)) == HOSTILE


def test_a_terminal_gets_the_screen_s_own_colours_and_no_others(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stdout", out := Terminal())
    with plain_output():
        screen = Screen()
        screen.print(HOSTILE, style="red", end="")
        screen.print_table(["test"], [["\x1b]0;title\x07"]])
    red, told = "\x1b[31m", out.getvalue()
    assert red in told
    assert not any(obeyed in told for obeyed in ("\x1b[2J", "\x9b", "\u202e", "\x1b]0"))
    assert "]0;title" in told
