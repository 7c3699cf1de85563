import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

Invoke = Callable[..., Any]


def test_a_campaign_is_reported_as_it_would_run(invoke: Invoke, campaign_file: Path) -> None:
    done = invoke("check", campaign_file)
    assert done.code == 0
    assert done.err == ""
    assert "2 tests on the rig simulated" in done.out
    assert "leak [low]: 14 s after 0.5 s of settling" in done.out
    assert "fault external_leakage_1 at 8 s" in done.out
    as_json = json.loads(invoke("check", "--json", campaign_file).out)[0]
    assert as_json["text"] == done.out.rstrip("\n")
    leak = as_json["tests"][1]
    assert (leak["duration_s"], leak["settle_s"]) == (14.0, 0.5)
    assert leak["faults"][0].startswith("external_leakage_1 at 8 s")
    assert any(line.startswith("limits ") for line in as_json["rig"])


def test_rigs_and_models_are_checked_by_name_too(invoke: Invoke) -> None:
    done = invoke("check", "simulated", "nominal")
    assert done.code == 0
    assert "rig simulated" in done.out
    assert "model nominal" in done.out


def test_of_several_files_all_problems_are_reported(
    invoke: Invoke, campaign_file: Path, tmp_path: Path
) -> None:
    (tmp_path / "bad.yaml").write_text("name: bad\nrig: simulated\nmodle: nominal\ntests: []\n")
    (tmp_path / "worse.yaml").write_text("name: [\n")
    done = invoke("check", "bad.yaml", campaign_file, "worse.yaml", "nowhere")
    assert done.code == 2
    assert "bad.yaml:3:1 modle: is not a known key; did you mean model?" in done.err
    assert "bad.yaml:4:1 tests:" in done.err
    assert "worse.yaml:" in done.err
    assert "nowhere" in done.err
    assert "campaign short" in done.out


def test_a_problem_that_files_share_is_reported_once(
    invoke: Invoke, campaign_file: Path, tmp_path: Path
) -> None:
    (tmp_path / "broken.yaml").write_text("name: broken\nparent: simulated\nlimts: 3\n")
    text = campaign_file.read_text().replace("rig: simulated", "rig: ./broken.yaml")
    for name in ("a.yaml", "b.yaml"):
        (tmp_path / name).write_text(text)
    done = invoke("check", "a.yaml", "b.yaml")
    assert done.code == 2
    assert done.err.count("limts") == 1


def test_a_campaign_can_be_checked_against_another_rig(
    invoke: Invoke, campaign_file: Path, tmp_path: Path
) -> None:
    (tmp_path / "bare.yaml").write_text("name: bare\nparent: simulated\nbypass_valves: {}\n")
    done = invoke("check", campaign_file, "--rig", "bare.yaml")
    assert done.code == 2
    assert "the rig bare lacks" in done.err
