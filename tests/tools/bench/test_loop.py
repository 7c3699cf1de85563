"""The loop's benchmark reads cyclictest and writes its table; what it measures is no test's."""

from pathlib import Path

import numpy as np
import pytest

from tools.bench.loop import BEGIN_MARK, END_MARK, Measured, histogram_times, table, write_page

ROOT = Path(__file__).parents[3]


def test_a_histogram_of_cyclictest_is_read_to_the_middle_of_each_microsecond() -> None:
    text = "# Histogram\n000001 000002\n000020 000001\n# Total: 000000003\n"
    assert histogram_times(text) == pytest.approx([1.5e-6, 1.5e-6, 20.5e-6])


def test_a_row_shows_microseconds_ratios_and_the_share_of_missed_ticks() -> None:
    measured = Measured("loop", [np.full(99, 30e-6)], ticks=100, missed=1)
    row = measured.row(np.array([20e-6, 60e-6]))
    assert row == ("loop", "30", "30", "30", "1.50", "0.50", "1.00 %")
    assert measured.row(None)[4:6] == ("", "")


def test_a_page_gets_the_table_between_its_marks_and_stays_as_it_is_elsewhere(
    tmp_path: Path,
) -> None:
    page = tmp_path / "page.md"
    page.write_text(f"before\n{BEGIN_MARK}\nold\n{END_MARK}\nafter\n")
    write_page(page, table([("a",) * 7], 1, 2.0))
    text = page.read_text()
    assert text.startswith("before\n")
    assert text.endswith("\nafter\n")
    assert "old" not in text
    assert "| a | a |" in text


def test_the_published_page_has_its_marks() -> None:
    text = (ROOT / "docs/performance.md").read_text()
    assert BEGIN_MARK in text
    assert END_MARK in text
