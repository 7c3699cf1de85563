"""A console or a browser is killed at any moment beside a station, and nobody is told a wrong word.

Neither is part of what drives the rig: what they watch goes on, and what they move by hand rests.
"""

import os
import random
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path

import pytest
import yaml
from playwright.sync_api import Browser, Error, Page, Playwright, expect, sync_playwright

from tools.chaos.lab import JOG, Lab, lab_in, patient
from tools.chaos.stage import COMPILE_S, TEST, free_ports
from tools.pages.readme_picture import browser as chromium

pytestmark = pytest.mark.long

KILLS = 20
WAIT_MS = 60_000
WAVE = "generator sine mean 300mm amplitude 20mm frequency 0.2Hz"
WAY_M = 5e-3
"""Way in m within which the ram rests after the last heartbeat (docs/safety.md)."""
REST_S = 0.25
"""Time in s within which it does."""
SPEED_M_PER_S = 20e-3
"""Speed of hold-to-run in m/s."""
REST_M = 3e-3
"""Distance in m from where it was to go within which the ram rests, with the zero of its homing."""
CREEP_M = 0.5e-3
"""Way in m that the ram creeps at rest within a second or two, 0.3 mm as docs/manual.md has it,
with what is left of the flow's noise."""
WORDS = """() => {
  window.words = [];
  const word = document.getElementById("rig-state-word");
  const note = () => { if (window.words.at(-1) !== word.textContent) window.words.push(word.textContent); };
  new MutationObserver(note).observe(word, { childList: true, characterData: true, subtree: true });
  note();
}"""  # noqa: E501
"""Has a page keep every word that stood at its head, in `words`."""

expect.set_options(timeout=WAIT_MS)


@contextmanager
def lab_of_the_patient(folder: Path, patch: pytest.MonkeyPatch) -> Iterator[Lab]:
    """Yield a lab whose rig is not tripped by a browser beside it on a small machine."""
    patch.setenv("XDG_STATE_HOME", str(folder / "state"))
    with lab_in(folder) as lab:
        rig = yaml.safe_load((folder / "rig.yaml").read_text())
        (folder / "rig.yaml").write_text(yaml.safe_dump(patient(rig)))
        lab.stage.ask(do="inject", fault="pump_watchdog_dead")
        yield lab


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Lab]:
    with lab_of_the_patient(tmp_path, monkeypatch) as lab:
        yield lab


@dataclass
class Desk:
    """A console of a lab, and the browser of its operator.

    Attributes:
        lab: the lab.
        playwright: starts browsers.
        port: port of the console.
        token: token of the console, which stays the same over its restarts.
        console: process of the console.
        browser: the browser that was started last.
    """

    lab: Lab
    playwright: Playwright
    port: int = field(default_factory=lambda: free_ports(1)[0])
    token: str = ""
    console: "subprocess.Popen[str]" = field(init=False)
    browser: Browser | None = None

    def serve(self) -> None:
        """Start the console, and return once it serves its page."""
        self.console = self.lab.rig(
            "console", "--listen", f"127.0.0.1:{self.port}", "--profile", "stream.yaml",
            "--campaign", "campaign.yaml",
        )  # fmt: skip
        assert self.console.stdout is not None
        first = self.console.stdout.readline()
        assert first.startswith("console: http"), first
        self.token = self.console.stdout.readline().split()[1]

    def sit_down(self, name: str = "Anna", *, with_control: bool = True) -> Page:
        """Return the page of somebody, with control unless told, in a browser that lives."""
        if self.browser is None:
            root = ["--no-sandbox"] if os.geteuid() == 0 else []
            self.browser = self.playwright.chromium.launch(
                executable_path=chromium(), args=["--disable-gpu", *root]
            )
        context = self.browser.new_context()
        context.set_default_timeout(WAIT_MS)
        page = context.new_page()
        page.goto(f"http://127.0.0.1:{self.port}/")
        page.fill("[name=name]", name)
        page.fill("[name=token]", self.token)
        page.click("button[type=submit]")
        expect(page.locator("#holder")).to_contain_text("control")
        page.evaluate(WORDS)
        if not with_control:
            return page
        if "you have" not in page.locator("#holder").inner_text():
            page.locator("#holder-button").click()
            taken = page.locator("#dialog").get_by_role("button", name="Take over")
            with suppress(Error):
                taken.click(timeout=1000)
        expect(page.locator("#holder")).to_have_text("you have control")
        return page

    def kill_browser(self, what: str) -> None:
        """Kill the browser's renderers, or all of it."""
        for pid, command in _descendants(os.getpid()):
            is_renderer = "--type=renderer" in command
            is_browser = "chrom" in command.split("\0")[0] and "--type=" not in command
            if is_renderer if what == "renderer" else is_browser:
                with suppress(ProcessLookupError):
                    os.kill(pid, signal.SIGKILL)
        if what == "browser":
            self.browser = None


