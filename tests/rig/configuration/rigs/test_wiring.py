"""The section `wiring` of rig files."""

from pathlib import Path

import pytest

from rig.configuration import ConfigError, editor_schema, load_rig, plain, wiring_lines
from rig.io import Wiring

FOUND = Wiring(valve="inverted", pressures="swapped")


def written(folder: Path, text: str) -> Path:
    path = folder / "rig.yaml"
    path.write_text(text)
    return path


def test_a_rig_is_wired_as_its_register_map_says_unless_its_file_tells_otherwise(
    tmp_path: Path,
) -> None:
    assert load_rig("emulated").wiring == Wiring()
    assert "wiring" not in plain(load_rig("emulated"))
    text = "name: r\nparent: emulated\nwiring: {valve: inverted, pressures: swapped}\n"
    assert load_rig(written(tmp_path, text)).wiring == FOUND


def test_the_lines_that_are_written_read_back(tmp_path: Path) -> None:
    lines = ["name: r", "parent: emulated", *wiring_lines(FOUND, "by hand")]
    assert load_rig(written(tmp_path, "\n".join(lines))).wiring == FOUND


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("parent: emulated\nwiring: {valv: inverted}\n", "valve"),
        ("parent: emulated\nwiring: {valve: swapped}\n", "inverted"),
        ("parent: simulated\nwiring: {valve: inverted}\n", "backend: hardware"),
        ("parent: emulated\nhoming: null\nwiring: {encoder: inverted}\n", "homing"),
    ],
)
def test_a_wiring_that_cannot_be_is_refused_with_its_line_and_remedy(
    tmp_path: Path, text: str, words: str
) -> None:
    path = written(tmp_path, "name: r\n" + text)
    with pytest.raises(ConfigError) as caught:
        load_rig(path)
    assert words in str(caught.value)
    assert "rig.yaml:" in str(caught.value)


def test_a_simulated_rig_does_not_inherit_wires(tmp_path: Path) -> None:
    (tmp_path / "hard.yaml").write_text("name: h\nparent: emulated\nwiring: {valve: inverted}\n")
    text = "name: r\nparent: hard.yaml\nbackend: simulated\n"
    assert load_rig(written(tmp_path, text)).wiring == Wiring()


def test_an_editor_knows_the_keys() -> None:
    schema = editor_schema("rig")
    assert "wiring" in schema["$defs"]["RigFile"]["properties"]
    assert set(schema["$defs"]["WiringFile"]["properties"]) == {
        "valve", "encoder", "spool", "pressures",
    }  # fmt: skip
