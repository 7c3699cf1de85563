"""With a station up, what a terminal starts is seen on the page with its owner, and F9 stops it.

F9 is pressed by somebody else than who has control, in a browser of his own. Each of the eight ways
to drive the rig is tried; without a browser, `test_seen_and_stopped.py` has more of them.
"""

import json
import socket
import time
from collections.abc import Iterator
from contextlib import suppress

import pytest
import yaml
from playwright.sync_api import Page, expect, sync_playwright

from rig.control_socket import own_name
from tools.chaos.lab import Lab
from tools.chaos.stage import COMPILE_S, TEST

from .test_console_and_browser import Desk, lab_of_the_patient

pytestmark = pytest.mark.long

BEGINS_S = 1.0
"""Time in s after F9 within which the ramp to rest begins."""
RAMP_S = 0.5
"""Time in s that the ramp lasts, after which the valve is disabled (docs/safety.md)."""
SHIPPED = 7447
"""Port of the live stream in the shipped profile `loopback`."""
WAVE = "generator sine mean 300mm amplitude 20mm frequency 0.2Hz"
COMMANDS = {
    "home": "home --rig rig.yaml",
    "calibrate": "calibrate valves --rig rig.yaml --points 2",
    "identify": "identify friction --rig rig.yaml",
    "gap --live": "gap --live --rig rig.yaml --out gap",
    "commission": "commission rig.yaml --yes",
    "schedule": "schedule run schedule.yaml",
    "run": "run campaign.yaml --out out",
    "jog": f"jog rig.yaml {WAVE}",
}


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Lab]:
    folder = tmp_path_factory.mktemp("lab")
    with pytest.MonkeyPatch.context() as patch, lab_of_the_patient(folder, patch) as lab:
        campaign = yaml.safe_load((folder / "campaign.yaml").read_text())
        campaign["tests"] = [{"name": "leaks", **TEST, "duration": "300 s"}]
        (folder / "campaign.yaml").write_text(yaml.safe_dump(campaign))
        # Its entry is not due while the tests last: what runs is what somebody has added.
        entry = {"name": "leaks", "campaign": "campaign.yaml", "at": "2100-01-01 06:00"}
        schedule = {"name": "nightly", "runs": "nights", "entries": [entry]}
        (folder / "schedule.yaml").write_text(yaml.safe_dump(schedule))
        # Runs of a schedule have the shipped profile's address.
        with suppress(OSError), socket.create_server(("127.0.0.1", SHIPPED)):
            stream = yaml.safe_load((folder / "stream.yaml").read_text())
            stream["listen"] = [f"tcp/127.0.0.1:{SHIPPED}"]
            (folder / "stream.yaml").write_text(yaml.safe_dump(stream))
        yield lab


@pytest.fixture(scope="module")
def page(lab: Lab) -> Iterator[Page]:
    """Return the page of somebody who has no control."""
    lab.station()
    with sync_playwright() as playwright:
        desk = Desk(lab, playwright)
        desk.serve()
        desk.sit_down()
        yield desk.sit_down("Ben", with_control=False)
        assert desk.browser is not None
        desk.browser.close()


@pytest.mark.parametrize("command", COMMANDS)
def test_what_moves_is_seen_with_its_owner_and_stopped_by_f9(
    lab: Lab, page: Page, command: str
) -> None:
    if command == "schedule" and str(SHIPPED) not in lab.stage.stream.read_text():
        pytest.skip("the shipped profile's address is in use on this machine")
    streamed = () if command == "schedule" else ("--stream", "stream.yaml")
    lab.stage.wait(lab.is_idle, "the station to read the rig", COMPILE_S)
    if command == "schedule":
        added = lab.rig("schedule", "add", "schedule.yaml", "campaign.yaml")
        assert added.wait(timeout=COMPILE_S) == 0, added.communicate()[0]
    run = lab.rig(*COMMANDS[command].split(), *streamed)
    output = lambda: lab.stage.ask(do="status")["daq"]  # noqa: E731
    lab.stage.wait(
        lambda: run.poll() is not None or bool(output()["valve_enabled"]), "the motion", COMPILE_S
    )
    assert run.poll() is None, run.communicate()[0]
    time.sleep(2.0)
    seen = page.locator("body")
    owner = "schedule nightly" if command == "schedule" else own_name()
    expect(seen).to_contain_text(f"egun by {owner}")
    said = page.locator("#rig-state").inner_text()
    at_ns = time.monotonic_ns()
    page.keyboard.press("F9")
    lab.stage.wait(lab.stage.is_safe, "valve at null, bypasses shut, pump unloaded")
    disabled = [
        1e-9 * (event["at_ns"] - at_ns)
        for event in map(json.loads, lab.stage.record.read_text().splitlines())
        if event["event"] == "valve_disabled" and event["at_ns"] > at_ns
    ]
    if command == "schedule":
        # It halts, and waits for somebody who looks at the rig.
        run.terminate()
    told, _ = run.communicate(timeout=COMPILE_S)
    print(f"{command}: {said!r}; valve disabled {disabled[0]:.2f} s after F9")
    assert run.returncode == 3 or command == "schedule", told
    assert disabled[0] < BEGINS_S + RAMP_S
    assert page.locator("#rig-state-word").inner_text() in ("Stopped", "Idle", "Disarmed")
