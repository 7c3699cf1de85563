"""Fixtures with Chromium, an emulated rig on which a campaign runs, and a console of that rig."""

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
from playwright.sync_api import Browser, Error, Page, expect, sync_playwright

from tools.chaos.lab import patient
from tools.chaos.stage import PATIENCE_S, Stage
from tools.pages.readme_picture import browser as chromium

from .fakes import until
from .site import TOKEN, Site, site_served

WAIT_MS = 60_000
"""ms: how long a test waits for anything on the page; only a failure takes so long."""
ROOT = Path(__file__).parents[3]
WIDTH, HEIGHT = 1400, 1000
# The sine is so slow that the ram stays within its limits even if the machine stalls for a second.
SINE = {"type": "sine", "mean": "0.3 m", "amplitude": "0.06 m", "frequency": "0.2 Hz"}
TESTS = (
    {
        "name": "internal leak, 0.6 L/min",
        # The test is longer than all tests of the console together, and is stopped at the end.
        "duration": "900 s",
        "settle": "0.5 s",
        "setpoint": SINE,
        "faults": [
            {"type": "internal_leakage", "at": "1 s", "flow": "0.6 L/min", "pressure": "2.5 MPa"}
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


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    try:
        path = chromium()
    except ValueError as error:
        pytest.skip(f"{error}")
    with sync_playwright() as playwright:
        # Chromium does not start as root unless its sandbox is switched off.
        arguments = ["--disable-gpu", *(["--no-sandbox"] if os.geteuid() == 0 else [])]
        try:
            opened = playwright.chromium.launch(executable_path=path, args=arguments)
        except Error as error:
            pytest.skip(f"Chromium does not start here: {error.message}")
        yield opened
        opened.close()


def take_control(page: Page, site: Site) -> None:
    """Log Anna in on a page, and take control."""
    page.goto(site.origin)
    page.fill("[name=name]", "Anna")
    page.fill("[name=token]", TOKEN)
    page.keyboard.press("Enter")
    expect(page.locator("#holder")).to_contain_text("control", timeout=WAIT_MS)
    page.locator("#holder-button").click()
    expect(page.locator("#holder")).to_have_text("you have control", timeout=WAIT_MS)


@dataclass
class Served:
    """A running console: its address, its token, its log and its process."""

    url: str
    token: str
    log: list[str]
    process: "subprocess.Popen[str]"

    def enter(self, page: Page, name: str, token: str = "") -> None:
        """Open the console in a page and log in by name, with its token or another one."""
        page.goto(self.url)
        page.fill("[name=name]", name)
        page.fill("[name=token]", token or self.token)
        page.click("button[type=submit]")

    def until_logged(self, text: str) -> None:
        until(lambda: any(text in line for line in list(self.log)), f"{text} in {self.log}")


@pytest.fixture(scope="session")
def leaving() -> Iterator[ExitStack]:
    """Yield a stack of callbacks that wait, at the end of the session, until all servers ended."""
    with ExitStack() as servers:
        yield servers


@pytest.fixture
def site(leaving: ExitStack) -> Iterator[Site]:
    """Yield a console whose stream the test feeds."""
    with site_served(leaving) as site:
        yield site


Serve = Callable[..., Served]


@pytest.fixture(scope="module")
def serve(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Serve]:
    """Yield a function that starts a console in a folder; all end with the module's tests."""
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
            process.wait()
            assert process.stdout is not None
            process.stdout.close()


def _copy(stream: IO[str], log: list[str]) -> None:
    with stream:
        log.extend(iter(stream.readline, ""))


@pytest.fixture(scope="module")
def state(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Set and yield a folder of its own for the keys and tokens of these tests."""
    folder = tmp_path_factory.mktemp("state")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(folder))
        yield folder


@pytest.fixture(scope="module")
def stage(
    state: Path, tmp_path_factory: pytest.TempPathFactory, pytestconfig: pytest.Config
) -> Iterator[Stage]:
    """Yield an emulated rig on which a campaign runs, whose first leak is open."""
    folder = tmp_path_factory.mktemp("stage")
    with Stage(folder, tests=TESTS, plain_report=True) as stage:
        # The picture for the README shows the rig as it is shipped.
        _be_patient(folder, is_slow=not pytestconfig.getoption("--console-picture"))
        # No rig file sets the pump's watchdog, and a browser beside the rig may exceed it.
        stage.ask(do="inject", fault="pump_watchdog_dead")
        stage.begin()
        yield stage


def _be_patient(folder: Path, *, is_slow: bool) -> None:
    """Set long time limits in the rig's files, so that a browser on this machine trips no rig.

    A slow device has no value in most rows, and costs this machine less.
    """
    rig = patient(yaml.safe_load((folder / "rig.yaml").read_text()))
    if is_slow:
        rig["loop"]["slower_device"] = "hold"
        rig["drivers"]["daq"]["rate"] = "250 Hz"
    (folder / "rig.yaml").write_text(yaml.safe_dump(rig))
    stream = yaml.safe_load((folder / "stream.yaml").read_text())
    # After four missing heartbeats, the console shows the rig as dead and disables its buttons.
    (folder / "stream.yaml").write_text(yaml.safe_dump(stream | {"heartbeat": "10 s"}))
    campaign = yaml.safe_load((folder / "campaign.yaml").read_text())
    (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign | {"name": "leaks"}))
