"""The page in a browser: stop is always within reach, and what is dead is shown as dead."""

from collections.abc import Iterator
from dataclasses import replace
from threading import Event
from typing import Any

import pytest
from playwright.sync_api import Browser, Page, expect

from rig.stream.answers import Answer

from .conftest import WAIT_MS, take_control
from .fakes import RUNNING, FakeClient, until
from .site import Site

expect.set_options(timeout=WAIT_MS)
SMALL = {"width": 420, "height": 900}


@pytest.fixture
def page(browser: Browser, site: Site) -> Iterator[Page]:
    """Return the page of somebody who has control, on a small screen."""
    context = browser.new_context(viewport=SMALL, color_scheme="dark")  # type: ignore[arg-type]
    context.set_default_timeout(WAIT_MS)
    page = context.new_page()
    faults: list[str] = []
    page.on("pageerror", lambda error: faults.append(str(error)))
    page.on(
        "console",
        lambda said: (
            faults.append(said.text)
            if said.type == "error" and "status of" not in said.text and "ERR_" not in said.text
            else None
        ),
    )
    take_control(page, site)
    expect(page.locator("#life")).to_contain_text("live")
    yield page
    context.close()
    assert faults == []


def test_what_a_console_told_before_it_was_restarted_is_forgotten(page: Page) -> None:
    known = "() => { rigConsole.socket.onopen(); return Object.keys(rigConsole.common); }"
    assert page.evaluate(known) == []


def test_a_stream_that_dies_is_shown_as_dead_with_its_age(site: Site, page: Page) -> None:
    site.client.become("bench", alive=False, age_s=7.04)
    expect(page.locator("#life")).to_have_text("dead for 7.0 s")
    expect(page.locator("#rig-state")).to_contain_text("The stream is dead for 7.0 s")
    expect(page.locator("[data-do=hold]")).to_be_disabled()
    expect(page.locator("#campaign-name")).to_have_text("leaks, was running")
    opacity = "getComputedStyle(document.querySelector('#readings dd')).opacity"
    assert float(page.evaluate(opacity)) < 0.6
    site.client.become("bench", alive=True, age_s=0.0)
    expect(page.locator("#life")).to_contain_text("live")
    expect(page.locator("#banners")).to_be_empty()
    expect(page.locator("#campaign-name")).to_have_text("leaks, running")
    # Nor does what the session before has measured look as if it were so now.
    heard = {"position_m": 0.3, "estop_closed": 1.0}
    site.client.become("bench", latest=heard, health={"homed": False})
    empty = "rigConsoleHistory.charts.motion.empty"
    until(lambda: page.evaluate(empty).startswith("not homed"), "why no position is drawn")
    site.client.become("bench", latest=heard, health={"homed": True})
    expect(page.locator("#contacts dd").first).to_have_text("closed")
    until(lambda: page.evaluate(empty) == "", "the end of that")
    expect(page.locator("#bypass caption")).to_have_text("This rig has none.")
    site.client.become("bench", is_sampled=False, health={})
    expect(page.locator("#contacts dd")).to_have_text(["not known"] * 2)
    expect(page.locator("#action")).to_have_text("not heard yet")
    expect(page.locator("#bypass caption")).to_have_text("not heard yet")
    for shown in ("#readings dd", ".chart canvas"):
        assert float(page.evaluate(opacity.replace("#readings dd", shown))) < 0.6
    site.client.become("bench", is_sampled=True, latest={"position_m": 0.3})
    expect(page.locator("#action")).to_have_text("A simulated rig has none.")


