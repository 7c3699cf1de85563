"""State, outcome and reason stand at the top of the page, and nothing on it says otherwise."""

import math
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from datetime import datetime
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from .conftest import WAIT_MS, take_control
from .fakes import RUNNING, until
from .site import Site

expect.set_options(timeout=WAIT_MS)
SIZES = {"desk": {"width": 1280, "height": 720}, "phone": {"width": 420, "height": 900}}
TRIP = {"by": "loop", "cause": "ESTOP_OPEN", "sentence": "the emergency stop is open",
        "remedy": "make the rig safe, release the button, press reset", "after_s": 0.0}  # fmt: skip
TRIPPED = {"trips": {"first_out": [TRIP], "confirmed": {"valve null": 0.001}}}
REASON = "the rig: the emergency stop is open: make the rig safe and release its button"
EARLIER, LATER = 10**18, 10**18 + 10**12
HEALTHY = {"verdict": "healthy", "test": 2, "name": "leak", "time_s": 40.0}

Site_ = Callable[[Site], None]


def a_test(name: str, status: str, **more: Any) -> dict[str, Any]:
    return {"name": name, "expect": "healthy", "status": status, "verdict": "healthy", **more}


def campaign(*statuses: str, **more: Any) -> dict[str, Any]:
    names = ("healthy", "leak", "late")
    tests = [a_test(name, status) for name, status in zip(names, statuses, strict=False)]
    return {**RUNNING.campaign, "tests": tests, **more}


OF_THE_STATION = campaign(status="idle", activity="idle: nothing drives", tests=[])


def rig(**changed: Any) -> Site_:
    return lambda site: site.client.shots.update(bench=replace(RUNNING, **changed))


def ended(*statuses: str, health: dict[str, Any] | None = None, **more: Any) -> Site_:
    over = campaign(*statuses, status="ended", **more)
    return rig(alive=False, campaign=over, health=health or {}, decision=HEALTHY, age_s=9.0)


def in_state(state: str, *statuses: str, **more: Any) -> Site_:
    return rig(state={"state": state}, campaign=campaign(*(statuses or ("running", "")), **more))


def launched(last: dict[str, Any] | None, before: Site_) -> Site_:
    told = {"name": "leaks", "folder": "leaks-2", "started_ms": LATER // 10**6, "reason": "",
            "ending": "", "said": "", "exit_code": None}  # fmt: skip
    offer = {"name": "leaks", "description": "", "tests": 2, "rig": "bench"}

    def set_up(site: Site) -> None:
        site.console.feed.listens_until = 0.0
        before(site)
        site.console.launcher.content = lambda: {  # type: ignore[method-assign]
            "allowed": True, "offers": [offer], "unfinished": [],
            "last": None if last is None else told | last,
        }  # fmt: skip

    return set_up


def acknowledged(before: Site_) -> Site_:
    at = datetime(2026, 11, 28, 12, 0, 5).astimezone().isoformat()
    seen = {"folder": "out", "campaign": "leaks", "by": "Ada", "at": at, "text": "it was me"}

    def set_up(site: Site) -> None:
        launched(None, before)(site)
        told = site.console.launcher.content() | {"seen": [seen]}
        site.console.launcher.content = lambda: told  # type: ignore[method-assign]

    return set_up


def nobody(site: Site) -> None:
    site.client.shots.clear()


def nobody_yet(site: Site) -> None:
    site.client.shots.clear()
    site.console.feed.listens_until = math.inf


def compiles_for_two_hours(site: Site) -> None:
    """Set up a station that has been compiling for two hours by now, not when this was imported."""
    since_ns = time.time_ns() - 7200 * 10**9
    rig(
        progress={},
        state={"state": "connecting", "compiles": "wire_ticks", "compiles_since_ns": since_ns},
        campaign=OF_THE_STATION,
    )(site)