@pytest.fixture
def desk(lab: Lab) -> Iterator[Desk]:
    """Yield the desk of a lab whose station reads the rig, with a console that serves its page."""
    lab.station()
    with sync_playwright() as playwright:
        desk = Desk(lab, playwright)
        desk.serve()
        yield desk
        if desk.browser is not None:
            with suppress(Error):
                desk.browser.close()


def _descendants(root: int) -> Iterator[tuple[int, str]]:
    """Yield process id and command line of all that a process has started, and these again."""
    parents: dict[int, list[int]] = {}
    for path in Path("/proc").glob("[0-9]*"):
        with suppress(OSError):
            parent = int((path / "stat").read_text().rpartition(")")[2].split()[1])
            parents.setdefault(parent, []).append(int(path.name))
    left = [root]
    while left:
        for pid in parents.get(left.pop(), []):
            left.append(pid)
            with suppress(OSError):
                yield pid, Path(f"/proc/{pid}/cmdline").read_text()


def position_m(lab: Lab) -> float:
    return float(lab.stage.ask(do="status")["plant"]["position"])


def moves_on(lab: Lab) -> bool:
    """Return whether the ram moves within a quarter of the wave's period."""
    at, until = position_m(lab), time.monotonic() + 1.5
    while time.monotonic() < until:
        time.sleep(0.1)
        if abs(position_m(lab) - at) > CREEP_M:
            return True
    return False


def told_of(lab: Lab) -> str:
    """Return the last line of the station's log, and the trip reports of all that has run."""
    reports = [path.read_text() for path in lab.stage.folder.rglob("trip-*.txt")]
    return "\n".join([lab.log[-1]["text"], *reports])


def session_by_hand(lab: Lab, *lines: str) -> Callable[[str], None]:
    """Begin manual mode with these commands; return what gives it further ones."""
    jog = lab.lends(*JOG)
    assert jog.stdin is not None
    stdin = jog.stdin

    def say(line: str) -> None:
        assert jog.poll() is None, jog.communicate()[0]
        stdin.write(f"{line}\n")
        stdin.flush()

    for line in lines:
        say(line)
    return say


def test_a_console_killed_at_any_moment_lets_the_rig_go_on_and_its_page_says_so(
    lab: Lab, desk: Desk
) -> None:
    draw = random.Random(21)
    session_by_hand(lab, "pump high", "home", WAVE)
    page = desk.sit_down()
    lab.stage.wait(lambda: 0.27 < position_m(lab) < 0.33 and moves_on(lab), "the wave", COMPILE_S)
    word = page.locator("#rig-state-word")
    expect(word).to_have_text("In use")
    page.evaluate("window.words.length = 0")
    for _ in range(KILLS):
        time.sleep(draw.uniform(0.0, 2.0))
        desk.console.kill()
        desk.console.wait()
        expect(word).to_have_text("The console does not answer")
        assert moves_on(lab), told_of(lab)
        desk.serve()
        expect(word).to_have_text("In use")
        assert page.locator("#rig-state-why").inner_text().startswith("Manual.")
        assert moves_on(lab), told_of(lab)
    words = set(page.evaluate("window.words"))
    assert words <= {"The console does not answer", "Connecting", "Listening", "In use"}
    page.keyboard.press("F9")
    at = time.monotonic()
    lab.stage.wait(lab.stage.is_safe, "the safe state")
    print(f"safe {time.monotonic() - at:.2f} s after F9")
    expect(page.locator("#banners")).to_contain_text("Stop obeyed")


