"""A report from what a run kept is the one from its recordings."""

from dataclasses import asdict
from pathlib import Path

import pytest

from estimator.evidence import KeptAccounts
from estimator.leaks import Decision, OilAccountDetector, PatternDetector
from rig.configuration import load_campaign
from rig.plant import Model
from rig.report import render
from rig.runner import CampaignOutcome, run_campaign

CAMPAIGN = """
name: kept
description: Two short tests.
rig: simulated
model: nominal
detector: {filter: product, false_alarms_per_day: 1}
defaults:
  duration: 13.2 s
  settle: 1 s
  setpoint: {type: sine, mean: 0.3 m, amplitude: 0.2 m, frequency: 0.5 Hz}
tests:
  - {name: healthy}
  - name: leaking
    faults: [{type: external_leakage_1, at: 3 s, flow: 0.8 L/min, pressure: 6.9 MPa}]
"""


@pytest.fixture(scope="module")
def ran(tmp_path_factory: pytest.TempPathFactory) -> tuple[CampaignOutcome, Path, KeptAccounts]:
    folder = tmp_path_factory.mktemp("kept")
    (folder / "kept.yaml").write_text(CAMPAIGN)
    campaign, rig = load_campaign(str(folder / "kept.yaml"))
    kept = KeptAccounts()
    outcome = run_campaign(campaign, rig, folder / "run", pace="fast", kept=kept)
    return outcome, folder / "run", kept


def test_the_page_is_the_same_from_what_was_kept(
    ran: tuple[CampaignOutcome, Path, KeptAccounts],
) -> None:
    outcome, folder, kept = ran
    assert [str(test.status) for test in outcome.tests] == ["passed", "passed"]
    assert all(kept.history(str(test.recording)) is not None for test in outcome.tests)
    assert render(outcome, folder, kept) == render(outcome, folder)


def test_a_test_without_oil_accounts_keeps_none() -> None:
    kept = KeptAccounts()
    kept.begins("thesis.mcap", PatternDetector(1.0))
    kept.take(0.5, Decision("healthy"))
    assert kept.history("thesis.mcap") is None


def test_a_second_attempt_replaces_what_was_kept(
    ran: tuple[CampaignOutcome, Path, KeptAccounts],
) -> None:
    _, _, kept = ran
    kept.begins("leaking.mcap", OilAccountDetector(Model()))
    assert kept.history("leaking.mcap") is None
    healthy = kept.history("healthy.mcap")
    assert healthy is not None
    assert set(asdict(healthy)) >= {"missing", "statistic"}
