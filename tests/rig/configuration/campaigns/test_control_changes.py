"""The `control_changes` of a test: read in turn, checked with line, value, limit and remedy."""

from pathlib import Path

import pytest

from control import ControlSettings
from rig.configuration import plain, plan_campaign
from rig.configuration.campaigns.campaign import load_campaign
from tests.rig.configuration.campaigns.written import HEAD, TEST, load, only_test, problems_of

CHANGES = """\
position_gain: 60 V/m
control_changes:
  - {at: 12 s, control: {gain: 80 V/m, integral_time: 1 s}}
  - {at: 20 s, control: {cyclic: true}}
  - {at: 30 s, control: proportional}
"""


def test_keys_that_a_change_does_not_give_are_those_before_it(tmp_path: Path) -> None:
    changes = only_test(tmp_path, CHANGES).control_changes
    assert [each.at_s for each in changes] == [12.0, 20.0, 30.0]
    assert changes[1].control == ControlSettings(gain=80.0, integral_time=1.0, cyclic=True)
    assert changes[2].control == ControlSettings()


def test_a_test_without_changes_is_recorded_as_before(tmp_path: Path) -> None:
    assert "control_changes" not in plain(only_test(tmp_path))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("{at: 0 s, control: {gain: 80 V/m}}", "at: 0 s is not after the begin of the test at 0 s"),
        ("{at: 40 s, control: {gain: 80 V/m}}", "is not before the end of the test at 40 s"),
        ("{at: 12 s}", "control"),
        ("{at: 12 s, control: {}}", "control: an empty mapping changes nothing; give a key"),
        ("{at: 12 s, control: {gan: 80 V/m}}", "did you mean gain?"),
        ("{at: 12, control: {gain: 80 V/m}}", "12 has no unit"),
        ("{at: 12 s, gain: 80 V/m, control: proportional}", "gain: is not a known key"),
    ],
)
def test_a_change_that_cannot_be_is_refused(tmp_path: Path, change: str, words: str) -> None:
    (problem,) = problems_of(tmp_path, f"control_changes:\n  - {change}")
    assert problem.startswith("campaign.yaml:8")
    assert words in problem


def test_a_change_before_the_one_above_it_is_refused(tmp_path: Path) -> None:
    change = "\n  - {at: 12 s, control: {gain: 80 V/m}}"
    (problem,) = problems_of(tmp_path, f"control_changes:{change}{change}")
    assert "campaign.yaml:9" in problem
    assert "is not after the change before at 12 s" in problem


def test_an_open_loop_has_no_control_to_change(tmp_path: Path) -> None:
    volts = "{type: sine, mean: 0 V, amplitude: 2 V, frequency: 0.5 Hz}"
    keys = "start_position: 0.3 m\ncontrol_changes:\n  - {at: 12 s, control: proportional}"
    (problem,) = problems_of(tmp_path, keys, volts)
    assert "control_changes" in problem
    assert "needs a position loop" in problem


def test_the_dry_run_tells_the_changes_and_warns_of_too_little_margin(tmp_path: Path) -> None:
    hot = CHANGES.replace("{cyclic: true}", "{gain: 2000 V/m}")
    load(tmp_path, HEAD + TEST + "".join(f"    {line}\n" for line in hot.splitlines()))
    (planned,) = plan_campaign(*load_campaign(tmp_path / "campaign.yaml")[:2])
    lines = planned.lines()
    assert "  control from 12 s: gain 80 V/m, integral_time 1 s" in lines
    assert "  control from 30 s: gain times error alone" in lines
    (warning,) = planned.warnings
    assert warning.startswith("the control from 20 s leaves no margin at all by the model")
