"""Beside a station that only reads, the page says how what drove the rig last has ended."""

import os
import re
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from ..conftest import WAIT_MS, take_control
from ..fakes import RUNNING, until
from ..site import Site, site_served
from ..test_rig_state import LATER, SIZES, TRIPPED, campaign, launched, lowest

expect.set_options(timeout=WAIT_MS)

IDLE: dict[str, Any] = {
    "status": "idle", "name": "idle: the station reads, nothing drives", "begun_by": "bo",
    "activity": "idle: the station reads, nothing drives", "begun_ns": LATER, "tests": [],
}  # fmt: skip
UNSAFE = {"valve null": 0.001, "bypass shut": 0.9, "pump unloaded": None}
LAST: dict[str, Any] = {
    "campaign": campaign("passed", "tripped", status="ended", exit_code=3, begun_by="Bo"),
    "decision": {"verdict": "internal_leakage", "name": "leak", "test": 2, "time_s": 22.0},
    "trips": TRIPPED["trips"] | {"confirmed": UNSAFE},
    "ended_ns": LATER,
}


@pytest.fixture(scope="module")
def site(leaving: ExitStack) -> Iterator[Site]:
    with site_served(leaving) as site:
        yield site


Open = Callable[[str], Page]


@pytest.fixture
def opened(browser: Browser, site: Site) -> Iterator[Open]:
    """Return a function that opens the page of somebody who has control, on a screen of a size."""
    pages: list[Page] = []
    launched(None, lambda site: None)(site)
    site.client.answer = replace(site.client.answer, accepted=True)
    site.client.sent.clear()

    def open_(size: str) -> Page:
        context = browser.new_context(viewport=SIZES[size])  # type: ignore[arg-type]
        context.set_default_timeout(WAIT_MS)
        page = context.new_page()
        pages.append(page)
        page.goto(site.origin)
        take_control(page, site)
        return page

    yield open_
    for page in pages:
        page.locator("#holder-button").click()
        page.context.close()


def reads(site: Site, **more: Any) -> None:
    """Have the station of a rig read it, and tell what drove it last."""
    told: dict[str, Any] = {**RUNNING.campaign, **IDLE, **more}
    told = {name: value for name, value in told.items() if name not in ("directory", "rig")}
    idle: dict[str, Any] = {
        "campaign": told,
        "progress": {},
        "state": {"state": "disarmed"},
        "health": {},
    }
    site.client.shots = {"bench": replace(RUNNING, **idle)}


def picture(page: Page, name: str) -> None:
    folder = os.environ.get("STANDING_PICTURES")
    if folder:
        page.screenshot(path=Path(folder) / f"{name}.png")


@pytest.mark.parametrize("size", SIZES)
def test_what_ended_stands_beside_the_idle_station_until_somebody_has_acknowledged_it(
    opened: Open, site: Site, size: str
) -> None:
    reads(site, last=LAST)
    page = opened(size)
    for _ in range(2):
        expect(page.locator("#rig-state-word")).to_have_text("Idle")
        expect(page.locator("#rig-last-word")).to_have_text("Tripped")
        why = page.locator("#rig-last-why")
        expect(why).to_contain_text("leaks, begun by Bo, ended at ")
        expect(why).to_contain_text("The emergency stop is open. Remedy: make the rig safe")
        # What is not safe comes first, and with what is to be done about it.
        expect(why).to_contain_text("NOT CONFIRMED SAFE: pump unloaded. Keep away from the ram")
        assert lowest(page, "#rig-last-seen") <= 0.75 * SIZES[size]["height"]
        expect(page).to_have_title("✕ Tripped - bench console")
        expect(page.locator("#campaign-name")).to_have_text("leaks, ended")
        expect(page.locator("#verdict-title")).to_have_text("Last verdict, of leak")
        expect(page.locator("#verdict")).to_have_text("Internal leakage")
        expect(page.locator("#tests .tripped")).to_have_text("tripped")
        picture(page, f"{size}-last")
        page.reload()
    page.locator("#rig-last-seen").click()
    page.keyboard.type("the hose")
    page.keyboard.press("Enter")
    until(lambda: site.client.sent, "the order")
    assert site.client.sent == [("acknowledge", "bench", "Anna: the hose", "")]
    seen = {"by": "Anna", "text": "the hose", "at_ns": LATER}
    reads(site, last=LAST | {"acknowledged": seen})
    expect(page.locator("#rig-last")).to_be_hidden()
    expect(page).to_have_title("bench console")
    expect(page.locator("#campaign-more")).to_contain_text("acknowledged by Anna at ")
    expect(page.locator("[data-do=acknowledge]")).to_be_disabled()
    expect(page.locator("#first-out li")).to_have_count(0)
    page.mouse.wheel(0, 3000)
    until(lambda: page.evaluate("scrollY") > 0, "the page to scroll")
    assert lowest(page, "#rig-state") <= 0.3 * SIZES[size]["height"]
    reads(site)
    expect(page.locator("#campaign-name")).to_have_text("None runs")
    expect(page.locator("#campaign-more")).to_have_text("")
    picture(page, f"{size}-idle")
    site.client.become("bench", latest={"estop_closed": 0.0})
    expect(page.locator("#actions-why")).to_contain_text("emergency stop of bench is open")
    page.locator("[data-do=start]").click()
    expect(page.locator("#dialog-text")).to_contain_text("emergency stop of bench is open")
    page.keyboard.press("Escape")