def test_a_verdict_stands_beside_what_its_own_test_expects_and_no_leak_beside_no_judge(
    site: Site, page: Page
) -> None:
    empty = "rigConsoleHistory.charts.leak.empty"
    until(lambda: page.evaluate(empty) == "nothing is judged", "the empty chart")
    tests = [
        {"name": "first", "expect": "internal_leakage", "status": "passed"},
        {"name": "second", "expect": "healthy", "status": "running"},
    ]
    found = {"verdict": "internal_leakage", "name": "first", "test": 1, "time_s": 40.0}
    going_on = {**RUNNING.progress, "number": 2, "count": 2, "name": "second", "expect": "healthy"}
    campaign = {**RUNNING.campaign, "tests": tests}
    site.client.become("bench", decision=found, progress=going_on, campaign=campaign)
    expect(page.locator("#verdict-title")).to_have_text("Last verdict, of first")
    expect(page.locator("#verdict-more")).to_have_text("as expected")
    site.client.become("bench", decision=found | {"name": "second", "test": 2})
    expect(page.locator("#verdict-title")).to_have_text("Verdict")
    expect(page.locator("#verdict-more")).to_have_text("expected at the end: healthy")
    until(lambda: page.evaluate(empty) == "no leak found", "what the detector finds")


def test_a_trip_is_reported_with_its_first_out_and_its_remedy(site: Site, page: Page) -> None:
    first = {"by": "loop", "cause": "ESTOP_OPEN", "sentence": "the emergency stop is open",
             "remedy": "release it, then reset", "after_s": 0.0}  # fmt: skip
    trips = {"first_out": [first], "confirmed": {"valve null": 0.001, "bypass shut": None}}
    site.client.become("bench", health={"trips": trips})
    # What is not known to be safe comes before all else, and above the fold.
    expect(page.locator("#rig-state-why")).to_contain_text("Not confirmed yet: bypass shut. Keep")
    expect(page.locator("#rig-state-why")).to_contain_text("emergency stop at the rig. The emerg")
    trips["confirmed"] = {"valve null": 0.001, "bypass shut": 1.2}
    site.client.become("bench", health={"trips": {**trips}})
    expect(page.locator("#rig-state")).to_contain_text("Tripped the emergency stop is open.")
    expect(page.locator("#rig-state")).to_contain_text("Remedy: release it, then reset.")
    low = {"action": "indicate", "sentence": "the supply is low"}
    site.client.become("bench", health=low)
    for place in ("#banners .warn", "#action"):
        expect(page.locator(place)).to_have_text("The supply is low")
    trips["confirmed"] = {"valve null": 0.001, "bypass shut": None}
    site.client.become("bench", health={"trips": {**trips}})
    expect(page.locator("#confirmed")).to_contain_text("not confirmed")


def test_a_rig_that_has_ended_is_listed_as_ended_and_one_that_went_silent_as_dead(
    site: Site, page: Page
) -> None:
    over = {**RUNNING.campaign, "status": "ended"}
    site.client.shots["night"] = replace(RUNNING, rig="night", alive=False, campaign=over)
    site.client.shots["annex"] = replace(RUNNING, rig="annex", alive=False)
    expect(page.locator("#rig option")).to_have_text(["bench", "night (ended)", "annex (dead)"])


def test_stop_acts_on_the_rig_that_is_shown_and_says_which(site: Site, page: Page) -> None:
    site.client.shots["annex"] = replace(RUNNING, rig="annex")
    expect(page.locator("#stop-rig")).to_have_text("bench")
    page.locator("#stop").click()
    expect(page.locator("#stop-told")).to_contain_text("bench: Stop obeyed")
    page.locator("#rig").select_option("annex")
    expect(page.locator("#stop-rig")).to_have_text("annex")
    page.keyboard.press("F9")
    expect(page.locator("#stop-told")).to_contain_text("annex: Stop obeyed")
    assert [sent[:2] for sent in site.client.sent] == [("abort", "bench"), ("abort", "annex")]
    expect(page.locator("#events")).to_contain_text("Anna: stop annex")


