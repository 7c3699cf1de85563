"""Single values of a rig file are changed, and everything else in it stays as it was."""

from pathlib import Path

import pytest
import yaml

from rig.configuration.rigs.writing import section_text, with_section, with_value, with_values

TEXT = """\
name: bench   # of mine
parent: emulated
limits:
  position: [5 mm, 0.6 m]   # within the stroke
  command: 10 V
  channels:
    - {channel: load_N, high: 20 kN, action: trip}
plant: nominal  # as the maker says
homing: {end: retract, command: 0.5 V}  # gently
"""


@pytest.mark.parametrize(
    ("path", "value", "changed"),
    [
        (("limits", "position"), "[5 mm, 0.5 m]",
         ("position: [5 mm, 0.6 m]   # within", "position: [5 mm, 0.5 m]   # within")),
        (("limits", "pressure"), "20 MPa",
         ("  position: [", "  pressure: 20 MPa\n  position: [")),
        (("homing", "command"), "0.4 V", ("command: 0.5 V}", "command: 0.4 V}")),
        (("homing", "timeout"), "30 s", ("{end:", "{timeout: 30 s, end:")),
        (("plant", "parameters", "stroke_max"), "0.5 m",
         ("plant: nominal  #", "plant: {model: nominal, parameters: {stroke_max: 0.5 m}}  #")),
        (("loop", "cpu"), "1", ("# gently\n", "# gently\n\nloop: {cpu: 1}\n")),
    ],
)  # fmt: skip
def test_one_value_changes_and_all_else_stays(
    path: tuple[str, ...], value: str, changed: tuple[str, str]
) -> None:
    text = with_value(TEXT, path, value)
    assert text == TEXT.replace(*changed)
    found = yaml.safe_load(text)
    for key in path:
        found = found[key]
    assert found == yaml.safe_load(value)


def test_an_empty_section_and_a_block_list_are_filled() -> None:
    assert with_value("a:\nb: 1\n", ("a", "x"), "2") == "a: {x: 2}\nb: 1\n"
    text = "limits:\n  position:\n    - 5 mm\n    - 0.6 m\n  command: 10 V\n"
    changed = yaml.safe_load(with_value(text, ("limits", "position"), "[1 mm, 2 mm]"))
    assert changed == {"limits": {"position": ["1 mm", "2 mm"], "command": "10 V"}}


def test_a_section_replaces_itself_and_the_program_s_own_comment_above_it() -> None:
    first = with_section(
        TEXT, "wiring", ["# by rig commission, once", "wiring:", "  valve: normal"]
    )
    assert first.startswith(TEXT)
    again = ["# by rig commission, again", "wiring:", "  valve: inverted"]
    second = with_section(first, "wiring", again, "by rig ")
    assert second == first.replace("once", "again").replace("valve: normal", "valve: inverted")


def test_an_inherited_section_is_copied_with_its_comments_before_a_value_in_it_changes(
    tmp_path: Path,
) -> None:
    file = tmp_path / "rig.yaml"
    file.write_text(TEXT)
    inherited = section_text(file, "sensors")
    assert inherited is not None
    text = with_values(TEXT, file, {("sensors", "spool_noise"): "2 um"}, "as in the parent")
    assert text == f"{TEXT}\n# as in the parent\n{inherited}".replace(
        "spool_noise: 1 um", "spool_noise: 2 um"
    )
    assert section_text(file, "nothing") is None