COMPILING = "loop: being compiled, once for each version of this program"
STATES: dict[str, tuple[Site_, str, str, str, set[str]]] = {
    "no rig": (launched(None, nobody), "off", "No rig is heard", "start a campaign", {"start"}),
    "no rig yet": (nobody_yet, "off", "Listening", "only begun to listen", {"start"}),
    "compiling": (
        launched({"said": COMPILING}, nobody), "warn", "Starting leaks", "being compiled", set()
    ),
    "idle": (rig(campaign={}, progress={}), "off", "Idle", "No campaign runs", {"start"}),
    "read by its station": (
        rig(progress={}, campaign=OF_THE_STATION),
        "off", "Idle", "The station reads the rig; nothing drives.", {"start"},
    ),
    "being read by its station": (
        rig(progress={}, state={"state": "connecting"},
            campaign=OF_THE_STATION),
        "off", "Idle", "The station opens the devices; nothing drives.", {"start"},
    ),
    "being compiled by its station": (
        compiles_for_two_hours,
        "off", "Idle", ", on its way for 2.0 h. Nothing drives.", {"start"},
    ),
    "compiled by its station, which goes on": (
        rig(alive=False, age_s=2.0, progress={}, campaign=campaign(
            status="ended", activity="idle: nothing drives", tests=[], exit_code=0,
            reason="the station's program is compiled")),
        "off", "Idle", "The station's program is compiled.", {"start"},
    ),
    "told of by its station before it is heard": (
        rig(alive=False, age_s=None, progress={},
            campaign=OF_THE_STATION),
        "off", "Idle", "The station opens the devices; nothing drives.", {"start"},
    ),
    "not to be read by its station": (
        rig(alive=False, age_s=9.0, progress={}, campaign=campaign(
            status="ended", activity="idle: nothing drives", tests=[], exit_code=3,
            reason="daq: does not answer")),
        "warn", "Idle", "The station cannot read the rig: daq: does not answer.", {"start"},
    ),
    "refused by a device": (
        ended("", "", exit_code=2, reason="daq: does not answer"), "bad", "Not started",
        "daq: does not answer.", {"start"},
    ),
    "acknowledged": (
        acknowledged(ended("tripped", "", exit_code=3, reason=REASON, health=TRIPPED)), "bad",
        "Tripped", "Acknowledged by Ada at 12:00:05: it was me.", {"start"},
    ),
    "left by its station": (
        rig(alive=False, age_s=9.0, progress={}, campaign=campaign(
            status="ended", activity="idle: nothing drives", tests=[], exit_code=0)),
        "off", "Idle", "The station has left the rig", {"start"},
    ),
    "left by its station to somebody": (
        rig(alive=False, age_s=2.0, progress={}, campaign=campaign(
            status="ended", activity="idle: nothing drives", tests=[], exit_code=0,
            hands_over="homing, asked by Bo")),
        "warn", "Changing hands", "leaves the rig to homing, asked by Bo. Until", {"start"},
    ),
    "left to somebody who never came": (
        rig(alive=False, age_s=90.0, progress={}, campaign=campaign(
            status="ended", activity="idle: nothing drives", tests=[], exit_code=0,
            hands_over="homing, asked by Bo")),
        "off", "Idle", "The station has left the rig", {"start"},
    ),
    "told of before it is heard": (
        rig(alive=False, age_s=None, campaign=campaign("", "")), "warn", "Connecting", "opened",
        {"start"},
    ),
    "connecting": (
        in_state("connecting", "", ""), "warn", "Connecting", "opened", {"hold", "skip"}
    ),
    "arming": (
        in_state("arming", "", ""), "warn", "Arming", "press reset at the rig", {"hold", "skip"}
    ),
    "homing": (
        in_state("homing", "", ""), "warn", "Homing", "stroke end", {"hold", "skip"}
    ),
    "running": (
        in_state("running"), "live", "Running", "1 of 1: healthy", {"hold", "skip", "retry"}
    ),
    "running, begun by somebody": (
        in_state("running", begun_by="Bo"), "live", "Running", "1 of 1: healthy. Begun by Bo.",
        {"hold", "skip", "retry"},
    ),
    "homing asked for": (
        in_state("homing", name="homing", activity="homing", begun_by="Bo", tests=[]), "warn",
        "Homing", "stroke end. Begun by Bo.", set(),
    ),
    "moved for the first time": (
        in_state("homing", name="commissioning: first motions", begun_by="Bo", tests=[],
                 activity="commissioning: first motions"),
        "warn", "First motions", "The ram makes small moves", set(),
    ),
    "calibrating": (
        rig(progress={}, campaign=campaign(
            name="calibrating", activity="calibrating", begun_by="Bo", tests=[])),
        "live", "In use", "Calibrating. Begun by Bo.", set(),
    ),
    "tuning": (
        in_state("running", activity="tuning", begun_by="Bo"), "live", "Running",
        "Tuning: motion 1 of 1: healthy. Begun by Bo.", set(),
    ),
    "moved by hand": (
        in_state("running", name="manual", activity="manual", begun_by="Bo", tests=[],
                 motion="generator sine"),
        "live", "In use", "Manual: the ram moves (wave, sine). Begun by Bo.", set(),
    ),
    "by hand, at rest": (
        in_state("armed", name="manual", activity="manual", begun_by="Bo", tests=[]), "live",
        "In use", "Manual: the ram is at rest. Begun by Bo.", set(),
    ),
    "homing stopped": (
        rig(alive=False, age_s=9.0, campaign=campaign(
            status="ended", activity="homing", tests=[], exit_code=3, reason="stopped by Ben")),
        "warn", "Stopped", "Homing ended early: stopped by Ben.", {"start"},
    ),
    "homed": (
        rig(alive=False, age_s=9.0, campaign=campaign(
            status="ended", activity="homing", begun_by="Bo", tests=[], exit_code=0)),
        "good", "Ended", "Homing came to its end. Begun by Bo.", {"start"},
    ),
    "homed and not begun": (
        in_state("armed", "", ""), "live", "Before the first test", "leaks: 0 of 2 tests done.",
        {"hold", "skip"},
    ),
    "between tests": (
        in_state("armed", "passed", ""), "live", "Between tests", "leaks: 1 of 2 tests done.",
        {"hold", "skip", "retry"},
    ),
    "left after a stop before its first test": (
        rig(state={"state": "disarmed", "before": "ramping down"}, campaign=campaign("", "")),
        "warn", "Disarmed", "The rig is left: the valve", {"hold", "skip"},
    ),
    "gone on with and left after a stop": (
        rig(state={"state": "disarmed", "before": "ramping down"},
            campaign=campaign("passed", "", resumed=True)),
        "warn", "Disarmed", "The rig is left: the valve", {"hold", "skip", "retry"},
    ),
    "gone on with and disarmed": (
        rig(state={"state": "disarmed", "before": "connecting"},
            campaign=campaign("passed", "", resumed=True)),
        "warn", "Disarmed", "Connected;", {"hold", "skip", "retry"},
    ),
    "unloaded by hand": (
        rig(state={"state": "disarmed", "before": "ramping down"},
            campaign=campaign(name="manual", activity="manual", begun_by="Bo", tests=[])),
        "warn", "Disarmed", "The valve is at null and disabled. Manual.", set(),
    ),
    "closed and not ended yet": (
        in_state("off", "passed", "aborted"), "warn", "Disarmed", "its devices are closed",
        {"acknowledge", "hold", "retry"},
    ),
    "to be held": (
        in_state("running", pausing=True, paused_by="Bo"), "warn", "Running, to be held",
        "after it, as Bo has asked;",
        {"acknowledge", "resume", "skip", "retry"},
    ),
    "held": (
        in_state("armed", "passed", "", pausing=True, paused_by="Bo"), "warn", "Held",
        "Bo has asked for it; Resume goes on",
        {"acknowledge", "resume", "skip", "retry"},
    ),
    "held by a condition": (
        in_state("armed", "passed", "", held=["supply_pressure_Pa has no reading"]), "warn",
        "Held", "between tests; 1 of 2 tests done. supply_pressure_Pa has no reading.",
        {"acknowledge", "hold", "skip", "retry"},
    ),
    "held by a limit": (
        rig(state={"state": "holding"},
            health={"action": "hold", "sentence": "position_m is above its limit"}),
        "bad", "Held by the interlock", "position_m is above its limit.", {"hold", "skip", "retry"},
    ),
    "tripped": (
        rig(state={"state": "tripped"}, health=TRIPPED), "bad", "Tripped", "press reset. First",
        {"acknowledge"},
    ),
    "aborted": (
        ended("aborted", "", exit_code=3, reason="Anna: enough"), "warn", "Stopped",
        "By Anna: enough. 2 of 2 tests did not come to their end.", {"start"},
    ),
    "ended by a trip": (
        ended("tripped", "", exit_code=3, reason="a trip", health=TRIPPED), "bad", "Tripped",
        "the emergency stop is open. Remedy: make the rig safe", {"start"},
    ),
    "not started": (
        ended("", "", exit_code=3, reason=REASON), "bad", "Not started",
        "the emergency stop is open: make the rig safe and release its button.", {"start"},
    ),
    "stopped while it homed before its first test": (
        ended("", "", exit_code=3, reason="Ben"), "warn", "Stopped", "By Ben.", {"start"},
    ),
    "failed start after a trip": (
        launched(
            {"exit_code": 2, "reason": "daq: nobody answers; switch it on"},
            ended("tripped", "", exit_code=3, reason="a trip", health=TRIPPED),
        ),
        "bad", "leaks did not start", "daq: nobody answers; switch it on.", {"start"},
    ),
    "failed going on in the folder that is shown": (
        launched(
            {"exit_code": 3, "ending": "exit code 3, tripped or stopped"},
            ended("tripped", "", exit_code=3, reason="a trip", health=TRIPPED, directory="leaks-2"),
        ),
        "bad", "leaks did not start", "exit code 3, tripped or stopped.", {"start"},
    ),
    "all passed": (
        ended("passed", "passed", exit_code=0), "good", "Ended, all passed",
        "2 tests came out as expected.", {"start"},
    ),
    "failed": (
        ended("passed", "failed", exit_code=1), "bad", "Ended, 1 of 2 tests failed", "leak.",
        {"start"},
    ),
}  # fmt: skip


