"""`rig run --resume` and `rig control`, as a user types them."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.waiting import until

Invoke = Callable[..., Any]

DEADLINE_S = 240.0
CAMPAIGN = """
name: slow
rig: simulated
defaults:
  duration: 5 s
  settle: 0 s
  setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}
tests:
  - name: first
  - name: endless
    duration: 600 s
  - name: last
"""


@pytest.fixture
def running(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """`rig run` at the wall clock in a process of its own, in its first test."""
    (tmp_path / "slow.yaml").write_text(CAMPAIGN)
    with subprocess.Popen(
        [sys.executable, "-m", "rig.cli", "run", "slow.yaml", "--pace", "real", "--out", "out"],
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def await_test(invoke: Invoke, folder: Path, test: str) -> None:
    until = time.monotonic() + DEADLINE_S
    while time.monotonic() < until:
        done = invoke("control", folder, "status")
        if done.code == 0:
            status = json.loads(done.out)
            if status["test"] == test and status["phase"] == "main":
                return
        time.sleep(0.05)
    raise AssertionError(f"{test} never began")


@pytest.mark.long
def test_a_killed_campaign_is_controlled_killed_resumed_and_reported(
    running: subprocess.Popen[str], invoke: Invoke, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    await_test(invoke, out, "first")
    done = invoke("control", out, "note", "first", "light")
    assert (done.code, done.out) == (0, "noted\n")
    await_test(invoke, out, "endless")
    done = invoke("control", out, "set", "gain=80 V/m", "integral_time=1s")
    assert done.code == 0
    assert "gain 50 V/m -> 80 V/m, integral_time none -> 1 s in endless" in done.out
    done = invoke("control", out, "set", "gan=80", "null=5")
    assert done.code == 2
    assert done.err.splitlines() == [
        f"{out}: set gan: is not a known key; did you mean gain?",
        f"{out}: set null: 5 has no unit; write a voltage with its unit, such as 3 V",
    ]
    assert "gain 80 V/m" in json.loads(invoke("control", out, "status").out)["control"]
    busy = invoke("run", "slow.yaml", "--out", out)
    assert busy.code == 2
    assert "a campaign is running in it" in busy.err
    # On a simulated rig a change holds from the next half second on.
    journal = out / "journal.jsonl"
    until(
        lambda: '"kind":"control"' in journal.read_text().replace(" ", ""), "the change to be noted"
    )
    os.kill(running.pid, signal.SIGKILL)
    running.wait()
    gone = invoke("control", out, "pause")
    assert gone.code == 2
    assert gone.err == f"{out}: no campaign is running in it; give the folder of one that is\n"

    text = (tmp_path / "slow.yaml").read_text()
    (tmp_path / "slow.yaml").write_text(text.replace("600 s", "6 s"))
    refused = invoke("run", "--resume", out)
    assert refused.code == 2
    assert "campaign changed since the run began" in refused.err
    (tmp_path / "slow.yaml").write_text(f"# a comment may change\n{text}")
    written = [line for line in (out / "journal.jsonl").read_text().splitlines() if "first" in line]
    assert written
    done = invoke("run", "slow.yaml", "--pace", "fast", "--out", out, "--resume")
    assert "[1/3]" not in done.out
    assert "[2/3] endless" in done.out
    results = json.loads((out / "results.json").read_text())
    assert [test["status"] for test in results["tests"]].count("not_run") == 0
    assert results["tests"][1]["attempts"][0]["status"] == "interrupted"
    assert "first light" in [each["what"] for each in results["history"]]
    report = (out / "report.html").read_text()
    assert "resumed after a kill in endless, main" in report
    assert "endless~1.mcap" in report
    assert "control of endless from" in report


def test_a_test_to_skip_needs_a_request_that_knows_tests(invoke: Invoke, tmp_path: Path) -> None:
    done = invoke("control", tmp_path, "pause", "--test", "one")
    assert done.code == 2
    assert "goes with skip or retry" in done.err


def test_where_no_run_is_there_is_none_to_resume(
    invoke: Invoke, campaign_file: Path, tmp_path: Path
) -> None:
    (tmp_path / "empty").mkdir()
    assert "give the folder of a run" in invoke("run", "--resume", tmp_path / "empty").err
    done = invoke("run", campaign_file, "--resume")
    assert done.code == 2
    assert "runs: holds no unfinished run of short; give its folder: --out DIR\n" in done.err


@pytest.mark.parametrize(
    "arguments",
    [
        ("control", ".", "note", "caf\udce9"),
        ("control", ".", "skip", "--test", "caf\udce9"),
        ("monitor", "--send", "note", "--text", "caf\udce9"),
        ("monitor", "--send", "skip", "--test", "\ud83d"),
    ],
    ids=["note", "test's name", "remark", "half a character"],
)
def test_a_text_that_is_no_utf_8_is_bad_input(invoke: Invoke, arguments: tuple[str, ...]) -> None:
    done = invoke(*arguments)
    assert done.code == 2
    assert "is no UTF-8; write it in UTF-8" in done.err