def test_a_start_that_compiles_beside_an_idle_station_is_said_until_it_is_heard_or_stopped(
    opened: Open, site: Site
) -> None:
    reads(site, last=LAST | {"acknowledged": {"by": "Anna", "text": "", "at_ns": LATER}})
    page = opened("desk")
    started = {"on": "bench", "folder": "leaks-2", "heard": False, "stopped": ""}

    def run(**told: Any) -> None:
        launched(started | told, lambda site: None)(site)

    begun_ms = time.time_ns() // 10**6 - 7_200_000
    run(said="loop: being compiled", started_ms=begun_ms)
    expect(page.locator("#rig-state-word")).to_have_text("Starting leaks")
    expect(page.locator("#rig-state-why")).to_have_text(
        "loop: being compiled. On its way for 2.0 h."
    )
    run(started_ms=begun_ms)
    expect(page.locator("#rig-state-why")).to_contain_text("That has gone on for 2.0 h.")
    run(resumed=True)
    expect(page.locator("#rig-state-word")).to_have_text("Going on with leaks")
    run(stopped="Ada: no")
    expect(page.locator("#rig-state-word")).to_have_text("Stopping leaks")
    expect(page.locator("#rig-state-why")).to_contain_text("It was stopped by Ada: no.")
    run(heard=True)
    expect(page.locator("#rig-state-word")).to_have_text("Idle")
    expect(page.locator("#banners")).to_contain_text("leaks writes its report")
    # On another rig that is known it is told beside the state of this one.
    site.client.shots["other"] = replace(RUNNING, rig="other", alive=False, age_s=9.0)
    run(on="other")
    expect(page.locator("#banners")).to_contain_text("leaks is under way")
    expect(page.locator("#rig-state-word")).to_have_text("Idle")
    run(exit_code=2, reason="daq: nobody answers")
    expect(page.locator("#rig-last-word")).to_have_text("leaks did not start")
    expect(page.locator("#rig-last-why")).to_contain_text("daq: nobody answers.")


