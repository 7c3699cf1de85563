"""Tests of a campaign file that lock the cylinder: their keys, and what is foreseen of them."""

from pathlib import Path

import pytest

from faults import CampaignTest, LeakTestStep, Verdict
from rig.configuration import ConfigError, load_campaign, plan_campaign
from rig.plant import LITRE_PER_MINUTE

CAMPAIGN = """
name: locked
rig: {rig}
defaults: {{duration: 10 s, on_fault: trip, setpoint: {{type: constant, value: 0.3 m}}}}
tests:
  - {{{test}}}
"""


def read(folder: Path, test: str, rig: str = "locked") -> tuple[CampaignTest, ...]:
    path = folder / "locked.yaml"
    path.write_text(CAMPAIGN.format(rig=rig, test=test))
    return load_campaign(path)[0].tests


def test_a_leak_test_takes_no_default_that_is_about_a_motion(tmp_path: Path) -> None:
    (test,) = read(tmp_path, "name: a, leak_test: {}")
    assert test.leak_test == LeakTestStep()
    assert (test.expect, test.faults, str(test.on_fault)) == (Verdict.HEALTHY, (), "ignore")


def test_a_size_decides_in_place_of_the_verdict_unless_one_is_expected(tmp_path: Path) -> None:
    sized = "name: a, repeats: 2, leak_test: {at_most: 0.002 L/min}"
    first, second = read(tmp_path, sized)
    assert first.leak_test == LeakTestStep(
        at_most_m3_per_s=0.002 * LITRE_PER_MINUTE, judges_verdict=False
    )
    assert (first.name, second.name, second.seed) == ("a #1", "a #2", first.seed + 1)
    (both,) = read(tmp_path, "name: a, expect: healthy, leak_test: {at_most: 0.002 L/min}")
    assert both.leak_test is not None
    assert both.leak_test.judges_verdict


MISTAKES = {
    "name: a, leak_test: true": "is not a mapping; keys: at_most, could_see",
    "name: a, leak_test: {at_most: 0.00001 L/min}": "is below 0.0001 L/min",
    "name: a, leak_test: {see: 0.001 L/min}": "see: is not a known key",
    "name: a, leak_test: {}, duration: 20 s": "does not go with leak_test",
    "name: a, leak_test: {}, expect: return_blockage": "is nothing that a leak test finds",
    "name: a, segments: [{leak_test: {}}]": "write a test of its own",
}


@pytest.mark.parametrize("test", MISTAKES)
def test_a_mistake_is_reported_with_its_line_and_remedy(tmp_path: Path, test: str) -> None:
    with pytest.raises(ConfigError) as caught:
        read(tmp_path, test)
    assert "locked.yaml:6" in str(caught.value)
    assert MISTAKES[test] in str(caught.value)


def test_a_rig_without_blocking_valves_is_refused_with_the_remedy(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"needs blocking valves.*config/rigs/locked\.yaml"):
        read(tmp_path, "name: a, leak_test: {}", rig="simulated")


def test_the_dry_run_says_what_the_test_will_see_and_what_it_cannot(tmp_path: Path) -> None:
    path = tmp_path / "locked.yaml"
    test = "name: a, leak_test: {could_see: 0.0005 L/min, at_most: 0.002 L/min}"
    path.write_text(CAMPAIGN.format(rig="locked", test=test))
    (plan,) = plan_campaign(*load_campaign(path))
    assert any("could see external_leakage_1 0.00096" in line for line in plan.lines())
    (warning,) = plan.warnings
    assert "could_see 0.0005 L/min is less than what is to be expected" in warning
