"""`rig tune` writes gains that it has proven into a rig file, and keeps the old file."""

import json
from pathlib import Path

import pytest

from rig.cli.models import tune
from rig.configuration import load_rig
from rig.runner.experiments import Tuning
from tests.rig.cli.conftest import Invoke

RIG = """\
name: mine
parent: simulated

# by rig tune, long ago
control:
  null: 0.1 V     # measured once

position_gain: 40 V/m   # kept
"""
CALIBRATED = "calibrations: [pt1.yaml]\n"
PT1 = """\
channel: pressure_1_Pa
transducer: PT-1
date: 2026-03-02
valid_until: 2099-03-02
points: [{reference: 0 MPa, indicated: 0 MPa}, {reference: 20 MPa, indicated: 20.001 MPa}]
"""


@pytest.fixture
def mine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    file = tmp_path / "mine.yaml"
    file.write_text(RIG + CALIBRATED)
    (tmp_path / "pt1.yaml").write_text(PT1)
    return file


def test_the_section_is_written_anew_and_the_old_file_is_kept(invoke: Invoke, mine: Path) -> None:
    done = invoke("tune", "mine.yaml", "--folder", "out")
    assert done.code == 0, done.err
    (steps,) = (line for line in done.out.splitlines() if line.startswith("steps: before "))
    assert ", within 5 % of a step in 0." in steps.split("after")[1]
    (backup,) = mine.parent.glob("mine.yaml.*.bak")
    assert backup.read_text() == RIG + CALIBRATED
    text = mine.read_text()
    assert "long ago" not in text
    assert "position_gain: 40 V/m   # kept" in text
    assert text.count("control:") == 1
    assert load_rig(mine).control.feedforward == "model"
    figures = json.loads((mine.parent / "out" / "tuning.json").read_text())
    assert figures["safe"]
    assert figures["steps"]["steps"]["after"]["overshoot"] < 0.03
    page = (mine.parent / "out" / "tuning.html").read_text()
    for words in (
        "Proposed control", "A ram held at mid stroke stayed within", "degrees are required",
        backup.name, "Rig file: ", "<h2>Calibrations</h2>", "PT-1",
    ):  # fmt: skip
        assert words in page


def test_what_is_not_safe_is_not_written(
    invoke: Invoke, mine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Tuning, "safe", False)
    done = invoke("tune", "mine.yaml", "--folder", "out", "--json")
    assert done.code == tune.EXIT_UNSAFE
    assert json.loads(done.out)["written"] == []
    assert mine.read_text() == RIG + CALIBRATED


def test_a_shipped_rig_stays_as_it_is(invoke: Invoke, mine: Path) -> None:
    done = invoke("tune", "simulated")
    assert done.code == 2
    assert "--out" in done.err


def test_all_bad_input_is_told_at_once(invoke: Invoke, mine: Path) -> None:
    done = invoke("tune", "nowhere.yaml", "--model", "none", "--out", "mine.yaml")
    assert done.code == 2
    assert "nowhere.yaml" in done.err
    assert "none" in done.err
    assert "mine.yaml exists" in done.err


def test_a_dry_run_shows_every_motion_and_moves_nothing(invoke: Invoke, mine: Path) -> None:
    done = invoke("tune", "mine.yaml", "--dry-run")
    assert done.code == 0
    for name in ("strokes with tones", "hold", "steps before", "sine after"):
        assert f"{name}: " in done.out
    assert {path.name for path in mine.parent.iterdir()} == {"mine.yaml", "pt1.yaml"}
