"""Conditions of a campaign file: what holds it, checked against what the rig measures."""

from itertools import pairwise
from pathlib import Path

import pytest

from faults.campaign import Condition, WhenUnmet
from rig.configuration import ConfigError, load_campaign
from rig.configuration.campaigns.conditions import measured_by
from rig.configuration.rigs.rig import load_rig

CAMPAIGN = """
name: held
rig: {rig}
conditions:
{conditions}
tests:
  - name: healthy
    duration: 10 s
    setpoint: {{type: constant, value: 0.3 m}}
"""


def conditions_of(folder: Path, *lines: str, rig: str = "emulated") -> tuple[Condition, ...]:
    path = folder / "held.yaml"
    listed = "\n".join(f"  - {{{line}}}" for line in lines)
    path.write_text(CAMPAIGN.format(rig=rig, conditions=listed))
    return load_campaign(path)[0].conditions


def test_limits_are_read_in_the_channel_s_unit_with_their_defaults(tmp_path: Path) -> None:
    pressure, warm = conditions_of(
        tmp_path,
        "channel: supply_pressure_Pa, low: 12 MPa, hysteresis: 5 bar, for: 2 s, action: interrupt",
        "channel: oil_temperature_K, high: 330 K, give_up: 20 min",
    )
    assert pressure == Condition(
        "supply_pressure_Pa", low=12e6, hysteresis=5e5, for_s=2.0, action=WhenUnmet.INTERRUPT
    )
    assert warm == Condition("oil_temperature_K", high=330.0, give_up_s=1200.0)


MISTAKES = {
    "channel: oil_temperature, high: 330 K": "did you mean oil_temperature_K?",
    "channel: oil_temperature_K, hihg: 330 K": "did you mean high?",
    "channel: oil_temperature_K": "has no limit",
    "channel: supply_pressure_Pa, low: 12 MPa, high: 11 MPa": "low must be below high",
    "channel: supply_pressure_Pa, low: 12 MPa, high: 13 MPa, hysteresis: 6 bar": "leaves nothing",
    "channel: supply_pressure_Pa, low: 12 mm": "is not a pressure",
    "channel: supply_pressure_Pa, low: 12 MPa, action: run away": "choose one of finish, interrupt",
    "high: 330": "lacks the key channel",
}


@pytest.mark.parametrize("line", MISTAKES)
def test_a_mistake_is_reported_with_its_line_and_remedy(tmp_path: Path, line: str) -> None:
    with pytest.raises(ConfigError) as caught:
        conditions_of(tmp_path, line)
    assert "held.yaml:5" in str(caught.value)
    assert MISTAKES[line] in str(caught.value)


def test_what_a_rig_does_not_measure_cannot_hold_its_campaign(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is not measured by this rig"):
        conditions_of(tmp_path, "channel: oil_temperature_K, high: 330 K", rig="simulated")
    assert "oil_temperature_K" in measured_by(load_rig("emulated"))
    assert "oil_temperature_K" not in measured_by(load_rig("simulated"))


def test_conditions_that_are_no_list_are_reported(tmp_path: Path) -> None:
    path = tmp_path / "held.yaml"
    text = CAMPAIGN.format(rig="simulated", conditions="  channel: position_m")
    path.write_text(text)
    with pytest.raises(ConfigError, match="is not a list"):
        load_campaign(path)


def test_yaml_whose_aliases_unfold_without_bound_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "rig.configuration.reading.document.MAX_VALUES", 5000
    )  # the true limit takes long
    levels = ["a: &a [x, x, x, x, x, x, x, x, x, x]"]
    names = "abcdefghij"
    for below, name in pairwise(names):
        levels.append(f"{name}: &{name} [{', '.join([f'*{below}'] * 10)}]")
    path = tmp_path / "bomb.yaml"
    path.write_text("\n".join(["name: bomb", "rig: simulated", *levels, "tests: *j", ""]))
    with pytest.raises(ConfigError, match="nested too deeply, too large, or contains itself"):
        load_campaign(path)
    path.write_text("name: loop\nrig: simulated\ntests: &t\n  - *t\n")
    with pytest.raises(ConfigError, match="contains itself"):
        load_campaign(path)
