"""`rig leak-test` on the simulated rig with blocking valves."""

import json
from pathlib import Path

import click
import pytest

from rig.cli.application import application


def run(*arguments: str) -> int:
    code = application.main(["leak-test", *arguments], standalone_mode=False)
    return int(code)


@pytest.fixture
def leaking(tmp_path: Path) -> Path:
    """A rig file: the shipped `locked`, with 0.0015 L/min out of chamber 2 at 10 MPa."""
    text = (Path(__file__).parents[4] / "config/rigs/locked.yaml").read_text()
    path = tmp_path / "leaking.yaml"
    path.write_text(
        text + "plant: {model: nominal, effects: {external_leakage_2: 7.9e-12 m^3/(s Pa^0.5)}}\n"
    )
    return path


def test_a_tight_rig_is_healthy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("locked", "--json", "--folder", str(tmp_path / "out")) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["leaks"] == []
    assert found["duration_s"] < 35.0
    assert (tmp_path / "out" / "leak_test.html").exists()


def test_a_leak_is_named_and_the_exit_code_says_so(
    leaking: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(str(leaking), "--folder", str(tmp_path / "out")) == 1
    written = json.loads((tmp_path / "out" / "leak_test.json").read_text())
    assert written["leaks"] == ["external_leakage_2"]
    low, high = written["places"]["external_leakage_2"]["interval_95_L_per_min"]
    assert low < 0.0015 < high
    assert "chamber 2, out" in capsys.readouterr().out


def test_a_rig_without_blocking_valves_is_told_what_a_motion_can_find() -> None:
    with pytest.raises(Exception, match="has no blocking valves"):
        run("simulated")


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("emulated_locked", "--seed", "1"), "emulated_locked is not simulated"),
        (("locked", "--stream", "default"), "locked is simulated, and not streamed"),
    ],
)
def test_an_option_that_means_nothing_for_the_rig_is_refused(
    arguments: tuple[str, ...], said: str, tmp_path: Path
) -> None:
    with pytest.raises(click.BadParameter, match=said):
        run(*arguments, "--folder", str(tmp_path / "out"))
    assert not (tmp_path / "out").exists()
