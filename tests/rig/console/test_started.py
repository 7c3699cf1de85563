"""A campaign that is started from the page runs, outlives the console, and is gone on with."""

import http.client
import json
import socket
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any
from urllib.parse import urlencode, urlsplit

import pytest
import yaml

from rig.configuration.rigs.stream import load_stream
from rig.console.launcher import INTERRUPTED
from rig.console.orders import REASONS
from rig.control_socket import ControlError, ask
from rig.runner.campaign.operator_requests import Request
from rig.stream.client import StreamClient
from tests.waiting import COMPILE_S

from .conftest import ROOT, Serve, Served
from .fakes import until

CAMPAIGN = """
name: short
rig: simulated
model: nominal
tests:
  - name: sine
    duration: 300 s
    settle: 0.1 s
    setpoint: {type: sine, mean: 0.3 m, amplitude: 0.05 m, frequency: 0.5 Hz}
"""


class Operator:
    """Somebody who works the console by plain requests, with control."""

    def __init__(self, console: Served) -> None:
        self.console = console
        self.cookie = ""
        status, headers, _ = self.post(
            "/login", urlencode({"name": "Anna", "token": console.token})
        )
        assert status == 303
        self.cookie = headers["Set-Cookie"].partition(";")[0]
        assert self.order(order="take")["accepted"]

    def order(self, **content: str) -> dict[str, Any]:
        _, _, answer = self.post("/order", json.dumps(content), "application/json")
        return dict(json.loads(answer))

    def post(self, path: str, body: str, kind: str = "") -> tuple[int, Any, str]:
        where = urlsplit(self.console.url)
        connection = http.client.HTTPConnection(where.hostname or "", where.port, timeout=60)
        headers = {"Origin": self.console.url.rstrip("/"), "Cookie": self.cookie}
        connection.request("POST", path, body, headers | {"Content-Type": kind})
        answer = connection.getresponse()
        told = answer.status, answer.headers, answer.read().decode()
        connection.close()
        return told


@pytest.fixture
def runs(tmp_path: Path) -> Iterator[Path]:
    """Return the folder of what is started; whatever a test that failed left running is ended."""
    yield tmp_path / "runs"
    for folder in (tmp_path / "runs").glob("*/"):
        with suppress(ControlError):
            ask(folder, Request.ABORT)


def test_a_campaign_is_started_stopped_and_gone_on_with(
    state: Path, tmp_path: Path, runs: Path, serve: Serve
) -> None:
    profile = yaml.safe_load((ROOT / "config" / "stream" / "loopback.yaml").read_text())
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        where = f"tcp/127.0.0.1:{free.getsockname()[1]}"
    (tmp_path / "here.yaml").write_text(yaml.safe_dump(profile | {"listen": [where]}))
    (tmp_path / "short.yaml").write_text(CAMPAIGN)
    console = serve(tmp_path, "--profile", "here.yaml", "--campaign", "short.yaml")
    anna = Operator(console)
    with StreamClient(load_stream(tmp_path / "here.yaml")) as client:

        def is_running() -> bool:
            if "simulated" not in client.rigs():
                return False
            shot = client.snapshot("simulated")
            return shot.alive and shot.progress.get("time_s", 0.0) > 0.2

        assert anna.order(order="start", name="short")["accepted"]
        until(is_running, "the campaign to run", COMPILE_S)
        again = anna.order(order="start", name="short")
        # Which of them depends on whether the console has heard the run yet.
        assert again["reason"] in (
            "simulated has a campaign running",
            "a campaign that was started here still runs",
        )
        answer = anna.order(order="stop", rig="simulated", text="enough")
        assert answer["accepted"]
        console.until_logged("short has ended: exit code 3, tripped or stopped")
        (folder,) = (path for path in runs.iterdir() if path.is_dir())
        # A machine that is busy for seconds may leave nothing but the signal, which the answer
        # then says; whatever else it says, the journal tells who stopped the run, and why.
        if answer["reason"] != REASONS[INTERRUPTED]:
            assert '"text": "Anna: enough"' in (folder / "journal.jsonl").read_text()
        assert (folder / "sine.mcap").stat().st_size > 1000

        assert anna.order(order="go on", name=folder.name)["accepted"]
        until(is_running, "the campaign to go on", COMPILE_S)
        console.process.kill()
        console.process.wait()
        until(is_running, "the campaign to outlive the console", COMPILE_S)
        assert client.send("abort", "simulated").accepted
        until(lambda: not client.snapshot("simulated").alive, "the campaign to end", COMPILE_S)
    assert [path.name for path in runs.iterdir() if path.is_dir()] == [folder.name]
