"""The page on rig files is what the classes and the checker say."""

import re
from pathlib import Path

from rig.configuration.checking import check
from rig.io.registry import driver_types
from tools.pages.configuration import PAGE, updated


def test_the_example_of_the_page_checks(tmp_path: Path) -> None:
    (example,) = re.findall(r"```yaml\n(.*?)```", PAGE.read_text(), re.DOTALL)
    (tmp_path / "bench.yaml").write_text(example)
    report = str(check(tmp_path / "bench.yaml"))
    assert report.count("\n  driver ") == len(driver_types())


def test_the_tables_of_the_page_are_up_to_date() -> None:
    assert updated(PAGE.read_text()) == PAGE.read_text()


def test_every_shipped_driver_has_its_table() -> None:
    tables = set(re.findall(r"<!-- keys of (\w+) -->", PAGE.read_text()))
    sections = {"loop", "homing", "wiring", "control", "register_map"}
    assert tables == {*driver_types(), *sections}


def test_a_table_shows_limits_and_what_is_taken_if_nothing_is_given() -> None:
    page = PAGE.read_text()
    assert "| `stale_limit` | 1 ms to 10 s | 0.1 s | age of the fast device" in page
    assert "| `host` | text | required | " in page
    assert "| `overrun` | `skip`, `realign`, `trip` | skip | " in page