def test_a_browser_killed_while_it_watches_or_moves_the_ram_leaves_no_motion_of_its_own(
    lab: Lab, desk: Desk
) -> None:
    draw, ways = random.Random(22), []
    say = session_by_hand(lab, "pump high", "home", WAVE)
    lab.stage.wait(lambda: 0.27 < position_m(lab) < 0.33 and moves_on(lab), "the wave", COMPILE_S)
    for number in range(KILLS // 3):
        page = desk.sit_down()
        expect(page.locator("#rig-state-word")).to_have_text("In use")
        time.sleep(draw.uniform(0.0, 2.0))
        desk.kill_browser("renderer" if number % 2 else "browser")
        assert moves_on(lab), "what somebody else moves goes on"
    for number in range(KILLS // 3):
        say("stop")
        lab.stage.wait(lambda: not moves_on(lab), "the ram to rest")
        say("to 300mm")
        lab.stage.wait(lambda: abs(position_m(lab) - 0.3) < REST_M, "the ram in the middle")
        lab.stage.wait(lambda: not moves_on(lab), "the ram to rest")
        rests_m = position_m(lab)
        page = desk.sit_down()
        button = page.locator("[data-hold=out]")
        expect(button).to_be_enabled()
        button.hover()
        page.mouse.down()
        lab.stage.wait(lambda: abs(position_m(lab) - rests_m) > 2e-3, "the ram to run")  # noqa: B023
        time.sleep(draw.uniform(0.0, 2.0))
        at_m, before = position_m(lab), time.monotonic()
        desk.kill_browser("renderer" if number % 2 else "browser")
        late_s = time.monotonic() - before
        time.sleep(1.0)
        ways.append(abs(position_m(lab) - at_m) - late_s * SPEED_M_PER_S)
        assert ways[-1] < WAY_M + CREEP_M
    print("way after the kill", " ".join(f"{1e3 * way:.1f}" for way in ways), "mm")
    page = desk.sit_down()
    expect(page.locator("#rig-state-word")).to_have_text("In use")
    page.keyboard.press("F9")
    lab.stage.wait(lab.stage.is_safe, "the safe state")


def test_a_browser_killed_during_a_start_leaves_a_campaign_that_the_next_page_shows_and_stops(
    lab: Lab, desk: Desk
) -> None:
    draw, took = random.Random(23), []
    campaign = yaml.safe_load((lab.stage.folder / "campaign.yaml").read_text())
    campaign["tests"] = [{"name": "leaks", **TEST, "duration": "120 s"}]
    (lab.stage.folder / "campaign.yaml").write_text(yaml.safe_dump(campaign))
    for number in range(KILLS - 2 * (KILLS // 3)):
        page = desk.sit_down()
        page.locator("[data-do=start]").click()
        page.locator("#dialog").get_by_role("button", name="Start").click()
        time.sleep(draw.uniform(0.0, 8.0))
        asked = page.locator("#toasts").inner_text()
        desk.kill_browser("renderer" if number % 2 else "browser")
        page = desk.sit_down()
        if "is on its way" not in asked and lab.driver() is None:
            # The order may have been lost with the browser; the page then offers the start again.
            with suppress(AssertionError):
                expect(page.locator("[data-do=start]")).to_be_enabled(timeout=10_000)
                assert lab.stage.is_safe()
                continue
        lab.stage.wait(lambda: not lab.stage.is_safe(), "the run to load the pump", COMPILE_S)
        expect(page.locator("#campaign-name")).to_contain_text("chaos")
        assert page.locator("#rig-state-word").inner_text() not in ("Idle", "No rig is heard")
        page.keyboard.press("F9")
        at = time.monotonic()
        lab.stage.wait(lab.stage.is_safe, "the safe state")
        took.append(time.monotonic() - at)
        lab.stage.wait(lab.is_idle, "the station to read the rig")
        expect(page.locator("#rig-state-word")).to_have_text("Idle")
    print("safe after F9", " ".join(f"{each:.2f}" for each in took), "s")
