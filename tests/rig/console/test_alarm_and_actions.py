"""The page calls for somebody when something is wrong, and offers what can be done about it."""

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Browser, Page, expect

from rig.stream.known import Window

from .conftest import WAIT_MS, take_control
from .fakes import RUNNING, until
from .site import Site, site_served
from .test_rig_state import TRIPPED, ended, launched

PLAN = {
    "summary": ["rig time 1 min 4 s"], "warnings": [], "text": "", "rig": ["limits 10 V"],
    "tests": [{
        "name": "healthy", "duration_s": 30.0, "settle_s": 2.0, "expect": "healthy", "faults": [],
        "limits": [], "warnings": [], "command_V": None, "position_m": [0.15, 0.45],
        "peak_speed_m_per_s": 0.471, "valve_speed_m_per_s": 0.708,
        "following": "following error at most 106 mm",
    }],
}  # fmt: skip
"""What `rig check --json` says of a campaign."""

expect.set_options(timeout=WAIT_MS)
PHONE = {"width": 420, "height": 900}
RUN = {"folder": "out", "campaign": "leaks"}


@pytest.fixture(scope="module")
def served(leaving: ExitStack) -> Iterator[Site]:
    with site_served(leaving) as site:
        yield site


@pytest.fixture(scope="module")
def opened(browser: Browser, served: Site) -> Iterator[Page]:
    """Return the page of somebody who has control, on a phone."""
    context = browser.new_context(viewport=PHONE)  # type: ignore[arg-type]
    context.set_default_timeout(WAIT_MS)
    page = context.new_page()
    take_control(page, served)
    expect(page.locator("#life")).to_contain_text("live")
    yield page
    context.close()


@pytest.fixture
def site(served: Site) -> Site:
    """Return the console of a rig that runs, as at the beginning of each test."""
    served.client.shots = {"bench": RUNNING}
    return served


@pytest.fixture
def page(opened: Page, site: Site) -> Page:
    """Return the page, which shows that the rig runs."""
    opened.evaluate("scrollTo(0, 0)")
    expect(opened.locator("#rig-state-word")).to_have_text("Running")
    return opened


def test_a_trip_stands_in_the_tab_s_title_and_sounds_until_it_is_silenced_or_over(
    site: Site, page: Page
) -> None:
    expect(page).to_have_title("bench console")
    sounded = page.evaluate("rigConsoleAlarm.sounded")
    site.client.become("bench", state={"state": "tripped"}, health=TRIPPED)
    expect(page).to_have_title("✕ Tripped - bench console")
    assert page.evaluate("rigConsoleAlarm.sounded") == sounded + 1
    # Nothing on the page says otherwise while the run still writes what came of it.
    expect(page.locator("#life")).to_have_class("pill bad")
    expect(page.locator("#campaign-name")).to_have_text("leaks, tripped")
    expect(page.locator("#tests .status")).to_have_text("tripped")
    page.locator("#silence").click()
    expect(page.locator("#silence")).to_be_hidden()
    expect(page).to_have_title("✕ Tripped - bench console")
    assert page.evaluate("rigConsoleAlarm.timer") == 0
    site.client.shots["bench"] = RUNNING
    expect(page).to_have_title("bench console")
    site.client.become("bench", alive=False, age_s=9.0)
    expect(page).to_have_title("✕ The stream is dead - bench console")
    expect(page.locator("#silence")).to_be_visible()
    # Who comes, or was away for a moment, is shown it and hears nothing: there is none to silence.
    page.reload()
    expect(page).to_have_title("✕ The stream is dead - bench console")
    page.evaluate("rigConsole.socket.close()")
    until(lambda: page.evaluate("rigConsole.open && rigConsole.tries === 0"), "the page to be back")
    expect(page.locator("#rig-state-word")).to_have_text("The stream is dead")
    expect(page.locator("#silence")).to_be_hidden()
    assert page.evaluate("rigConsoleAlarm.sounded") == 0