def test_a_trip_before_other_uses_stands_until_somebody_has_acknowledged_it_also_while_one_drives(
    opened: Open, site: Site
) -> None:
    seen = {"acknowledged": {"by": "Anna", "text": "", "at_ns": LATER}}
    trip = {"name": "leaks", "begun_by": "Bo", "sentence": "the hose burst", "ended_ns": LATER}
    homed = LAST | {"campaign": LAST["campaign"] | {"name": "second"}} | seen
    told = re.compile(r"^leaks, begun by Bo, tripped at [\d:]+: the hose burst\. ")
    reads(site, last=homed | {"unseen": [trip]})
    page = opened("desk")
    for also in ("Nobody has acknowledged that.", "it can be, once the rig is idle."):
        expect(page.locator("#rig-last-word")).to_have_text("Tripped before")
        expect(page.locator("#rig-last-why")).to_have_text(told)
        expect(page.locator("#rig-last-why")).to_contain_text(also)
        site.client.shots["bench"] = RUNNING
    expect(page.locator("#rig-state-word")).to_have_text("Running")
    expect(page.locator("#rig-last-seen")).to_be_hidden()
    # However well the next use has ended, the line that tells of the trip is not green.
    good = LAST["campaign"] | {"name": "second", "exit_code": 0, "activity": "homing", "tests": []}
    reads(site, last=LAST | {"campaign": good, "trips": {}, "unseen": [trip]})
    expect(page.locator("#rig-last-why")).to_contain_text(
        "Before that, and not acknowledged: leaks"
    )
    expect(page.locator("#rig-last")).to_have_class("banner warn")
    # One that was not acknowledged as the next use began is told as well.
    reads(site, last=LAST)
    expect(page.locator("#rig-last-word")).to_have_text("Tripped")
    site.client.shots["bench"] = RUNNING
    expect(page.locator("#rig-last-word")).to_have_text("Tripped before")
    expect(page.locator("#rig-last-why")).to_contain_text("the emergency stop is open")
    reads(site, last=homed | {"unseen": [trip]})
    expect(page.locator("#rig-last-why")).to_have_text(told)
    page.locator("#rig-last-seen").click()
    page.keyboard.press("Enter")
    until(lambda: ("acknowledge", "bench", "Anna", "") in site.client.sent, "the order")
    reads(site, last=homed | {"unseen": []})
    expect(page.locator("#rig-last")).to_be_hidden()


def test_a_use_that_did_not_say_how_it_ended_is_no_success(opened: Open, site: Site) -> None:
    untold: dict[str, Any] = {
        "status": "ended", "name": "homing", "activity": "homing", "begun_by": "Bo",
        "exit_code": None, "reason": "how it ended was not told", "tests": [],
    }  # fmt: skip
    reads(site, last={"campaign": untold, "decision": {}, "trips": {}, "ended_ns": LATER})
    page = opened("desk")
    expect(page.locator("#rig-last")).to_have_class("banner warn")
    expect(page.locator("#rig-last-why")).to_contain_text("How it ended was not told.")
    # In sentences: when and by whom it ended, and what is left.
    stopped: dict[str, Any] = campaign("aborted", "", status="ended", exit_code=3, reason="Vic")
    homed = untold | {"exit_code": 0, "reason": ""}
    at = r"\d\d:\d\d:\d\d"
    for told, why in (
        (stopped, f"leaks ended at {at} by Vic. 2 of 2 tests did not come to their end."),
        (homed, f"Homing, begun by Bo, came to its end at {at}."),
        (homed | {"exit_code": 3, "reason": "stopped by Vic"},
         f"Homing, begun by Bo, ended early at {at}: stopped by Vic."),
        (homed | {"name": "friction_sliding", "activity": "friction experiment"},
         f"Friction experiment, begun by Bo, came to its end at {at}."),
    ):  # fmt: skip
        reads(site, last={"campaign": told, "decision": {}, "trips": {}, "ended_ns": LATER})
        expect(page.locator("#rig-last-why")).to_have_text(re.compile(why))


def test_a_console_that_comes_back_where_no_rig_is_heard_shows_nothing_of_the_old_one(
    opened: Open, site: Site
) -> None:
    tripping: dict[str, Any] = {
        "health": TRIPPED,
        "state": {"state": "running"},
        "decision": LAST["decision"],
    }
    site.client.shots = {"bench": replace(RUNNING, **tripping)}
    page = opened("desk")
    expect(page.locator("#rig-state-word")).to_have_text("Tripped")
    # Nothing runs beside a trip.
    expect(page.locator("#state")).to_have_text("tripped")
    expect(page.locator("#verdict")).to_have_text("Internal leakage")
    site.client.shots = {}
    site.console.feed._rigs.clear()
    page.evaluate("rigConsole.socket.close()")
    expect(page.locator("#rig-state-word")).to_have_text("No rig is heard")
    shown = {name: page.locator(f"#{name}").inner_text() for name in (
        "rig-name", "state", "campaign-more", "progress-text", "first-out", "action",
        "verdict-more", "tests", "readings", "contacts",
    )}  # fmt: skip
    assert set(shown.values()) == {""}, shown
    expect(page.locator("#campaign-name")).to_have_text("none")
    expect(page.locator("#verdict")).to_have_text("None yet")
