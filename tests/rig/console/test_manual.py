"""The panel of manual mode: who has control moves the ram, and a button that is let go stops it."""

from dataclasses import replace

import pytest
from playwright.sync_api import Browser, expect

from .conftest import WAIT_MS, take_control
from .fakes import RUNNING, until
from .site import Site

expect.set_options(timeout=WAIT_MS)
MANUAL = {**RUNNING.campaign, "name": "manual", "activity": "manual", "tests": []}


@pytest.mark.parametrize("let_go", ["pointer", "blur"])
def test_hold_to_run_beats_while_it_is_held_and_stops_when_it_is_let_go(
    browser: Browser, site: Site, let_go: str
) -> None:
    context = browser.new_context()
    context.set_default_timeout(WAIT_MS)
    page = context.new_page()
    take_control(page, site)
    panel = page.locator("#manual-card")
    expect(panel).to_be_hidden()
    site.client.shots["bench"] = replace(RUNNING, campaign=MANUAL)
    expect(panel).to_be_visible()
    sent = site.client.sent

    page.get_by_role("button", name="Jog by").click()
    until(lambda: ("jog", "bench", "Anna: by 5mm speed 20mm/s", "") in sent, "the jog")
    page.get_by_role("button", name="Hold: out").hover()
    page.mouse.down()
    until(lambda: sum(each[0] == "beat" for each in sent) > 5, "heartbeats")
    if let_go == "pointer":
        page.mouse.up()
    else:
        page.evaluate("dispatchEvent(new Event('blur'))")
    until(lambda: ("jog", "bench", "Anna: stop", "") in sent, "the stop")
    assert ("jog", "bench", "Anna: hold out speed 20mm/s", "") in sent

    page.locator("#holder-button").click()
    expect(page.get_by_role("button", name="Hold: out")).to_be_disabled()
    site.client.shots["bench"] = RUNNING
    expect(panel).to_be_hidden()
    context.close()
