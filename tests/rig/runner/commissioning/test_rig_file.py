"""What was found is written into the rig file, with a backup, and nothing else is touched."""

from datetime import UTC, datetime
from pathlib import Path

import pytest

from rig.configuration import ConfigError, NotAsMeantError, Rig, load_rig, rewrite_rig
from rig.io.wiring import Wiring
from rig.runner.commissioning.findings import Changes
from rig.runner.commissioning.rig_file import write_rig_file

BEGUN = datetime(2026, 3, 2, 9, 15, tzinfo=UTC)
TEXT = """\
# A rig of mine.
name: mine
parent: emulated   # and all that it has
control: {feedforward: model}
"""
EVERYTHING = Changes(
    Wiring(valve="inverted", pressures="swapped"), -0.121, {"pressure_noise": 45e3}, 0.52, 0.51
)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "mine.yaml"
    path.write_text(TEXT)
    return path


def test_everything_that_was_found_reads_back_and_comments_stay(file: Path) -> None:
    before = load_rig(file)
    lines = write_rig_file(file, None, before, EVERYTHING, BEGUN)
    backup = file.with_name("mine.yaml.20260302T091500Z.bak")
    assert lines == [f"backup: {backup}", f"rig file: {file}"]
    assert backup.read_text() == TEXT
    after = load_rig(file)
    assert after.wiring == EVERYTHING.wiring
    assert (after.control.null, after.control.feedforward) == (-0.121, "model")
    assert after.sensors == before.sensors._replace(pressure_noise=45e3)
    assert after.plant.parameters.stroke_max == 0.52
    assert after.limits.position_max_m == 0.51
    assert after.drivers == before.drivers
    text = file.read_text()
    assert text.startswith("# A rig of mine.\nname: mine\nparent: emulated   # and all")
    assert "# a little air in the oil" in text
    assert text.count("# as in the parent, by rig commission, 2026-03-02 09:15 UTC") == 3


def test_commissioning_again_replaces_what_was_written_also_into_another_file(file: Path) -> None:
    rig, out = load_rig(file), file.with_name("new.yaml")
    assert write_rig_file(file, out, rig, EVERYTHING, BEGUN) == [f"rig file: {out}"]
    assert file.read_text() == TEXT
    once = out.read_text()
    again = Changes(Wiring(encoder="inverted"), 0.05)
    write_rig_file(out, None, EVERYTHING.applied(rig), again, BEGUN)
    assert load_rig(out).wiring == again.wiring
    assert out.read_text().count("\n") == once.count("\n")


def test_a_change_that_makes_the_file_unusable_is_taken_back(file: Path) -> None:
    beyond = Changes(position_max=0.7)
    with pytest.raises(ConfigError, match="reaches beyond the stroke"):
        write_rig_file(file, None, load_rig(file), beyond, BEGUN)
    assert file.read_text() == TEXT


def test_the_old_file_is_in_its_place_until_the_new_one_is_known_to_be_as_meant(file: Path) -> None:
    found: list[str] = []

    def is_meant(rig: Rig) -> bool:
        found.append(file.read_text())
        return False

    with pytest.raises(NotAsMeantError):
        rewrite_rig(file, None, TEXT + "# more\n", is_meant, BEGUN)
    assert found == [TEXT]
    assert {path.suffix for path in file.parent.iterdir()} == {".yaml", ".bak"}
    assert file.read_text() == TEXT
