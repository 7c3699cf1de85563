"""In a browser: a campaign that runs is shown live, and stop brings the rig to its safe state."""

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from playwright.sync_api import Browser, BrowserContext, Page, expect

from rig.recording import read_recording
from tests.waiting import COMPILE_S
from tools.chaos.stage import Stage

from .conftest import HEIGHT, WAIT_MS, WIDTH, Serve, Served
from .fakes import until

expect.set_options(timeout=WAIT_MS)


@pytest.fixture(scope="module")
def console(browser: Browser, stage: Stage, serve: Serve) -> Served:
    return serve(stage.folder, "--profile", "stream.yaml")


@pytest.fixture(scope="module")
def first(browser: Browser, console: Served) -> Iterator[BrowserContext]:
    context = browser.new_context(viewport={"width": WIDTH, "height": HEIGHT})
    context.set_default_timeout(WAIT_MS)
    yield context
    context.close()


@pytest.fixture(scope="module")
def page(first: BrowserContext, console: Served) -> Page:
    """Return the page of the operator, who has taken control."""
    page = first.new_page()
    console.enter(page, "Anna")
    expect(page.locator("#life")).to_contain_text("live")
    page.get_by_role("button", name="Take control").click()
    expect(page.locator("#holder")).to_have_text("you have control")
    return page


def test_a_campaign_that_runs_is_shown_live(page: Page, pytestconfig: pytest.Config) -> None:
    expect(page.locator("#rig-name")).to_have_text("emulated")
    expect(page.locator("#rig-state-word")).to_have_text("Running")
    expect(page.locator("#campaign-name")).to_have_text("leaks, running")
    expect(page.locator("#progress-text")).to_have_text("1 of 3: internal leak, 0.6 L/min")
    expect(page.locator("#state")).to_have_text("running")
    expect(page.locator("#contacts")).to_contain_text("closed")
    expect(page.locator("#bypass tr", has_text="Internal leak")).to_contain_text("open")
    expect(page.locator("#stages")).to_contain_text("lateness")
    expect(page.locator("#tests tr.runs")).to_contain_text("internal leak, 0.6 L/min")
    expect(page.locator("#verdict")).to_have_text("Internal leakage")
    expect(page.locator("#verdict-more")).to_contain_text("L/min")
    expect(page.locator("[data-chart=leak] output")).to_have_text(re.compile(r"0\.\d+"))
    until(lambda: page.evaluate("rigConsole.points.time_s.length") > 200, "two seconds of curves")
    until(
        lambda: page.evaluate("rigConsole.points.position_mm.slice(-100).every(Number.isFinite)"),
        "a position at each point",
    )
    seen = page.evaluate("rigConsoleFrames()")
    until(lambda: page.evaluate("rigConsoleFrames()") > seen + 20, "the curves to go on")
    picture = pytestconfig.getoption("--console-picture")
    if picture:
        until(lambda: page.evaluate("rigConsole.points.time_s.length") > 900, "a fuller picture")
        page.screenshot(path=picture)


def test_a_reload_loses_nothing(page: Page) -> None:
    page.reload()
    expect(page.locator("#holder")).to_have_text("you have control")
    expect(page.locator("#verdict")).to_have_text("Internal leakage")
    expect(page.locator("#verdicts")).to_contain_text("Internal leak")
    expect(page.locator("#events")).to_contain_text("Anna takes control")
    until(lambda: page.evaluate("rigConsole.points.time_s.length") > 200, "two seconds of curves")


def test_a_second_operator_is_refused_until_it_takes_over(
    browser: Browser, page: Page, console: Served
) -> None:
    context = browser.new_context(viewport={"width": 420, "height": 900})
    other = context.new_page()
    console.enter(other, "Ben")
    expect(other.locator("#holder")).to_contain_text("Anna has control")
    expect(other.locator("[data-do=hold]")).to_be_disabled()
    answer = other.evaluate("rigConsole.order('hold')")
    assert answer == {"accepted": False, "reason": "Anna has control", "answered": True}
    assert other.evaluate("document.documentElement.scrollWidth") <= 420
    other.get_by_role("button", name="Take over").click()
    other.locator("#dialog").get_by_role("button", name="Take over").click()
    expect(page.locator("#holder")).to_contain_text("Ben has control")
    expect(page.locator("#events")).to_contain_text("Ben takes over from Anna")
    context.close()
    page.get_by_role("button", name="Take over").click()
    page.locator("#dialog").get_by_role("button", name="Take over").click()
    expect(page.locator("#holder")).to_have_text("you have control")


def test_a_hold_is_asked_for_twice_and_then_obeyed(page: Page, stage: Stage) -> None:
    page.get_by_role("button", name="Hold").click()
    page.keyboard.press("Escape")
    expect(page.locator("#dialog")).not_to_be_visible()
    page.get_by_role("button", name="Hold").click()
    page.keyboard.type("lunch")
    page.keyboard.press("Enter")
    expect(page.locator("#toasts")).to_contain_text("Hold: obeyed")
    asked = [
        entry for line in (stage.out / "journal.jsonl").read_text().splitlines()
        if (entry := json.loads(line))["kind"] == "operator"
    ]  # fmt: skip
    assert [(entry["request"], entry["text"]) for entry in asked] == [("pause", "Anna: lunch")]
    expect(page.locator("#rig-state-word")).to_have_text("Running, to be held")
    expect(page.locator("[data-do=hold]")).to_be_disabled()
    expect(page.locator("[data-do=resume]")).to_be_enabled()


def test_stop_works_over_a_dialog_and_the_rig_reaches_its_safe_state(
    page: Page, stage: Stage
) -> None:
    page.get_by_role("button", name="Abort").click()
    expect(page.locator("#dialog")).to_be_visible()
    assert not stage.is_safe(), stage.printed
    page.mouse.wheel(0, 3000)
    page.locator("#stop").click()
    expect(page.locator("#stop-told")).to_contain_text("Stop obeyed")
    stage.wait(stage.is_safe, "the safe state")
    # Its report may have to be compiled first.
    stage.wait(lambda: stage.run.poll() is not None, "the run to end", COMPILE_S)
    assert stage.run.returncode == 3
    recording = read_recording(stage.out / "internal_leak_0.6_L_min.mcap")
    assert recording.time_s[-1] > 1.0
    assert "abort" in [event.kind for event in recording.events]
    expect(page.locator("#life")).to_contain_text("campaign ended")
    expect(page.locator("#tests")).to_contain_text("aborted")
    expect(page.locator("#rig-state-word")).to_have_text("Stopped")
    expect(page.locator("#rig-state-why")).to_contain_text("Anna")


def test_the_picture_of_the_readme_is_there() -> None:
    assert (Path(__file__).parents[3] / "docs" / "images" / "console.png").stat().st_size > 20_000