@pytest.fixture
def come(browser: Browser, site: Site) -> Iterator[Callable[[str, Site_], Page]]:
    """Set a console up, and return the page of somebody who has control, on a screen of a size."""
    opened: list[Page] = []

    def come(size: str, set_up: Site_) -> Page:
        launched(None, lambda site: None)(site)
        set_up(site)
        context = browser.new_context(viewport=SIZES[size])  # type: ignore[arg-type]
        context.set_default_timeout(WAIT_MS)
        page = context.new_page()
        opened.append(page)
        take_control(page, site)
        return page

    yield come
    for page in opened:
        page.context.close()


@pytest.mark.parametrize("size", SIZES)
def test_state_outcome_and_reason_stand_above_the_fold(
    come: Callable[[str, Site_], Page], site: Site, size: str
) -> None:
    page = come(size, nobody)
    for state, (set_up, tone, word, why, enabled) in STATES.items():
        launched(None, lambda site: None)(site)
        set_up(site)
        expect(page.locator("#rig-state-word"), state).to_have_text(word)
        expect(page.locator("#rig-state-why"), state).to_contain_text(why)
        expect(page.locator("#rig-state"), state).to_have_class(f"banner {tone}")
        # What may be pressed does not depend on the screen.
        buttons = ("start", "hold", "resume", "skip", "retry", "acknowledge")
        for button in buttons if size == "desk" else ():
            where = expect(page.locator(f"[data-do={button}]"), f"{button} when {state}")
            where.to_be_enabled() if button in enabled else where.to_be_disabled()
        if tone == "bad":
            expect(page.locator("#verdict.good"), state).to_have_count(0)
        height, width = SIZES[size]["height"], SIZES[size]["width"]
        assert lowest(page, "#rig-state") <= 0.5 * height, state
        assert lowest(page, "#stop") <= height + 1, state
        assert page.evaluate("document.documentElement.scrollWidth") <= width, state
        pictures = os.environ.get("STANDING_PICTURES")
        if pictures:
            page.screenshot(path=Path(pictures) / f"{size}-{state.replace(' ', '_')}.png")


