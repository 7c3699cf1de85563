"""`rig identify friction` tells friction, its change, and what a motion could not show."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Invoke = Callable[..., Any]


@pytest.fixture
def healthy(invoke: Invoke, campaign_file: Path, tmp_path: Path) -> Path:
    """The recording of ten seconds of a sine."""
    invoke("run", campaign_file, "--out", tmp_path / "run")
    return tmp_path / "run" / "healthy.mcap"


def test_friction_is_told_with_the_change_from_first_to_last(invoke: Invoke, healthy: Path) -> None:
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
    told = json.loads(done.out)
    assert told["spring_stiffness_N_per_m"] == 2e4
    assert told["coulomb"]["value"] is None
    assert "--spring" in told["coulomb"]["needs"]


def test_all_that_is_wrong_is_told_at_once(invoke: Invoke) -> None:
    done = invoke(
        "identify", "friction", "nowhere.csv", "--model", "nominl", "--spring", "2e4 N",
        "--out", "no_folder/page.html",
    )  # fmt: skip
    assert done.code == 2
    assert done.out == ""
    for told in ("nowhere.csv", "nominal", "--spring: 2e4 N", "--contact", "no_folder"):
        assert told in done.err
