"""Counts what came of the failures, as a table of docs/failing.md."""

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from tools.pages.marked_tables import markdown

from .trying import Tried

PAGE: Final = Path(__file__).parents[2] / "docs" / "failing.md"
_HEAD: Final = (
    "what fails", "failures", "the run came to its end", "told, exit code 1",
    "refused, exit code 2",
    "stopped or tripped, exit code 3", "killed by a library", "gone on, all tests passed",
    "not as it should be",
)  # fmt: skip


def table_of(tried: Sequence[Tried], total: int) -> str:
    """Return the table of some failures of `total`, a row for each kind of call, in Markdown."""
    groups = list(dict.fromkeys(each.group for each in tried))
    rows = [_row(group, [each for each in tried if each.group == group]) for group in groups]
    return markdown(_HEAD, [*rows, _row(f"tried, of {total}", tried)])


def _row(name: str, tried: Sequence[Tried]) -> tuple[str, ...]:
    codes = [each.exit_code for each in tried if not each.killed]
    killed = sum(each.killed for each in tried)
    resumed = [each.resumed for each in tried if each.resumed is not None]
    counts = (
        len(tried), *(codes.count(code) for code in (0, 1, 2, 3)), killed,
    )  # fmt: skip
    gone_on = f"{resumed.count(0)} of {len(resumed)}" if resumed else ""
    wrong = sum(bool(each.problems) for each in tried)
    return (name, *map(str, counts), gone_on, str(wrong))
