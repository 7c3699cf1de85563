"""A criterion that can never be met is warned of before its test runs."""

from pathlib import Path

import pytest

from rig.configuration.campaigns.campaign import load_campaign
from rig.configuration.campaigns.foreseen import criterion_warnings
from tests.rig.configuration.campaigns.written import SINE, only_test

STEPS = "{type: steps, levels: [0.2 m, 0.4 m], hold: 20 s}"


@pytest.mark.parametrize(
    ("keys", "setpoint", "said"),
    [
        ("figure: rms_error, at_most: -1 mm", SINE, "and never below 0; give 0 or more"),
        ("figure: leak, at_most: -1 L/min", SINE, "and never below 0"),
        ("figure: residual_pressure_1, at_most: -1 Pa", SINE, "and never below 0"),
        ("figure: peak, channel: following_error_m, at_most: -1 mm", SINE, "never below 0"),
        ("figure: valley, at_most: -1 mm", SINE, ""),
        ("figure: settling, at_most: 1 s", SINE, "there is no step, a jump of the setpoint by"),
        ("figure: overshoot, at_most: 1 %", STEPS, ""),
        ("figure: overshoot, at_most: 1 %, until_time: 19 s", STEPS, "there is no step"),
        ("figure: loop_wakeup_p99, at_most: 1 ms", SINE, "simulated rig runs by no clock"),
        ("figure: loop_missed, at_least: 2", SINE, "a share of the ticks, at most 1"),
        ("figure: friction_coulomb, at_most: 900 N", SINE, ""),
    ],
)
def test_a_criterion_that_is_never_met_is_warned_of(
    tmp_path: Path, keys: str, setpoint: str, said: str
) -> None:
    only_test(tmp_path, f"criteria:\n  - {{{keys}}}", setpoint)
    campaign, rig = load_campaign(tmp_path / "campaign.yaml")
    warnings = list(criterion_warnings(campaign.tests[0], rig, campaign.filter_name))
    assert len(warnings) == bool(said)
    if said:
        assert warnings[0].startswith("the criterion ")
        assert said in warnings[0]


def test_friction_is_not_known_by_a_filter_that_estimates_no_load(tmp_path: Path) -> None:
    only_test(tmp_path, "criteria:\n  - {figure: friction_coulomb, at_most: 900 N}")
    campaign, rig = load_campaign(tmp_path / "campaign.yaml")
    (warning,) = criterion_warnings(campaign.tests[0], rig, "thesis-6")
    assert "thesis-6 does not estimate the load" in warning
