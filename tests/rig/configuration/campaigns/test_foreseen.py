"""What a test's file alone shows to be in vain is warned of before it runs."""

from pathlib import Path

import pytest

from rig.configuration.campaigns.campaign import load_campaign
from rig.configuration.campaigns.foreseen import (
    inconclusive_warnings,
    limit_warnings,
    setpoint_warnings,
    until_warnings,
)
from tests.rig.configuration.campaigns.written import HEAD, SINE, only_test

UNTIL = "until: {verdict: internal_leakage, at_most: 40 s}"


@pytest.mark.parametrize(("last_s", "warns"), [(5, True), (39.9, False), (60, False)])
def test_a_setpoint_file_that_ends_before_its_test_is_warned_of(
    tmp_path: Path, last_s: float, warns: bool
) -> None:
    (tmp_path / "motion.csv").write_text(f"time_s,position_m\n0,0.2\n{last_s},0.3\n")
    test = only_test(tmp_path, setpoint="{type: file, path: motion.csv}")
    warnings = list(setpoint_warnings(test))
    assert bool(warnings) == warns
    if warns:
        assert warnings[0].startswith("the setpoint file motion.csv ends at 5 s of 40 s")


@pytest.mark.parametrize(
    ("keys", "warns"),
    [("expect: healthy", True), ("expect: internal_leakage", False)],
)
def test_a_test_that_awaits_a_leak_and_is_to_be_healthy_is_warned_of(
    tmp_path: Path, keys: str, warns: bool
) -> None:
    text = f"{HEAD}tests:\n  - name: a\n    setpoint: {SINE}\n    {UNTIL}\n    {keys}\n"
    (tmp_path / "campaign.yaml").write_text(text)
    (test,) = load_campaign(tmp_path / "campaign.yaml")[0].tests
    warnings = list(until_warnings(test))
    assert bool(warnings) == warns
    if warns:
        assert "write `expect: internal_leakage`" in warnings[0]


@pytest.mark.parametrize(
    ("keys", "ends"),
    [
        ("channel: position_m, high: 0.65 m", ["high 0.65 m"]),
        ("channel: position_m, low: 1 mm, high: 0.5 m", ["low 1 mm"]),
        ("figure: peak, channel: pressure_1_Pa, inner_high: 90 MPa, action: warn", ["inner_high"]),
        ("channel: position_m, low: 0.1 m, high: 0.6 m", []),
        ("channel: load_N, high: 100 kN", []),
    ],
)
def test_a_limit_beyond_the_rigs_own_is_warned_of(
    tmp_path: Path, keys: str, ends: list[str]
) -> None:
    only_test(tmp_path, f"limits:\n  - {{{keys}}}")
    campaign, rig = load_campaign(tmp_path / "campaign.yaml")
    warnings = list(limit_warnings(campaign.tests[0], rig))
    assert len(warnings) == len(ends)
    for warning, end in zip(warnings, ends, strict=True):
        assert end in warning
        assert "is never reached: the rig's own limit at" in warning


@pytest.mark.parametrize(
    ("setpoint", "keys", "warns"),
    [
        ("{type: steps, levels: [0.2 m, 0.4 m], hold: 5 s}", "", True),
        ("{type: constant, value: 0.3 m}", "", True),
        ("{type: constant, value: 0.3 m}", "expect: inconclusive", False),
        ("{type: steps, levels: [0.2 m, 0.4 m], hold: 19 s}", "", False),
        (SINE, "", False),
    ],
)
def test_a_ram_that_comes_to_rest_too_early_for_a_healthy_verdict_is_warned_of(
    tmp_path: Path, setpoint: str, keys: str, warns: bool
) -> None:
    text = f"{HEAD}tests:\n  - name: a\n    duration: 40 s\n    setpoint: {setpoint}\n    {keys}\n"
    (tmp_path / "campaign.yaml").write_text(text)
    campaign, _ = load_campaign(tmp_path / "campaign.yaml")
    warnings = list(inconclusive_warnings(campaign.tests[0], campaign.model, "product"))
    assert bool(warnings) == warns
    if warns:
        assert "will be `inconclusive`, so that it fails: the ram moves by 0 mm" in warnings[0]
        assert "from 3.377 mm on" in warnings[0]