def test_a_trip_that_nobody_has_acknowledged_stands_also_after_another_use_without_a_station(
    come: Callable[[str, Site_], Page], site: Site
) -> None:
    at = datetime(2026, 11, 28, 12, 0, 5).astimezone().isoformat()
    trip = {"folder": "old", "campaign": "night", "reason": "a trip", "at": at, "on": "bench"}
    unseen = [trip, trip | {"folder": "older"}, trip | {"folder": "stopped", "reason": "Bo"},
              trip | {"folder": "other", "on": "other"}]  # fmt: skip
    rig()(site)
    site.client.shots["other"] = replace(RUNNING, rig="other", alive=False, age_s=9.0)
    page = come("phone", lambda site: None)
    launched(None, lambda site: None)(site)
    content = site.console.launcher.content() | {"unseen": unseen}
    site.console.launcher.content = lambda: content  # type: ignore[method-assign]
    asked: list[tuple[str, ...]] = []
    site.console.launcher.acknowledge = lambda *given: asked.append(given)  # type: ignore[method-assign]
    expect(page.locator("#rig-last-word")).to_have_text("Tripped before")
    expect(page.locator("#rig-last-why")).to_have_text(
        "night (old) tripped at 12:00:05. So did 1 before it. Nobody has acknowledged that."
    )
    expect(page.locator("#rig-state-word")).to_have_text("Running")
    page.locator("#rig-last-seen").click()
    page.keyboard.type("the hose")
    page.keyboard.press("Enter")
    until(lambda: len(asked) == 2, "both to be acknowledged")
    assert asked == [("old", "the hose", "Anna"), ("older", "the hose", "Anna")]
    content["unseen"] = []
    expect(page.locator("#rig-last")).to_be_hidden()


def lowest(page: Page, selector: str) -> float:
    """Return where the foot of an element is on the screen, all of which is on it."""
    box = page.locator(selector).bounding_box()
    assert box is not None
    assert box["y"] >= 0
    return box["y"] + box["height"]


def heard_again(page: Page) -> None:
    before = page.evaluate("rigConsole.heardAt")
    until(lambda: page.evaluate("rigConsole.heardAt") > before, "to be heard again")


def test_a_console_that_has_no_news_is_not_taken_for_one_that_is_lost(
    come: Callable[[str, Site_], Page], site: Site
) -> None:
    page = come("desk", nobody)
    expect(page.locator("#rig-state-word")).to_have_text("No rig is heard")
    for _ in range(4):
        heard_again(page)
    assert page.locator("#rig-state-word").inner_text() == "No rig is heard"


def test_a_console_that_is_lost_is_said_to_be_lost(
    come: Callable[[str, Site_], Page], site: Site
) -> None:
    page = come("phone", nobody)
    page.context.set_offline(True)
    page.evaluate("rigConsole.socket.close()")
    expect(page.locator("#rig-state-word")).to_have_text("The console does not answer")
    expect(page.locator("#rig-state-why")).to_contain_text("stop the rig at the rig")
