"""Puts tables into a page, between a comment with the table's name and one that ends the table."""

import re
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Final

_TABLE: Final = re.compile(r"(<!-- table of (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(page: str, tables: Mapping[str, str]) -> str:
    """Return the text of `page` with the given tables put in, by name; other tables stay.

    A table's place is between `<!-- table of NAME -->` and `<!-- end -->`.

    Raises:
        ValueError: the page has no place for one of the tables.
    """
    missing = set(tables) - {match[2] for match in _TABLE.finditer(page)}
    if missing:
        raise ValueError(f"no place for {', '.join(sorted(missing))}: add <!-- table of ... -->")

    def table(match: re.Match[str]) -> str:
        text = tables.get(match[2])
        return match[0] if text is None else f"{match[1]}{text.strip()}\n{match[3]}"

    return _TABLE.sub(table, page)


def fill(page: Path, tables: Mapping[str, str]) -> None:
    """Put the given tables, by name, into the file `page`; other tables stay.

    Raises:
        ValueError: the page has no place for one of the tables.
    """
    page.write_text(filled(page.read_text(encoding="utf-8"), tables), encoding="utf-8")


def markdown(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a table in Markdown; the first column is left-aligned, the others right-aligned.

    The cells are taken as they are; a row must have as many cells as the head.
    """
    ruler = [":--", *["--:"] * (len(head) - 1)]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (head, ruler, *rows))
