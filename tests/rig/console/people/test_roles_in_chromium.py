"""In a browser: a role's page offers what the role may do, and an expired login still stops."""

from contextlib import ExitStack
from pathlib import Path

import pytest
from playwright.sync_api import Browser, expect

from rig.accounts import AccountFile, Role

from ..conftest import WAIT_MS
from ..fakes import until
from ..site import CHEAP, site_served

expect.set_options(timeout=WAIT_MS)
PASSWORD = "four words that differ"


def test_a_viewer_sees_and_stops_an_operator_acts_and_who_has_expired_still_stops(
    browser: Browser, leaving: ExitStack, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    accounts = AccountFile(tmp_path / "accounts.json")
    accounts.add("Vera", Role.VIEWER, CHEAP.hash(PASSWORD))
    with site_served(leaving, accounts=accounts) as site:
        context = browser.new_context()
        context.set_default_timeout(WAIT_MS)
        page = context.new_page()
        page.goto(site.origin)
        page.fill("[name=name]", "vera")
        page.fill("[name=password]", PASSWORD)
        page.keyboard.press("Enter")
        expect(page.locator("#role")).to_have_text("Vera, viewer")
        hold = page.locator("[data-do=hold]")
        reason = "Not possible: this needs the role operator; yours is viewer."
        for button in (hold, page.locator("#holder-button")):
            expect(button).to_have_attribute("title", reason)
            expect(button).to_be_disabled()
        expect(page.locator("#actions-why")).to_contain_text("may stop")
        expect(page.locator("[data-do=set]")).to_be_hidden()

        accounts.change("Vera", role=Role.ENGINEER)
        expect(page.locator("#role")).to_have_text("Vera, engineer")
        page.locator("#holder-button").click()
        expect(page.locator("#holder")).to_have_text("you have control")
        expect(hold).to_be_enabled()
        expect(hold).to_have_attribute("title", "")
        expect(page.locator("[data-do=set]")).to_be_enabled()

        members = site.console.members
        assert members is not None
        clock = members._clock
        monkeypatch.setattr(members, "_clock", lambda: clock() + 3 * 3600.0)
        expect(page.locator("#rig-state-word")).to_have_text("Your login has expired")
        expect(hold).to_be_disabled()
        assert page.evaluate("rigConsole.order('hold')")["expired"]
        page.reload()
        expect(page.locator("#rig-state-word")).to_have_text("Your login has expired")
        expect(page.locator("#log-in")).to_be_visible()
        page.keyboard.press("F9")
        expect(page.locator("#stop-told")).to_contain_text("Stop obeyed")
        until(lambda: site.client.persons == ["Vera"], "the stop")
        page.locator("#log-in").click()
        expect(page.locator("[name=password]")).to_be_visible()
        context.close()
