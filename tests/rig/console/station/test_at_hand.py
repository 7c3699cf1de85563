"""What an operator moves a rig by, and what it answers, is at hand and in sight on every screen."""

from contextlib import ExitStack
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, expect

from rig.accounts import AccountFile, Role
from rig.stream.answers import Answer

from ..conftest import WAIT_MS, take_control
from ..fakes import RUNNING, until
from ..site import CHEAP, Site, site_served

expect.set_options(timeout=WAIT_MS)
PASSWORD = "four words that differ"
LONG = "Annabella Müller-Thurgau"
MANUAL = {
    **RUNNING.campaign, "name": "manual", "activity": "manual", "begun_by": "bo", "tests": [],
}  # fmt: skip
NEEDLES = {"internal_leakage_ball": 0.0, "internal_leakage_needle": 0.4,
           "external_leakage_1_ball": 0.0, "external_leakage_1_needle": 0.0}  # fmt: skip
SIZES = {"desk": {"width": 1280, "height": 800}, "phone": {"width": 390, "height": 844}}
LEFT = "(id) => document.getElementById(id).getBoundingClientRect().left"


def log_in(browser: Browser, site: Site, name: str, size: str) -> Page:
    context = browser.new_context(viewport=SIZES[size])  # type: ignore[arg-type]
    context.set_default_timeout(WAIT_MS)
    page = context.new_page()
    page.goto(site.origin)
    page.fill("[name=name]", name)
    page.fill("[name=password]", PASSWORD)
    page.keyboard.press("Enter")
    expect(page.locator("#role")).to_contain_text(name)
    return page


def in_sight(page: Page, selector: str, above: float) -> bool:
    box = page.locator(selector).bounding_box()
    return box is not None and box["y"] >= 0.0 and box["y"] + box["height"] <= above


@pytest.mark.parametrize("size", SIZES)
def test_people_buttons_state_and_answers_stay_in_sight_beside_the_stop(
    browser: Browser, leaving: ExitStack, tmp_path: Path, size: str
) -> None:
    accounts = AccountFile(tmp_path / "accounts.json")
    for name, role in ((LONG, Role.ENGINEER), ("Bo", Role.OPERATOR)):
        accounts.add(name, role, CHEAP.hash(PASSWORD))
    with site_served(leaving, accounts=accounts) as site:
        refused = Answer(False, "the pump is not loaded")
        site.client.answer = refused
        site.client.become("bench", campaign=MANUAL, progress={}, latest=NEEDLES)
        site.client.shots["other"] = replace(RUNNING, rig="other", alive=False, age_s=9.0)
        page = log_in(browser, site, LONG, size)
        page.locator("#holder-button").click()
        expect(page.locator("#holder")).to_have_text("you have control")
        # Also who looks at what somebody with a long name does can take over, and log out.
        other = log_in(browser, site, "Bo", size)
        expect(other.locator("#holder")).to_contain_text("has control since")
        for shown in (page, other):
            assert shown.evaluate("document.documentElement.scrollWidth") <= SIZES[size]["width"]
            if size == "desk":
                stop = shown.evaluate(LEFT, "stop")
                bar = "Math.max(...[...document.querySelectorAll('#bar > *')].map((each) => "
                assert shown.evaluate(bar + "each.getBoundingClientRect().right))") <= stop
        other.context.close()
        # The slider of a needle stands where the needle is; a shut one at its end.
        sliders = page.locator("#manual-bypasses input[type=range]")
        expect(sliders.nth(0)).to_have_value("0")
        expect(sliders.nth(1)).to_have_value("40")
        padding = "(each) => getComputedStyle(each).paddingLeft"
        assert sliders.nth(0).evaluate(padding) == "0px"
        foot = page.locator("#stop").bounding_box()
        above = foot["y"] if foot is not None and size == "phone" else SIZES[size]["height"]
        for button in ("[data-jog='pump high']", "#manual-bypasses button"):
            page.locator(button).first.click()
            expect(page.locator("#manual-said")).to_contain_text("the pump is not loaded")
            expect(page.locator("#manual-said")).to_have_class("quiet refused")
            assert in_sight(page, "#manual-said", above), button
            assert in_sight(page, "#rig-state", above / 2), button
        page.context.close()


def test_labels_of_the_time_axis_do_not_touch_each_other_in_a_narrow_chart(
    browser: Browser, site: Site
) -> None:
    context = browser.new_context(viewport=SIZES["phone"])  # type: ignore[arg-type]
    context.set_default_timeout(WAIT_MS)
    page = context.new_page()
    take_control(page, site)
    expect(page.locator("#life")).to_contain_text("live")
    page.locator("#span").select_option("60")
    labels = "rigConsoleHistory.charts.motion.labels"
    until(lambda: page.evaluate(f"{labels}?.length > 1"), "the labels")
    # As where a trigger has fired: whole times of the clock, close to each other.
    drawn = page.evaluate(
        """() => {
          const chart = rigConsoleHistory.charts.motion;
          const ticks = [0, 4, 8, 12, 16, 20].map((back) => [back, "12:34:56"]);
          chart.draw({ time_s: [], test: [] }, { ...chart.view, span_s: 20, end_s: 20, ticks });
          return chart.labels;
        }"""
    )
    ends = sorted(drawn)
    assert len(ends) > 1
    assert all(one[1] < other[0] for one, other in pairwise(ends))
    context.close()