def test_of_a_valve_that_is_shut_the_meter_s_reading_stands_in_brackets(
    site: Site, page: Page
) -> None:
    latest = {"external_leakage_1_ball": 0.0, "flow_1_m3_per_s": 8.3e-7}
    site.client.become("bench", latest=latest)
    expect(page.locator("#bypass tbody")).to_contain_text("(0.05)")
    site.client.become("bench", latest=latest | {"external_leakage_1_ball": 1.0})
    expect(page.locator("#bypass tbody")).not_to_contain_text("(")


def test_stop_is_on_the_screen_wherever_one_has_scrolled_and_over_any_dialog(
    site: Site, page: Page
) -> None:
    page.mouse.wheel(0, 5000)
    page.locator("[data-do=note]").click()
    expect(page.locator("#dialog")).to_be_visible()
    box = page.locator("#stop").bounding_box()
    assert box is not None
    assert box["y"] + box["height"] <= SMALL["height"] + 1
    assert box["height"] >= 60
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    expect(page.locator("#stop-told")).to_contain_text("Stop obeyed")
    assert site.client.sent == [("abort", "bench", "Anna", "")]
    # So is what came of it, at whatever place of the page, and under nothing.
    seen = """() => [0, 40, 80, 120, 9999].every((place) => {
      scrollTo(0, place);
      const told = document.getElementById("stop-told");
      const { left, top, width, height, bottom } = told.getBoundingClientRect();
      return top >= 0 && bottom <= innerHeight && [0.1, 0.5, 0.9].every((part) =>
        told.contains(document.elementFromPoint(left + width / 2, top + part * height)));
    })"""
    assert page.evaluate(seen)
    page.keyboard.press("Escape")
    for size in (SMALL, {"width": 1280, "height": 720}):
        page.set_viewport_size(size)  # type: ignore[arg-type]
        assert page.evaluate(seen)


def test_the_key_stops_while_somebody_writes_and_a_refusal_is_shouted(
    site: Site, page: Page
) -> None:
    site.client.answer = Answer(False, "denied")
    page.locator("[data-do=note]").click()
    page.keyboard.type("oil on the fl")
    page.keyboard.press("F9")
    expect(page.locator("#stop-told")).to_contain_text("Stop not confirmed denied")
    expect(page.locator("#stop-told")).to_contain_text("emergency stop at the rig")
    assert site.client.sent == [("abort", "bench", "Anna", "")]
    site.client.answer = Answer(False, "nothing moves; the rig is disarmed")
    page.keyboard.press("F9")
    expect(page.locator("#stop-told.warn")).to_contain_text("bench: Nothing to stop")


def test_a_console_that_does_not_answer_is_reported_and_found_again(site: Site, page: Page) -> None:
    page.context.set_offline(True)
    page.evaluate("rigConsole.socket.close()")
    expect(page.locator("#life")).to_have_text("no console")
    page.locator("#stop").click()
    expect(page.locator("#stop-told")).to_contain_text("Stop not confirmed")
    page.context.set_offline(False)
    expect(page.locator("#life")).to_contain_text("live")
    assert site.client.sent == []


def test_enter_confirms_in_a_list_of_choices_too(site: Site, page: Page) -> None:
    page.locator("[data-do=skip]").click()
    expect(page.locator("#dialog select")).to_be_focused()
    page.keyboard.press("Enter")
    expect(page.locator("#dialog")).not_to_be_visible()
    until(lambda: site.client.sent == [("skip", "bench", "Anna", "first")], "the order")


def test_names_that_are_html_are_shown_as_text(site: Site, page: Page) -> None:
    name = "<img src=x onerror=alert(1)>"
    test = {"name": name, "expect": name, "status": name, "verdict": name}
    site.client.become(
        "bench",
        campaign={**RUNNING.campaign, "name": name, "tests": [test]},
        events=({"kind": name, "text": name, "at_ns": 10**18},),
    )
    site.client.shots[name] = replace(RUNNING, rig=name)
    expect(page.locator("#campaign-name")).to_contain_text(name)
    expect(page.locator("#tests")).to_contain_text(name)
    expect(page.locator("#events")).to_contain_text(name)
    expect(page.locator("#rig option")).to_have_text(["bench", name])
    assert page.locator("main img, #bar img").count() == 0
    assert page.evaluate("document.documentElement.scrollWidth") <= SMALL["width"]


