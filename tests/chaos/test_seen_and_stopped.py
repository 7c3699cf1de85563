"""Whatever moves the ram is seen on the live stream with who asked for it, and is stopped there."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from rig.cli.live_stream import stream_of
from rig.control_socket import own_name
from rig.stream.client import StreamClient
from tools.chaos.stage import COMPILE_S, ROOT, Stage

pytestmark = pytest.mark.long

COMMANDS = {
    "homing": "home --rig rig.yaml",
    "calibrating the bypass valves": "calibrate valves --rig rig.yaml --points 2",
    "friction experiment": "identify friction --rig rig.yaml",
    "tuning": "tune rig.yaml",
    "commissioning: first motions": "commission rig.yaml --yes",
    "manual": "jog rig.yaml generator sine amplitude 10mm frequency 0.2Hz",
    "gap of the model": "gap --live --rig rig.yaml --out gap",
}
MOVES = ("homing", "running", "armed", "not homed")
SAFE_S = 5.0


@pytest.mark.parametrize("activity", COMMANDS)
def test_a_command_that_moves_the_ram_is_seen_and_stopped_by_another_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, activity: str
) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    with Stage(tmp_path) as stage:
        shipped = yaml.safe_load((ROOT / "config" / "rigs" / "emulated.yaml").read_text())
        file = tmp_path / "rig.yaml"
        rig = yaml.safe_load(file.read_text()) | {"homing": shipped["homing"]}
        file.write_text(yaml.safe_dump(rig))
        settings = stream_of(str(stage.stream), paced=True)
        assert settings is not None
        streamed = ("--stream", str(stage.stream))
        run = subprocess.Popen(
            [sys.executable, "-m", "rig.cli", *COMMANDS[activity].split(), *streamed],
            cwd=tmp_path, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT, text=True, env=os.environ | {"PYTHONPATH": str(ROOT)},
        )  # fmt: skip
        try:
            with StreamClient(settings) as client:

                def moves() -> bool:
                    assert run.poll() is None
                    if "emulated" not in client.rigs():
                        return False
                    snapshot = client.snapshot("emulated")
                    return snapshot.alive and snapshot.state.get("state") in MOVES

                stage.wait(moves, "the ram to move", COMPILE_S)
                campaign = client.snapshot("emulated").campaign
                assert (campaign["activity"], campaign["begun_by"]) == (activity, own_name())
                assert not client.send("hold", "emulated").accepted
                assert client.send("abort", "emulated", "enough").accepted
                stage.wait(stage.is_safe, "valve at null, bypass shut, pump unloaded", SAFE_S)
            said, _ = run.communicate(timeout=60.0)
        finally:
            run.kill()
            run.communicate()
        assert run.returncode == 3, said
        assert "stopped by local" in said
