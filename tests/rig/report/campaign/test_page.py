import json
import shutil
from collections.abc import Callable
from dataclasses import dataclass, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import plotly.graph_objects as go
import pytest
from plotly.offline import get_plotlyjs

from rig.report import render, write_report
from rig.runner.outcomes.outcome import CampaignOutcome, Status, TestOutcome

CampaignOf = Callable[..., CampaignOutcome]

EVIL = "</script><script>alert('x')</script><b onmouseover=alert(1)>"


@dataclass(frozen=True)
class Tag:
    name: str
    attributes: dict[str, str | None]


class Page(HTMLParser):
    """What a browser would see in a page: its tags, its text and the content of its scripts."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[Tag] = []
        self.text = ""
        self.scripts: list[str] = []
        # Parsing 5 MB of plotly in Python would take a second and show nothing.
        self.feed(page.replace(get_plotlyjs(), "/* plotly.js */"))
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(Tag(tag, dict(attrs)))
        if tag == "script":
            self.scripts.append("")

    def handle_data(self, data: str) -> None:
        if self.tags and self.tags[-1].name == "script":
            self.scripts[-1] += data
        elif self.tags and self.tags[-1].name != "style":
            self.text += data

    def handle_endtag(self, tag: str) -> None:
        if tag in ("script", "style"):
            self.tags.append(Tag("/" + tag, {}))

    def all(self, name: str) -> list[dict[str, str | None]]:
        return [tag.attributes for tag in self.tags if tag.name == name]

    def figures(self) -> list[dict[str, Any]]:
        kinds = [attributes.get("type") for attributes in self.all("script")]
        return [
            json.loads(script)
            for kind, script in zip(kinds, self.scripts, strict=True)
            if kind == "application/json"
        ]


@pytest.fixture(scope="module")
def outcome(healthy: TestOutcome, leaking: TestOutcome, campaign: CampaignOf) -> CampaignOutcome:
    return campaign(healthy, leaking)


@pytest.fixture(scope="module")
def source(outcome: CampaignOutcome, run_directory: Path) -> str:
    return render(outcome, run_directory)


@pytest.fixture(scope="module")
def page(source: str) -> Page:
    return Page(source)


def test_the_report_is_one_file_that_fetches_nothing(source: str, page: Page) -> None:
    linked = [
        value or ""
        for tag in page.tags
        for name, value in tag.attributes.items()
        if name in ("src", "href", "srcset", "action", "data")
    ]
    assert all(link.startswith(("#", "data:")) for link in linked)
    policy = next(m for m in page.all("meta") if m.get("http-equiv") == "Content-Security-Policy")
    assert str(policy["content"]).startswith("default-src 'none';")
    assert "http" not in str(policy["content"])
    assert source.count(get_plotlyjs()) == 1


def test_the_plotting_library_comes_after_all_there_is_to_read(source: str) -> None:
    assert source.index("<footer>") < source.index(get_plotlyjs())


def test_a_test_of_20_s_adds_less_than_half_a_megabyte_to_the_page(source: str) -> None:
    assert len(source) - len(get_plotlyjs()) < 2 * 0.5e6


def test_every_plot_is_one_that_plotly_accepts(page: Page) -> None:
    figures = page.figures()
    assert len(figures) == 2
    for figure in figures:
        assert figure["panels"]
        for panel in figure["panels"].values():
            assert len(go.Figure(data=panel["traces"]).data) == len(panel["traces"])


def test_every_colour_a_plot_asks_for_is_in_the_style_sheet(source: str, page: Page) -> None:
    roles = {
        trace["meta"]["role"]
        for figure in page.figures()
        for panel in figure["panels"].values()
        for trace in panel["traces"]
    }
    assert {"chamber_1", "chamber_2", "found"} <= roles
    # Once for light and once for dark screens.
    assert all(source.count(f"--{role}: #") == 2 for role in roles)


def test_the_verdict_table_says_injected_found_and_passed_in_words_and_signs(page: Page) -> None:
    assert "✓ passed" in " ".join(page.text.split())
    assert "external leak 1" in page.text
    assert "from 8.0 s" in page.text
    assert "All 2 tests came out as expected." in page.text


def test_only_the_leak_test_is_unfolded_at_first(page: Page) -> None:
    tests = [test for test in page.all("details") if test.get("class") == "test"]
    assert ["open" in test for test in tests] == [False, True]


def test_each_test_in_the_table_leads_to_its_section(page: Page) -> None:
    anchors = [test["id"] for test in page.all("details") if test.get("class") == "test"]
    links = [link["href"] for link in page.all("a")]
    assert links == [f"#{anchor}" for anchor in anchors]


def test_the_keys_of_a_plot_can_be_reached_by_keyboard(page: Page) -> None:
    keys = [button for button in page.all("button") if button.get("class") == "key"]
    shown = sum(
        len(panel["traces"]) for figure in page.figures() for panel in figure["panels"].values()
    )
    assert len(keys) == shown
    assert all(key["aria-pressed"] == "true" for key in keys)


def test_the_campaign_can_be_run_again_from_what_the_page_says(page: Page) -> None:
    assert "rig run trial.yaml" in page.text
    assert "ab" * 32 in page.text
    assert "1 in 2,160" in page.text


def test_a_recorded_command_line_takes_precedence(
    campaign: CampaignOf, run_directory: Path
) -> None:
    reported = {"command": ["rig", "run", "my campaign.yaml", "--rig", "thesis"]}
    text = Page(render(campaign(provenance=reported), run_directory)).text
    assert "rig run 'my campaign.yaml' --rig thesis" in text


def test_names_and_messages_are_text_whatever_they_hold(
    leaking: TestOutcome, campaign: CampaignOf, run_directory: Path
) -> None:
    evil = replace(leaking, name=EVIL, status=Status.ERROR, message=EVIL)
    outcome = campaign(evil, name=EVIL, description=EVIL, provenance={EVIL: [EVIL]})
    hostile, harmless = (
        Page(render(shown, run_directory)) for shown in (outcome, campaign(leaking))
    )
    assert len(hostile.all("script")) == len(harmless.all("script"))
    assert not any("onmouseover" in tag.attributes for tag in hostile.tags)
    assert hostile.text.count(EVIL) >= 5
    assert hostile.figures()


def test_tests_that_did_not_end_well_are_shown_with_their_message(
    leaking: TestOutcome, campaign: CampaignOf, run_directory: Path
) -> None:
    crashed = replace(
        leaking, status=Status.ERROR, message="ValueError: valve stuck", decision=None
    )
    aborted = replace(leaking, status=Status.ABORTED, message="stopped by SIGINT")
    never = replace(leaking, status=Status.NOT_RUN, decision=None, injected=(), recording=None)
    page = Page(render(campaign(leaking, crashed, aborted, never), run_directory))
    words = " ".join(page.text.split())
    assert "1 of 4 tests came out as expected." in words
    for reported in ("! error", "■ aborted", "– not run", "valve stuck", "stopped by SIGINT"):
        assert reported in words


def test_a_campaign_stopped_before_its_first_test_still_has_a_report(
    campaign: CampaignOf, tmp_path: Path
) -> None:
    page = Page(render(campaign(description="", provenance={}), tmp_path))
    assert "The campaign has no tests." in page.text


def test_a_report_replaces_an_earlier_one_and_leaves_nothing_else(
    leaking: TestOutcome, campaign: CampaignOf, run_directory: Path, tmp_path: Path
) -> None:
    assert leaking.recording is not None
    shutil.copy(run_directory / leaking.recording, tmp_path)
    (tmp_path / "report.html").write_text("earlier")
    path = write_report(campaign(leaking), tmp_path)
    assert path == tmp_path / "report.html"
    assert path.read_text(encoding="utf-8").startswith("<!doctype html>")
    assert {file.name for file in tmp_path.iterdir()} == {"report.html", leaking.recording}
