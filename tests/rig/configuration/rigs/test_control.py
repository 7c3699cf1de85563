"""The section `control` of rigs and tests: what the position loop adds, and what is refused."""

from pathlib import Path

import pytest

from control import ControlSettings
from rig.configuration import ConfigError, Rig, load_campaign, load_rig, plain
from tests.rig.configuration.campaigns.written import only_test, problems_of

SMALL = """
name: small
plant: nominal
limits: {position: [5 mm, 0.6 m], command: 10 V, pressure: 20 MPa}
"""


def load_text(folder: Path, text: str) -> Rig:
    path = folder / "rig.yaml"
    path.write_text(text)
    return load_rig(path)


def test_a_rig_has_the_thesis_s_loop_unless_it_says_otherwise(tmp_path: Path) -> None:
    assert load_text(tmp_path, SMALL).control.is_proportional
    given = load_text(tmp_path, SMALL + "control: {feedforward: model, null: 54 mV}\n")
    assert given.control == ControlSettings(feedforward="model", null=0.054)
    assert not given.control.is_proportional


def test_a_test_changes_the_keys_that_it_gives(tmp_path: Path) -> None:
    rig = tmp_path / "mine.yaml"
    rig.write_text("name: mine\nparent: simulated\ncontrol: {feedforward: model, cyclic: true}\n")
    campaign = tmp_path / "c.yaml"
    campaign.write_text(
        "name: c\nrig: mine.yaml\n"
        "defaults: {duration: 10 s, setpoint: {type: constant, value: 0.3 m}}\n"
        "tests:\n  - name: own\n    control: {cyclic: false}\n  - name: rig's\n"
        "  - name: thesis\n    control: proportional\n"
    )
    own, rigs, thesis = load_campaign(campaign)[0].tests
    assert own.control == ControlSettings(feedforward="model")
    assert rigs.control is None
    assert thesis.control == ControlSettings()


def test_what_has_no_control_of_its_own_is_recorded_as_before(tmp_path: Path) -> None:
    assert "control" not in plain(only_test(tmp_path))
    assert "control" not in plain(load_rig("simulated"))
    own = only_test(tmp_path, "control: {null: 50 mV}")
    assert plain(own)["control"]["null"] == 0.05


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        ("control: {feedforwrd: model}", "feedforward"),
        ("control: {feedforward: models}", "model"),
        ("control: {null: 5 V}", "2 V"),
        ("control: fast", "proportional"),
        ("control: {feedforward: model, feedforward_gain: 14 V s/m}", "feedforward: none"),
    ],
)
def test_a_law_that_there_is_not_is_refused_with_a_remedy(
    tmp_path: Path, keys: str, words: str
) -> None:
    (problem,) = problems_of(tmp_path, keys)
    assert "campaign.yaml:7" in problem
    assert words in problem


def test_a_rig_s_law_is_refused_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"rig\.yaml:5.*null"):
        load_text(tmp_path, SMALL + "control: {null: 5 V}\n")
