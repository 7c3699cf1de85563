"""`rig baseline` learns from healthy recordings, and `rig replay` judges by it."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

Invoke = Callable[..., Any]


def test_a_baseline_of_a_healthy_recording_is_used_by_replay(
    invoke: Invoke, short_run: Path
) -> None:
    learnt = invoke("baseline", short_run / "healthy.mcap", "--out", "rig.json")
    assert (learnt.code, learnt.err) == (0, "")
    assert "the rig's own noise was not learnt: that takes 10 min" in learnt.out
    assert Path("rig.json").is_file()
    done = invoke("replay", "--json", "--baseline", "rig.json", short_run / "leak_low.mcap")
    assert done.code == 0
    assert json.loads(done.out)["verdict"] == "external_leakage_1"
    assert done.err == ""
    content = json.loads(Path("rig.json").read_text())
    del content["content_sha256"]
    Path("rig.json").write_text(json.dumps(content | {"baseline_version": 1}))
    old = invoke("replay", "--json", "--baseline", "rig.json", short_run / "leak_low.mcap")
    assert (old.code, old.out) == (0, done.out)
    assert "warning: rig.json: has no checksum" in old.err
    assert "make it anew with rig baseline" in old.err
    Path("rig.json").write_text(json.dumps(content))
    refused = invoke("replay", "--baseline", "rig.json", short_run / "leak_low.mcap")
    assert refused.code == 2
    assert "content_sha256: there is no such key in it" in refused.err


def test_a_baseline_shows_how_far_the_model_may_be_off(invoke: Invoke, short_run: Path) -> None:
    healthy = short_run / "healthy.mcap"
    assert invoke("baseline", healthy, "--model-error", "0.5", "--out", "rig.json").code == 0
    assert json.loads(Path("rig.json").read_text())["model_error"] == 0.5
    refused = invoke("baseline", healthy, "--model-error", "11", "--out", "other.json")
    assert (refused.code, Path("other.json").exists()) == (2, False)
    assert "--model-error" in refused.err


def test_a_leaking_recording_is_refused_and_nothing_written(
    invoke: Invoke, short_run: Path
) -> None:
    done = invoke("baseline", short_run / "leak_low.mcap", "--out", "rig.json")
    assert done.code == 2
    assert "leak_low.mcap: the recording is external_leakage_1" in done.err
    assert not Path("rig.json").exists()


def test_all_that_is_wrong_is_reported_at_once(invoke: Invoke, short_run: Path) -> None:
    done = invoke(
        "baseline", "nowhere.mcap", short_run / "healthy.mcap", "--model", "nominl",
        "--out", "no_folder/rig.json",
    )  # fmt: skip
    assert done.code == 2
    assert "nowhere.mcap" in done.err
    assert "nominal" in done.err
    assert "no_folder" in done.err


def test_a_folder_is_no_file_to_write_a_baseline_to(invoke: Invoke, short_run: Path) -> None:
    done = invoke("baseline", short_run / "healthy.mcap", "--out", short_run)
    assert done.code == 2
    assert "is a directory" in done.err


def test_the_same_recording_does_not_count_twice(invoke: Invoke, short_run: Path) -> None:
    healthy = short_run / "healthy.mcap"
    done = invoke("baseline", healthy, healthy, "--out", "rig.json")
    assert (done.code, Path("rig.json").exists()) == (2, False)
    assert done.err == f"{healthy}: the same samples as {healthy}; give them once\n"


def test_a_baseline_that_is_none_is_named(invoke: Invoke, short_run: Path) -> None:
    Path("rig.json").write_text("{}")
    done = invoke("replay", "--baseline", "rig.json", short_run / "healthy.mcap")
    assert done.code == 2
    assert done.err.startswith("rig.json: not a baseline")
    assert done.out == ""


def test_learning_on_needs_learnt_noise_and_no_factor(invoke: Invoke, short_run: Path) -> None:
    healthy = short_run / "healthy.mcap"
    assert invoke("baseline", healthy, "--out", "rig.json").code == 0
    onto = ("--onto", "rig.json", "--out", "other.json")
    refused = invoke("baseline", healthy, *onto)
    assert (refused.code, Path("other.json").exists()) == (2, False)
    assert "it has no learnt noise to learn on from" in refused.err
    both = invoke("baseline", healthy, *onto, "--model-error", "0.5")
    assert both.code == 2
    assert "--model-error: has no effect with --onto" in both.err
