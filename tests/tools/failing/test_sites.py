"""Each call of the system that a run makes may fail once, and the run stays safe and truthful."""

import json
import random
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import pytest

from rig.configuration import load_campaign
from rig.runner import CampaignOutcome, run_campaign
from tools.failing.injection import Injection, Order, Site
from tools.failing.judging import Ended, problems_of
from tools.failing.trying import noted

CAMPAIGN = """\
name: failing
rig: simulated
model: nominal
defaults: {duration: 5 s, settle: 0.2 s, setpoint: {type: constant, value: 0.3 m}}
tests: [{name: one, expect: inconclusive}]
"""
SEED = 20


class Reached(NamedTuple):
    campaign: Path
    sites: list[Site]


def run(campaign: Path, out: Path) -> CampaignOutcome:
    loaded, rig = load_campaign(str(campaign))
    return run_campaign(loaded, rig, out, pace="fast", resume=(out / "journal.jsonl").exists())


@pytest.fixture(scope="module")
def reached(tmp_path_factory: pytest.TempPathFactory) -> Reached:
    folder = tmp_path_factory.mktemp("failing")
    campaign = folder / "campaign.yaml"
    campaign.write_text(CAMPAIGN)
    with Injection(Order(str(folder / "notes"))):
        assert run(campaign, folder / "out").exit_code == 0
    return Reached(campaign, list(dict.fromkeys(site for site, _ in noted(folder / "notes"))))


def tried(reached: Reached, site: Site, folder: Path) -> int:
    """Let a site fail; return the run's exit code, 3 for an error that ends it."""
    with Injection(Order(str(folder / "notes"), site)):
        code = 3
        with suppress(OSError):
            code = int(run(reached.campaign, folder / "out").exit_code)
    assert [fails for _, fails in noted(folder / "notes")] == [True]
    assert problems_of(Ended(code, "told"), folder / "out", {}, reported=False) == []
    if code:
        assert run(reached.campaign, folder / "out").exit_code == 0
    return code


def named(reached: Reached, kind: str, function: str) -> Site:
    """Return the one site of a kind of call in a function."""
    (site,) = (each for each in reached.sites if (each.kind, each.function) == (kind, function))
    return site


def test_a_run_reaches_every_kind_of_call_that_it_makes(reached: Reached) -> None:
    kinds = {site.kind for site in reached.sites}
    made = {"open", "create", "write", "fsync", "rename", "mkdir", "socket", "bind", "thread"}
    assert made <= kinds


def test_a_few_sites_that_are_drawn_fail_without_harm(reached: Reached, tmp_path: Path) -> None:
    for number, site in enumerate(random.Random(SEED).sample(reached.sites, 3)):
        (tmp_path / str(number)).mkdir()
        tried(reached, site, tmp_path / str(number))


def test_a_run_whose_results_once_could_not_be_written_does_not_say_that_it_passed(
    reached: Reached, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("rig.runner.campaign.campaign_run._WRITE_EVERY_S", -1.0)
    monkeypatch.setattr("rig.runner.campaign.campaign_run._WRITE_PART", float("inf"))
    site = named(reached, "rename", "write_junit")
    # The first time they are written as the run begins, the second time after its test.
    with (
        Injection(Order(str(tmp_path / "notes"), site, 1)),
        pytest.raises(OSError, match="Input/output"),
    ):
        run(reached.campaign, tmp_path / "out")
    assert json.loads((tmp_path / "out" / "results.json").read_text())["exit_code"] == 3


def test_without_a_thread_for_its_deadline_the_rig_is_made_safe_all_the_same(
    reached: Reached, tmp_path: Path
) -> None:
    assert tried(reached, named(reached, "thread", "_left_safe"), tmp_path) == 0


def test_without_a_thread_for_the_friction_the_run_stops_and_can_go_on(
    reached: Reached, tmp_path: Path
) -> None:
    assert tried(reached, named(reached, "thread", "_identified"), tmp_path) == 3
