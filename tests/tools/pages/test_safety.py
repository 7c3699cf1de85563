"""The page on safety is what the code does."""

import re

from rig.loop.interlocks.ladder import EXPLANATIONS, Cause
from tools.pages.safety import PAGE, TABLES, updated


def test_the_tables_of_the_page_are_up_to_date() -> None:
    assert updated(PAGE.read_text()) == PAGE.read_text()


def test_the_page_has_every_table_and_places_for_those_that_other_commands_write() -> None:
    found = re.findall(r"<!-- table of (\w+) -->", PAGE.read_text())
    assert sorted(found) == sorted([*TABLES, "chaos", "endurance", "mutation", "soak"])


def test_a_table_written_by_another_command_is_left_alone() -> None:
    page = "<!-- table of chaos -->\n| kept |\n<!-- end -->"
    assert updated(page) == page


def test_every_cause_that_the_text_names_exists() -> None:
    named = re.findall(r"`([A-Z]+_[A-Z_]+)`", PAGE.read_text())
    assert set(named) <= set(Cause.__members__)
    assert {cause.name for cause in EXPLANATIONS} - {"NONE"} <= set(named) | {"OVERRUN", "CRASH"}


def test_every_test_that_the_text_names_exists() -> None:
    named = set(re.findall(r"`(test_\w+)`", PAGE.read_text()))
    files = (PAGE.parents[1] / "tests").rglob("test_*.py")
    defined = {name for file in files for name in re.findall(r"def (test_\w+)", file.read_text())}
    assert len(named) > 20
    assert named <= defined