def test_on_a_phone_state_verdict_and_campaign_come_before_the_curves(
    site: Site, page: Page
) -> None:
    order = ("#rig-state", "#bar", "#verdict-card", "#campaign-card", "#charts")
    boxes = [page.locator(each).bounding_box() for each in order]
    tops = [box["y"] for box in boxes if box is not None]
    assert tops == sorted(tops)
    assert len(tops) == len(order)
    page.mouse.wheel(0, 3000)
    until(lambda: page.evaluate("scrollY") > 0, "the page to scroll")
    box = page.locator("#rig-state").bounding_box()
    assert box is not None
    assert box["y"] >= 0.0


def test_after_a_trip_it_is_acknowledged_and_reset_and_after_a_completed_run_neither(
    site: Site, page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    launcher = site.console.launcher
    asked: list[tuple[str, ...]] = []
    monkeypatch.setattr(launcher, "content", launcher.content)
    monkeypatch.setattr(launcher, "acknowledge", lambda *given: asked.append(("seen", *given)))
    monkeypatch.setattr(launcher, "go_on", lambda *given: asked.append(("go on", *given)))
    old = {"folder": "old", "campaign": "night"}

    def stand(set_up: Callable[[Site], None], **told: Any) -> None:
        launched(None, set_up)(site)
        content = launcher.content() | told
        launcher.content = lambda: content  # type: ignore[method-assign]
        # The rig and its runs are told to the page apart from each other.
        known = f"rigConsole.common.launch.unseen?.length === {len(told['unseen'])}"
        until(lambda: page.evaluate(known), "what is known of the runs")
        expect(page.locator("#life")).to_contain_text("ended")

    trip = ended("tripped", "", exit_code=3, reason="a trip", health=TRIPPED)
    stand(trip, unfinished=[RUN, old], unseen=[RUN])
    expect(page.locator("[data-do=acknowledge]")).to_be_enabled()
    page.locator("[data-do=acknowledge]").click()
    page.keyboard.type("it was me")
    page.keyboard.press("Enter")
    until(lambda: asked == [("seen", "out", "it was me", "Anna")], "what was acknowledged")
    stand(trip, unfinished=[RUN, old], unseen=[])
    expect(page.locator("[data-do=acknowledge]")).to_be_disabled()
    page.locator("[data-do=reset]").click()
    expect(page.locator("#dialog option")).to_have_text(["leaks (out)"])
    page.keyboard.press("Enter")
    until(lambda: asked[1:] == [("go on", "out", "Anna")], "the reset")
    # The journal of the run that has just ended may not have been read anew.
    stand(ended("passed", "passed", exit_code=0), unfinished=[RUN, old], unseen=[])
    expect(page.locator("#rig-state-word")).to_have_text("Ended, all passed")
    for button in ("reset", "acknowledge"):
        expect(page.locator(f"[data-do={button}]")).to_be_disabled()
    # An older run is gone on with as another one is started.
    page.locator("[data-do=start]").click()
    page.locator("#dialog select").select_option(label="go on with night (old)")
    page.keyboard.press("Enter")
    until(lambda: asked[2:] == [("go on", "old", "Anna")], "the older run")


def test_pressures_a_little_below_zero_open_no_axis_below_it_and_curves_can_be_paused(
    site: Site, page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    plain = site.client.window

    def window(*given: Any, **more: Any) -> Window:
        found = plain(*given, **more)
        levels = {"pressure_1_Pa": -0.05e6, "supply_pressure_Pa": 13.8e6}
        return replace(
            found,
            values={name: each + levels.get(name, 0.0) for name, each in found.values.items()},
        )

    monkeypatch.setattr(site.client, "window", window)
    until(lambda: page.evaluate("rigConsole.points.pressure_1_MPa.at(-1)") == -0.05, "the dip")
    # The axis as it is drawn of these points alone, not of those before them.
    of = "(await import('/page/chart.js')).Chart"
    ends = page.evaluate(
        f"""async () => {{
          const Chart = {of};
          const figure = document.createElement("figure");
          document.body.append(figure);
          const chart = new Chart(figure, {{ title: "p", unit: "MPa", least: 1, floor: 0,
            series: [{{ key: "a", label: "a", colour: "first", digits: 2 }}] }});
          chart.height = 216;
          const near = chart.range({{ a: [13.8, -0.05] }}).low;
          chart.ends = null;
          const beyond = chart.range({{ a: [13.8, -2] }}).low;
          figure.remove();
          return [near, beyond];
        }}"""
    )
    assert ends[0] == 0.0
    assert ends[1] < -1.0
    page.locator("#pause").click()
    frames = page.evaluate("rigConsoleFrames()")
    heard = page.evaluate("rigConsole.heardAt")
    until(lambda: page.evaluate("rigConsole.heardAt") > heard + 200, "more to be heard")
    assert page.evaluate("rigConsoleFrames()") == frames
    page.locator("#pause").click()
    until(lambda: page.evaluate("rigConsoleFrames()") > frames, "the curves to go on")


def test_the_history_is_scrolled_scaled_and_triggered_on_the_page(
    site: Site, page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Each step by its least and greatest value, and never across a gap, which is null.
    crossings = page.evaluate(
        """async () => {
          const { crossing } = await import("/page/trigger.js");
          const rising = (low, high = low) => crossing(low, high, 5, true);
          return [rising([1, 9]), rising([1, null, 9]), rising([9, 1, 1, 6]), rising([6, 9]),
            rising([1, 1, 1], [1, 8, 1]), crossing([9, 4], [9, 9], 5, false),
            rising([9, 4], [9, 9])];
        }"""
    )
    assert crossings == [1, -1, 3, -1, 1, 1, -1]
    # What the console has in longer steps only, after a sleep of the browser, could hide a gap.
    slept = page.evaluate(
        """async () => {
          const { Trigger } = await import("/page/trigger.js");
          const judged = (step_ms) => {
            const fired = [];
            const own = { key: "x", level: 5, rises: true, seen_ms: 1000,
              fire: (ms) => fired.push(ms) };
            Trigger.prototype.judge.call(
              own, { begin_ms: 900, step_ms, count: 30, low: { x: Array(30).fill(1).fill(9, 20) },
                     high: { x: Array(30).fill(1).fill(9, 20) } }, true);
            return [fired, own.seen_ms];
          };
          return [judged(10), judged(100)];
        }"""
    )
    assert slept == [[[1100], 1200], [[], 0]]
    plain = site.client.window

    def window(*given: Any, **more: Any) -> Window:
        found = plain(*given, **more)
        # The ram jumps to and fro between 0 and 200 mm, a fifth of a second of its rows each.
        jumps = np.where(found.row // 200 % 2, 0.2, 0.0)
        return replace(found, values={**found.values, "position_m": jumps})

    monkeypatch.setattr(site.client, "window", window)
    page.select_option("#span", "60")
    expect(page.locator("[data-chart=further]")).to_be_visible()
    page.fill("#trigger-level", "100")
    page.locator("#trigger-arm").click()
    expect(page.locator("#trigger-said")).to_contain_text("Fired at")
    assert page.evaluate("rigConsoleHistory.frozen.level.value") == 100
    page.locator("#scale").click()
    low, high = (page.locator("[data-chart=motion] .ends input").nth(k) for k in (0, 1))
    low.fill("50")
    high.fill("150")
    high.press("Tab")
    assert page.evaluate("rigConsoleHistory.charts.motion.fixed") == {"low": 50, "high": 150}
    page.locator("#scale").click()
    end = page.evaluate("rigConsoleHistory.end_ms")
    page.locator("#earlier").click()
    until(lambda: page.evaluate("rigConsoleHistory.end_ms") == end - 30_000, "half a span back")
    page.locator("#trigger-arm").click()
    expect(page.locator("#trigger")).to_have_attribute("data-state", "armed")
    page.locator("#trigger-arm").click()
    page.select_option("#span", "10")
    expect(page.locator("[data-chart=further]")).to_be_hidden()


def test_the_queue_is_edited_and_a_start_is_shown_beforehand_on_the_page(
    site: Site, page: Page, monkeypatch: pytest.MonkeyPatch
) -> None:
    console, asked = site.console, []
    launched(None, lambda site: None)(site)
    monkeypatch.setattr(type(console.launcher), "may_start", True)
    monkeypatch.setattr(console.launcher, "to_check", lambda name: [name])
    entries = [
        {"number": k, "campaign": "leaks", "by": who, "at_ms": 0, "begun": False}
        for k, who in ((4, "Bo"), (7, "Eve"))
    ]
    queue: dict[str, Any] = {
        "entries": entries, "by": "", "why": "Eve has stopped bench", "marks": []
    }  # fmt: skip
    monkeypatch.setattr(console.queue, "content", lambda: queue)
    monkeypatch.setattr(console.queue, "look", lambda: None)
    for name in ("add", "move", "remove", "begin"):
        monkeypatch.setattr(
            console.queue, name, lambda *given, name=name: asked.append((name, *given))
        )
    found = [{"pending": True}, {"problems": ["leaks.yaml:4:2 far: 0.9 m is above 0.6 m"]}]
    monkeypatch.setattr(console.preview, "of", lambda words: found.pop(0))
    expect(page.locator("#queue-entries li")).to_contain_text(["by Bo", "by Eve"])
    expect(page.locator("#queue-state")).to_contain_text("Eve has stopped bench.")
    page.locator("#queue-add").click()
    expect(page.locator("#dialog-details")).to_contain_text("leaks.yaml:4:2 far: 0.9 m")
    page.locator("#dialog select").press("Enter")
    page.get_by_label("leaks, number 7: earlier").click()
    page.get_by_label("leaks, number 4: remove").click()
    until(lambda: len(asked) == 3, "the queue's changes")
    (added, mark), *others = [(each[:3], each[3:]) for each in asked]
    assert added == ("add", "leaks", "Anna")
    assert [each for each, _ in others] == [("move", "7", "earlier"), ("remove", "4")]
    expect(page.locator("#toasts")).to_contain_text("Queue: added at its end")

    # A console that does not answer is asked nothing, and says afterwards what it had done.
    found.append({"plan": PLAN})
    page.route("**/order", lambda route: route.abort())
    page.locator("#queue-add").click()
    shown = page.locator("#dialog-details")
    expect(shown).to_contain_text("1. healthy, 30 s after 2 s of settling")
    expect(shown).to_contain_text("1, none with faults; 32 s of rig time")
    expect(shown).to_contain_text("150 to 450 mm, at most 471 mm/s")
    expect(shown.locator("dd", has_text="106 mm")).to_have_text("error at most 106 mm")
    expect(shown).not_to_contain_text("1 min 4 s")
    page.locator("#dialog select").press("Enter")
    expect(page.locator("#toasts")).to_contain_text("Queue: the console does not answer")
    page.unroute("**/order")
    unsure = page.evaluate("rigConsoleQueue.unsure.text")
    assert len(unsure) == 24
    assert (unsure,) != mark
    page.evaluate("rigConsole.socket.close(); rigConsole.connect = () => {}")
    for button in ("#queue-add", "#queue-start", "#holder-button", "[data-do=start]"):
        expect(page.locator(button)).to_be_disabled()
    expect(page.locator("#actions-why")).to_contain_text("The console does not answer")
    queue["marks"] = [unsure]
    page.evaluate("delete rigConsole.connect; rigConsole.connect()")
    expect(page.locator("#toasts")).to_contain_text("leaks was queued, although")
    expect(page.locator("#queue-add")).to_be_enabled()
    found.append({"problems": []})
    page.locator("#queue-start").click()
    page.locator("#dialog [value=confirm]").click()
    until(lambda: asked[-1] == ("begin", "Anna", "4"), "the start of what was shown")
