"""`rig station`: what it refuses, what it tells of itself, and the service it writes."""

import json
import os
from pathlib import Path

import pytest

from rig.configuration import load_rig
from rig.supervisor.leases.keeper import Keeper
from rig.surviving import Surviving
from tests.rig.cli.conftest import Invoke


@pytest.fixture(autouse=True)
def _alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have nobody else's station found."""
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))


def test_a_simulated_rig_has_no_station(invoke: Invoke) -> None:
    done = invoke("station", "simulated")
    assert done.code == 2
    assert "backend: hardware" in done.err


@pytest.mark.parametrize(
    ("options", "said"),
    [(("--json",), "goes with --status"), (("--status", "--unit"), "give one of them")],
)
def test_options_that_say_nothing_together_are_refused(
    invoke: Invoke, options: tuple[str, ...], said: str
) -> None:
    done = invoke("station", "emulated", *options)
    assert done.code == 2
    assert said in done.err


def test_a_rig_without_a_station_says_so(invoke: Invoke) -> None:
    done = invoke("station", "emulated", "--status")
    assert done == (1, "emulated: no station of this user; start one: rig station RIG\n", "")
    assert json.loads(invoke("station", "emulated", "--status", "--json").out) is None


@pytest.mark.parametrize(("state", "code"), [("idle", 0), ("no devices", 3)])
def test_a_station_tells_its_state_to_people_and_programs(
    invoke: Invoke, state: str, code: int
) -> None:
    with Keeper(load_rig("emulated"), Surviving("the socket", print)) as keeper:
        keeper.stands(state, "what it does")
        done = invoke("station", "emulated", "--status")
        assert done.code == code
        assert f"station is process {os.getpid()}" in done.out
        assert "state: what it does" in done.out
        told = json.loads(invoke("station", "emulated", "--status", "--json").out)
        assert (told["state"], told["driver"]) == (state, None)
        second = invoke("station", "emulated")
        assert second.code == 2
        assert f"its station is the process {os.getpid()} already" in second.err


def test_the_service_starts_this_station_in_this_folder(invoke: Invoke, tmp_path: Path) -> None:
    done = invoke("station", "emulated", "--unit", "--stream", "100%.yaml")
    assert done.code == 0
    assert f"WorkingDirectory={tmp_path}\n" in done.out
    assert "station emulated --model nominal --runs runs --stream 100%%.yaml\n" in done.out
    assert "TimeoutStopSec=60\n" in done.out
