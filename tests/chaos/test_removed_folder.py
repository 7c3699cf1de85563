"""A run on the emulated rig whose folder is removed stops within a second and keeps its data."""

import json
import shutil
import time
from pathlib import Path

import pytest

from rig.recording import read_recording
from rig.runner.run_folder.journal import read_journal
from tools.chaos.stage import COMPILE_S, Stage


@pytest.mark.long
def test_a_run_whose_folder_is_removed_leaves_the_rig_safe_and_its_data_beside(
    tmp_path: Path,
) -> None:
    with Stage(tmp_path) as stage:
        stage.begin()
        stage.wait(lambda: (stage.out / "leaks.mcap").exists(), "the recording")
        time.sleep(2.0)
        shutil.rmtree(stage.out)
        removed = time.monotonic()
        stage.wait(lambda: "removed, moved or emptied" in stage.printed, "the operator to be told")
        told_s = time.monotonic() - removed
        stage.wait(lambda: stage.run.poll() is not None, "`rig run` to end", COMPILE_S)
        stage.wait(stage.is_safe, "the safe state")
        kept = tmp_path / "out-kept"
        assert stage.run.returncode == 3, stage.printed
        assert f"kept in {kept}" in stage.printed
        assert told_s < 1.0
        assert not list(kept.glob("trip-*.json"))
        assert read_journal(kept / "journal.jsonl")[-1].kind == "end"
        (test,) = json.loads((kept / "results.json").read_text())["tests"]
        assert test["status"] == "aborted"
        recording = read_recording(kept / "leaks.mcap")
        assert len(recording) * 1e-3 >= test["recorded_s"] > 2.0
        assert (kept / "report.html").is_file()
