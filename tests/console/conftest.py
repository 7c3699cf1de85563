"""Chromium, an emulated rig with a campaign that runs on it, and a console that watches it."""

import os
import select
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import IO

import pytest
import yaml
from playwright.sync_api import Browser, Error, Page, sync_playwright

from tools.chaos.stage import PATIENCE_S, Stage
from tools.pages.readme_picture import browser as chromium

from .fakes import until
from .site import Site, site_served

WAIT_MS = 60_000
"""How long anything may take that is to be seen; only a failure takes as long."""
ROOT = Path(__file__).parents[2]
WIDTH, HEIGHT = 1400, 1000
# So slow that a machine that stalls for a second does not have the ram run beyond its limits.
SINE = {"type": "sine", "mean": "0.3 m", "amplitude": "0.06 m", "frequency": "0.2 Hz"}
TESTS = (
    {
        "name": "internal leak, 0.6 L/min",
        # Longer than any of this takes; it is stopped.
        "duration": "900 s",
        "settle": "0.5 s",
        "setpoint": SINE,
        "faults": [
            {"type": "internal_leakage", "at": "5 s", "flow": "0.6 L/min", "pressure": "2.5 MPa"}
        ],
        "expect": "internal_leakage",
    },
    {"name": "healthy", "duration": "40 s", "setpoint": SINE},
    {
        "name": "external leak, 0.3 L/min",
        "duration": "40 s",
        "setpoint": SINE,
        "faults": [
            {"type": "external_leakage_1", "at": "9 s", "flow": "0.3 L/min", "pressure": "6.9 MPa"}
        ],
    },
)


LONGEST = {
    # Beside a loop of the chaos suite, which has the other processor.
    "loop": {
        "cpu": 0, "stale_limit": "10 s", "slow_stale_limit": "60 s", "loop_silence": "60 s",
        "field_silence": "60 s", "supervisor_silence": "60 s", "recorder_silence": "600 s",
    },
    "daq": {"watchdog": "1 s", "timeout": "60 s"},
    "bypass": {"timeout": "2 s", "watchdog": "60 s", "margin": "60 s"},
    "drive": {"silence": "60 s", "open_timeout": "60 s", "step_timeout": "60 s", "watchdog": "0 s"},
    "pump": {"silence": "60 s", "load_timeout": "60 s"},
    "meters": {"stale": "10 s"},
}  # fmt: skip
"""The longest times that a rig file may give, by which a rig trips or gives a device up."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    try:
        path = chromium()
    except ValueError as error:
        pytest.skip(f"{error}")
    with sync_playwright() as playwright:
        # As root Chromium does not start in a sandbox of its own.
        arguments = ["--disable-gpu", *(["--no-sandbox"] if os.geteuid() == 0 else [])]
        try:
            opened = playwright.chromium.launch(executable_path=path, args=arguments)
        except Error as error:
            pytest.skip(f"Chromium does not start here: {error.message}")
        yield opened
        opened.close()


@dataclass
class Served:
    """A console that runs."""

    url: str
    token: str
    log: list[str]
    process: "subprocess.Popen[str]"

    def enter(self, page: Page, name: str, token: str = "") -> None:
        """Log in."""
        page.goto(self.url)
        page.fill("[name=name]", name)
        page.fill("[name=token]", token or self.token)
        page.click("button[type=submit]")

    def until_logged(self, text: str) -> None:
        until(lambda: any(text in line for line in list(self.log)), f"{text} in {self.log}")


@pytest.fixture(scope="session")
def leaving() -> Iterator[ExitStack]:
    """Wait for all servers to have ended."""
    with ExitStack() as servers:
        yield servers


@pytest.fixture
def site(leaving: ExitStack) -> Iterator[Site]:
    """Return a console that a test feeds itself."""
    with site_served(leaving) as site:
        yield site


Serve = Callable[..., Served]


@pytest.fixture(scope="module")
def serve(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serve]:
    """Return what starts a console in a folder; all are ended with the module."""
    started: list[subprocess.Popen[str]] = []

    def start(folder: Path, *options: str) -> Served:
        process = subprocess.Popen(
            [sys.executable, "-m", "rig.cli", "console", "--listen", "127.0.0.1:0", *options],
            cwd=folder, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            text=True, env=os.environ | {"PYTHONUNBUFFERED": "1"},
        )  # fmt: skip
        started.append(process)
        assert process.stdout is not None
        assert process.stderr is not None
        log: list[str] = []
        threading.Thread(target=_copy, args=(process.stderr, log), daemon=True).start()
        ready, _, _ = select.select([process.stdout], [], [], PATIENCE_S)
        assert ready, log
        url, token = process.stdout.readline(), process.stdout.readline()
        assert url.startswith("console: "), (url, log)
        return Served(url.split()[1], token.split()[1], log, process)

    yield start
    for process in started:
        process.send_signal(signal.SIGTERM)
        try:
            process.wait(PATIENCE_S)
        finally:
            process.kill()
            process.communicate()


def _copy(stream: IO[str], log: list[str]) -> None:
    with stream:
        log.extend(iter(stream.readline, ""))


@pytest.fixture(scope="module")
def state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Keep keys and tokens of these tests in a folder of their own."""
    folder = tmp_path_factory.mktemp("state")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(folder))
        yield folder


@pytest.fixture(scope="module")
def stage(state: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """Return an emulated rig on which a campaign runs, with its leak open."""
    folder = tmp_path_factory.mktemp("stage")
    with Stage(folder, tests=TESTS) as stage:
        _be_patient(folder)
        # It is the one time limit that no rig file sets; a browser beside the rig may exceed it.
        stage.ask(do="inject", fault="pump_watchdog_dead")
        stage.begin()
        yield stage


def _be_patient(folder: Path) -> None:
    """Have a rig that a browser beside it does not trip: none of this is about its timing."""
    rig = yaml.safe_load((folder / "rig.yaml").read_text())
    for section, longest in LONGEST.items():
        part = rig if section == "loop" else rig["drivers"]
        part[section] |= longest
    (folder / "rig.yaml").write_text(yaml.safe_dump(rig))
    stream = yaml.safe_load((folder / "stream.yaml").read_text())
    # Four of them that are missing have a rig shown as dead, and its buttons disabled.
    (folder / "stream.yaml").write_text(yaml.safe_dump(stream | {"heartbeat": "10 s"}))
    campaign = yaml.safe_load((folder / "campaign.yaml").read_text())
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign | {"name": "leaks"}))