def test_the_page_is_worked_by_keyboard_alone(site: Site, page: Page) -> None:
    page.reload()
    expect(page.locator("[data-do=hold]")).to_be_enabled()
    page.keyboard.press("Tab")
    assert page.evaluate("document.activeElement.id") == "stop"
    page.locator("[data-do=hold]").focus()
    page.keyboard.press("Enter")
    expect(page.locator("#dialog")).to_be_visible()
    page.keyboard.press("Escape")
    expect(page.locator("#dialog")).not_to_be_visible()
    assert site.client.sent == []
    assert page.evaluate("document.activeElement.dataset.do") == "hold"
    page.keyboard.press("Enter")
    page.keyboard.type("lunch")
    page.keyboard.press("Enter")
    until(lambda: site.client.sent == [("hold", "bench", "Anna: lunch", "")], "the hold")


@pytest.mark.parametrize("let_go", ["pointer", "blur"])
def test_hold_to_run_beats_while_it_is_held_and_stops_when_it_is_let_go(
    site: Site, page: Page, let_go: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    panel, sent = page.locator("#manual-card"), site.client.sent
    expect(panel).to_be_hidden()
    manual = {**RUNNING.campaign, "name": "manual", "activity": "manual", "tests": []}
    site.client.shots["bench"] = replace(RUNNING, campaign=manual)
    expect(panel).to_be_visible()
    page.get_by_role("button", name="Jog by").click()
    until(lambda: ("jog", "bench", "Anna: by 5mm speed 20mm/s", "") in sent, "the jog")
    page.get_by_role("button", name="Hold: out").hover()
    page.mouse.down()
    until(lambda: sum(each[0] == "beat" for each in sent) > 5, "heartbeats")
    plain, late, stop = FakeClient.send, Event(), ("jog", "bench", "Anna: stop", "")

    def send(self: FakeClient, command: str, *given: Any, **told: Any) -> Answer:
        answer = plain(self, command, *given, **told)
        if sent.count(stop) == 1 and "stop" in given[1]:
            late.wait(WAIT_MS / 1000)
        refusals = {
            "hold": "hold: the ram is not homed",
            "home": "home: the pump is unloaded; ask for `pump high` first",
            "generator mean": "speed: the wave takes up to 1.257 m/s",
        }
        why = [refusals[word] for word in refusals if f": {word}" in given[1]]
        return Answer(False, why[0]) if why else answer

    if let_go == "pointer":
        monkeypatch.setattr(FakeClient, "send", send)
        page.mouse.up()
    else:
        page.evaluate("dispatchEvent(new Event('blur'))")
    until(lambda: stop in sent, "the stop")
    assert ("jog", "bench", "Anna: hold out speed 20mm/s", "") in sent
    if let_go == "pointer":
        # That it rests is not all that is told of a hand that has moved nothing, and an answer that
        # comes late does not take the place of a newer one.
        said = page.locator("#manual-said")
        page.get_by_role("button", name="Hold: out").click()
        expect(said).to_have_text("hold out: the ram is not homed")
        with page.expect_response(lambda each: '"stop"' in (each.request.post_data or "")) as got:
            late.set()
        got.value.finished()
        page.evaluate("new Promise((resolve) => setTimeout(resolve, 100))")
        expect(said).to_have_text("hold out: the ram is not homed")
        page.get_by_role("button", name="Home").click()
        expect(said).to_have_text("Home: the pump is unloaded; press Load pump first")
        # What is not filled in is not asked for, and a refused change leaves no slider there.
        page.locator("#manual-to").fill("")
        page.get_by_role("button", name="Move to").click()
        expect(said).to_have_text("Position, mm: write a number")
        page.get_by_role("button", name="Begin wave").click()
        expect(said).to_contain_text("generator sine mean 300mm")
        page.locator("#manual-amplitude").fill("90")
        expect(said).to_contain_text("speed: the wave takes up to 1.257 m/s")
        expect(page.locator("#manual-amplitude")).to_have_value("20")
        page.locator("#manual-shape").select_option("chirp")
        page.locator("#manual-upto").fill("3")
        page.get_by_role("button", name="Begin wave").click()
        expect(said).to_contain_text("frequency 0.5Hz upto 3Hz sweep 10s: obeyed")
        # The rig says how a motion has ended, whoever sees the page.
        ended = "hold out: ended, as no heartbeat came in time, the ram is at 300.00 mm"
        site.client.shots["bench"] = replace(RUNNING, campaign=manual | {"moved": ended})
        expect(page.locator("#manual-moved")).to_have_text(ended.replace("hold out", "Hold: out"))
    else:
        # A hand that still presses after the rig has ended the motion beats no more, and is told.
        page.mouse.up()
        page.mouse.down()
        until(lambda: sum(": hold out" in each[2] for each in sent) == 2, "the second hold")
        expect(page.locator("#manual-said")).to_contain_text("hold out speed 20mm/s: obeyed")
        ended = "hold out: ended, as no heartbeat came in time, the ram is at 300.00 mm"
        site.client.shots["bench"] = replace(RUNNING, campaign=manual | {"moved": ended})
        expect(page.locator("#manual-said")).to_contain_text("press it again to go on")
        beats = sum(each[0] == "beat" for each in sent)
        page.evaluate("new Promise((resolve) => setTimeout(resolve, 300))")
        assert sum(each[0] == "beat" for each in sent) <= beats + 2
    page.locator("#holder-button").click()
    expect(page.get_by_role("button", name="Hold: out")).to_be_disabled()
    site.client.shots["bench"] = RUNNING
    expect(panel).to_be_hidden()


def test_a_finger_that_slides_off_what_it_holds_lets_go(site: Site, page: Page) -> None:
    sent = site.client.sent
    manual = {**RUNNING.campaign, "name": "manual", "activity": "manual", "tests": []}
    site.client.shots["bench"] = replace(RUNNING, campaign=manual)
    button = page.get_by_role("button", name="Hold: out")
    button.scroll_into_view_if_needed()
    box = button.bounding_box()
    assert box is not None
    screen = page.context.new_cdp_session(page)

    def touch(kind: str, *points: dict[str, float]) -> None:
        screen.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": [*points]})

    within = {"x": box["x"] + 5, "y": box["y"] + 5}
    touch("touchStart", within)
    until(lambda: sum(each[0] == "beat" for each in sent) > 2, "heartbeats")
    touch("touchMove", within | {"y": box["y"] + 2 * box["height"]})
    until(lambda: ("jog", "bench", "Anna: stop", "") in sent, "the stop")
    touch("touchEnd")


def test_nothing_of_the_bar_lies_under_stop_however_wide_the_window_is(
    site: Site, page: Page
) -> None:
    name = "a-bench-with-a-long-name"
    site.client.shots[name] = replace(RUNNING, rig=name)
    expect(page.locator("#rig option")).to_have_count(2)
    for width in (1280, 1100, 1024, 961, 960, 800, 721, 390):
        page.set_viewport_size({"width": width, "height": 700})
        under = """[...document.querySelectorAll('#bar > :not(#stop)')].filter((each) => {
          const stop = document.getElementById('stop').getBoundingClientRect();
          const { left, right, top, bottom, width } = each.getBoundingClientRect();
          const isBeside = right <= stop.left || left >= stop.right;
          return width > 0 && !isBeside && bottom > stop.top && top < stop.bottom;
        }).map((each) => each.id)"""
        assert page.evaluate(under) == [], width
