"""A campaign that is killed again and again loses and repeats no test; `make chaos` kills more."""

import os
import random
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from rig.cli import main
from rig.recording import read_recording
from rig.runner.run_folder.journal import JOURNAL
from tools.chaos.records import finished_in, record_problems, standing_in, told_problems

TESTS = 4
CAMPAIGN = """
name: killed
rig: simulated
defaults:
  duration: 5 s
  settle: 0 s
  setpoint: {type: sine, mean: 0.3 m, amplitude: 0.1 m, frequency: 0.5 Hz}
tests:
"""
DEADLINE_S = 240.0


KILLS = 2


def start(folder: Path, out: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", "rig.cli", "run", "killed.yaml", "--out", out, "--resume"],
        cwd=folder,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
    )


@pytest.fixture(scope="module")
def campaign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the campaign, and in `whole` its run that nobody killed."""
    folder = tmp_path_factory.mktemp("campaign")
    names = "".join(f"  - name: test {number}\n" for number in range(TESTS))
    (folder / "killed.yaml").write_text(CAMPAIGN + names)
    with pytest.raises(SystemExit) as done:
        main(["run", str(folder / "killed.yaml"), "--out", str(folder / "whole")])
    assert done.value.code in (0, 1)
    return folder


def kill_at(process: subprocess.Popen[bytes], journal: Path, size: int) -> bool:
    """Kill a run once its journal has a size; return whether it was still there."""
    until = time.monotonic() + DEADLINE_S
    while process.poll() is None and time.monotonic() < until:
        if journal.exists() and journal.stat().st_size >= size:
            os.kill(process.pid, signal.SIGKILL)
            break
        time.sleep(1e-3)
    assert process.stderr is not None
    with process.stderr:
        process.wait()
    return process.returncode == -signal.SIGKILL


def test_killed_at_random_points_a_campaign_loses_and_repeats_no_finished_test(
    campaign: Path,
) -> None:
    random_ = random.Random(1)
    out = campaign / "out"
    before: list[dict[int, Any]] = []
    places: list[str] = []
    size = 0
    for _ in range(KILLS):
        # From what there is on: every kill comes later than the one before.
        size += random_.randrange(1, 2500)
        assert kill_at(start(campaign, "out"), out / JOURNAL, size)
        before.append(finished_in(out))
        places.append(standing_in(out).where)
        size = (out / JOURNAL).stat().st_size
    process = start(campaign, "out")
    _, error = process.communicate(timeout=DEADLINE_S)
    assert process.returncode in (0, 1), error
    assert record_problems(out, before, TESTS) == []
    assert told_problems(out, places) == []
    for number in range(TESTS):
        one, other = (
            read_recording(campaign / run / f"test_{number}.mcap") for run in ("out", "whole")
        )
        assert one.content_hash() == other.content_hash()


def test_what_is_lost_or_repeated_is_noticed(campaign: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    shutil.copytree(campaign / "whole", out)
    known = finished_in(out)
    assert record_problems(out, [known], TESTS) == []
    assert record_problems(out, [{0: {"name": "another"}}], TESTS) == [
        "test 0, finished before kill 1, was lost or changed"
    ]
    assert record_problems(out, [], TESTS + 1) == [f"test {TESTS} was not finished"]
    content = (out / "test_1.mcap").read_bytes()
    (out / "test_1.mcap").write_bytes(content[: len(content) // 2])
    (problem,) = record_problems(out, [known], TESTS)
    assert problem.startswith("test 1: ")


def test_a_kill_that_results_and_report_do_not_tell_of_is_noticed(campaign: Path) -> None:
    assert told_problems(campaign / "whole", []) == []
    (problem,) = told_problems(campaign / "whole", ["test 3, main"])
    assert problem == "the results tell [], not ['resumed after a kill in test 3, main']"
