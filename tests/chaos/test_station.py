"""A station and its clients are killed at any moment, and the rig is safe by its own record."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
import yaml

from rig.cli.live_stream import stream_of
from rig.control_socket import own_name
from rig.stream.client import StreamClient
from tools.chaos.stage import COMPILE_S, ROOT, Stage

pytestmark = pytest.mark.long

KILLS = 10
SAFE_S = 5.0
"""s within which the emulator's record has valve at null, bypasses shut and pump unloaded."""
STREAMED = ("--stream", "stream.yaml")
HOME = ("home", "--rig", "rig.yaml", *STREAMED)
CALIBRATE = ("calibrate", "valves", "--rig", "rig.yaml", "--points", "2", *STREAMED)
RUN = ("run", "campaign.yaml", "--out", "out", "--by", "Bo", *STREAMED)


class Lab:
    """An emulated rig on a stage, and the programs that are started on it."""

    def __init__(self, stage: Stage) -> None:
        self.stage = stage
        self.started: list[subprocess.Popen[str]] = []

    def rig(self, *arguments: str) -> "subprocess.Popen[str]":
        program = subprocess.Popen(
            [sys.executable, "-m", "rig.cli", *arguments],
            cwd=self.stage.folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, start_new_session=True,
            env=os.environ | {"PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        self.started.append(program)
        return program

    def station(self) -> "subprocess.Popen[str]":
        """Start the station, and return once it reads the rig."""
        before = len(self.kept("found"))
        station = self.rig("station", "rig.yaml", *STREAMED)
        self.stage.wait(lambda: len(self.kept("found")) > before, "the station", COMPILE_S)
        return station

    def kept(self, kind: str) -> list[str]:
        path = self.stage.folder / "runs" / "station-emulated" / "station.jsonl"
        lines = path.read_text().splitlines() if path.exists() else []
        return [entry["text"] for entry in map(json.loads, lines) if entry["kind"] == kind]

    def status(self) -> Any:
        asked = self.rig("station", "rig.yaml", "--status", "--json")
        return json.loads(asked.communicate(timeout=60.0)[0])

    def lends(self, *arguments: str) -> "subprocess.Popen[str]":
        """Start a client, and return once the station has left the rig to it."""
        before = len(self.kept("lent"))
        client = self.rig(*arguments)
        self.stage.wait(lambda: len(self.kept("lent")) > before, "the lease", COMPILE_S)
        return client

    def found_again(self, before: int) -> None:
        """Wait until a station has read the rig more often than `before`."""
        self.stage.wait(lambda: len(self.kept("found")) > before, "the station to read the rig")

    def safe_after(self, at: float) -> float:
        """Wait until the rig is safe; return how long that took from `at`, s."""
        self.stage.wait(self.stage.is_safe, "valve at null, bypass shut, pump unloaded", SAFE_S)
        return time.monotonic() - at


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lab]:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with Stage(tmp_path) as stage:
        shipped = yaml.safe_load((ROOT / "config" / "rigs" / "emulated.yaml").read_text())
        file = tmp_path / "rig.yaml"
        rig = yaml.safe_load(file.read_text()) | {"homing": shipped["homing"]}
        file.write_text(yaml.safe_dump(rig))
        lab = Lab(stage)
        try:
            yield lab
        finally:
            for program in reversed(lab.started):
                if program.poll() is None:
                    program.terminate()
            for program in lab.started:
                with _ending(program):
                    program.communicate(timeout=60.0)


@contextmanager
def _ending(program: "subprocess.Popen[str]") -> Iterator[None]:
    """Kill a program that does not end by itself."""
    try:
        yield
    except subprocess.TimeoutExpired:
        program.kill()
        program.communicate()


@pytest.mark.parametrize(
    ("command", "activity", "by"),
    [
        (HOME, "homing", ""),
        (CALIBRATE, "calibrating the bypass valves", ""),
        (RUN, "", "Bo"),
    ],
)
def test_who_drives_is_seen_refuses_others_and_is_stopped_on_the_stream(
    lab: Lab, command: tuple[str, ...], activity: str, by: str
) -> None:
    settings = stream_of(str(lab.stage.stream), paced=True)
    assert settings is not None
    station = lab.station()
    with StreamClient(settings) as client:

        def status() -> Any:
            return client.snapshot("emulated").campaign.get("status")

        def seen() -> Any:
            return "emulated" in client.rigs() and client.snapshot("emulated").alive

        lab.stage.wait(lambda: seen() and status() == "idle", "the idle station")
        assert client.send("abort", "emulated", "").reason == "nothing moves; the rig is disarmed"
        driving = lab.lends(*command)
        moves = ("homing", "running", "armed")
        lab.stage.wait(
            lambda: seen() and client.snapshot("emulated").state.get("state") in moves, "motion"
        )
        campaign = client.snapshot("emulated").campaign
        assert (campaign["activity"], campaign["begun_by"]) == (activity, by or own_name())
        if command is not HOME:
            # Homing would have ended before another program is loaded on a busy machine.
            assert lab.status()["driver"]["by"] == (by or own_name())
            second = lab.rig(*HOME)
            said, _ = second.communicate(timeout=COMPILE_S)
            assert second.returncode == 2, said
            assert f"asked by {by or own_name()}, has the rig since" in said
        assert client.send("abort", "emulated", "enough").accepted
        lab.safe_after(time.monotonic())
        driving.communicate(timeout=60.0)
        assert driving.returncode == 3
        lab.stage.wait(lambda: seen() and status() == "idle", "the idle station again")
    station.send_signal(signal.SIGTERM)
    said, _ = station.communicate(timeout=60.0)
    assert station.returncode == 0, said
    assert lab.stage.is_safe()


def test_clients_killed_at_any_moment_leave_a_safe_rig_that_the_station_takes_back(
    lab: Lab,
) -> None:
    draw, took = random.Random(19), []
    lab.station()
    for number in range(KILLS):
        found = len(lab.kept("found"))
        client = lab.lends(*(HOME if number % 2 else RUN), *(() if number % 2 else ("--resume",)))
        time.sleep(draw.uniform(0.0, 12.0))
        at = time.monotonic()
        client.kill()
        took.append(lab.safe_after(at))
        lab.found_again(found)
        assert len(lab.kept("died")) == number + 1
        assert "OPEN" not in lab.kept("found")[-1]
        assert "LOADED" not in lab.kept("found")[-1]
    print("safe after", " ".join(f"{each:.2f}" for each in took), "s")


def test_a_station_killed_at_any_moment_leaves_a_safe_rig_and_lets_a_client_go_on(
    lab: Lab,
) -> None:
    draw, took = random.Random(20), []
    for number in range(KILLS):
        station = lab.station()
        if number % 2:
            client = lab.lends(*HOME)
            time.sleep(draw.uniform(0.0, 4.0))
            station.kill()
            again = lab.rig("station", "rig.yaml", *STREAMED)
            found = len(lab.kept("found"))
            said, _ = client.communicate(timeout=60.0)
            assert client.returncode == 0, said
            lab.safe_after(time.monotonic())
            lab.found_again(found)
            again.terminate()
            again.communicate(timeout=60.0)
        else:
            time.sleep(draw.uniform(0.0, 2.0))
            at = time.monotonic()
            station.kill()
            took.append(lab.safe_after(at))
    print("safe after", " ".join(f"{each:.2f}" for each in took), "s")
