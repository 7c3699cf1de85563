"""`rig identify friction` reports friction, its change, and what a motion could not show."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Invoke = Callable[..., Any]


@pytest.fixture
def healthy(short_run: Path) -> Path:
    """The recording of ten seconds of a sine."""
    return short_run / "healthy.mcap"


def test_friction_is_reported_with_the_change_from_first_to_last(
    invoke: Invoke, healthy: Path
) -> None:
    done = invoke("identify", "friction", healthy, healthy.with_name("leak_low.mcap"))
    assert (done.code, done.err) == (0, "")
    assert "coulomb, N" in done.out
    assert "change from first to last" in done.out
    page = Path("friction.html").read_text()
    assert "<script src" not in page
    assert page.count('class="plot trend"') == 5


def test_json_is_one_object_a_line(invoke: Invoke, healthy: Path) -> None:
    done = invoke("identify", "friction", healthy, healthy, "--json", "--out", "one.html")
    first, second = (json.loads(line) for line in done.out.splitlines())
    assert first["recording"] == str(healthy)
    assert first["name"] == "healthy"
    assert first["coulomb"]["value"] == pytest.approx(1100.0, rel=0.03)
    assert first["change_from_first"] == {}
    assert second["change_from_first"]["coulomb"]["z"] == 0.0
    assert Path("one.html").is_file()


def test_a_spring_that_is_not_there_leaves_nothing_to_identify_and_is_no_bad_input(
    invoke: Invoke, healthy: Path
) -> None:
    done = invoke(
        "identify", "friction", healthy, "--json", "--spring", "2e4 N/m", "--contact", "0.22 m"
    )
    assert done.code == 0
    reported = json.loads(done.out)
    assert reported["spring_stiffness_N_per_m"] == 2e4
    assert reported["coulomb"]["value"] is None
    assert "--spring" in reported["coulomb"]["needs"]


def test_all_that_is_wrong_is_reported_at_once(invoke: Invoke) -> None:
    done = invoke(
        "identify", "friction", "nowhere.csv", "--model", "nominl", "--spring", "2e4 N",
        "--out", "no_folder/page.html",
    )  # fmt: skip
    assert done.code == 2
    assert done.out == ""
    for reported in ("nowhere.csv", "nominal", "--spring: 2e4 N", "--contact", "no_folder"):
        assert reported in done.err


def test_a_dry_run_shows_every_motion_and_moves_nothing(invoke: Invoke, tmp_path: Path) -> None:
    done = invoke("identify", "friction", "--rig", "simulated", "--dry-run")
    assert (done.code, done.err) == (0, "")
    assert done.out.count("break-away at") == 10
    assert "slowing down: 60 s" in done.out
    assert not list(tmp_path.iterdir())


@pytest.mark.long
def test_a_rig_is_identified_by_itself_and_its_model_written(invoke: Invoke) -> None:
    done = invoke("identify", "friction", "--rig", "simulated", "--out", "found")
    assert (done.code, done.err) == (0, "")
    assert "stiction measured" in done.out
    figures = json.loads(Path("found/friction.json").read_text())
    assert figures["parameters"]["friction_asymmetry"]["value"] == pytest.approx(120.0, abs=2.0)
    assert figures["parameters"]["stiction"]["value"] == pytest.approx(2400.0, abs=15.0)
    assert invoke("check", "found/model.yaml").code == 0
    page = Path("found/friction.html").read_text()
    assert "<script src" not in page
    assert 'class="plot places"' in page
    again = invoke("identify", "friction", "--rig", "simulated", "--out", "found")
    assert again.code == 2
    assert "found: is not empty" in again.err
    # The experiment's recordings are recordings like any other.
    sine = "found/friction_sliding/slowing_down.mcap"
    assert invoke("identify", "friction", sine, "--model", "found/model.yaml").code == 0


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        ((), "give either recordings or --rig"),
        (("some.mcap", "--rig", "simulated"), "give either recordings or --rig"),
        (("some.mcap", "--dry-run"), "give --rig"),
        (("--rig", "simulatd"), "simulatd"),
        (("--rig", "emulated", "--pace", "fast"), "runs at the wall clock"),
        (("--rig", "simulated", "--spring", "2e4 N/m"), "--contact"),
    ],
)
def test_an_experiment_that_is_asked_for_wrongly_is_refused(
    invoke: Invoke, arguments: tuple[str, ...], reported: str, tmp_path: Path
) -> None:
    done = invoke("identify", "friction", *arguments)
    assert done.code == 2
    assert reported in done.err
    assert not list(tmp_path.iterdir())
